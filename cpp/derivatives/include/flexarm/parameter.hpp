// What the derivatives of a run are by: numbers that its arm, or what acts on it, is made of.
#pragma once

#include <vector>

#include "flexarm/problem.hpp"

namespace flexarm {

/// The same problem with a parameter changed by `offset`. `weight` times what it gives, summed over all neighbours, is
/// the derivative by the parameter: a difference of high order, which is exact for what is a polynomial of it.
struct Neighbour {
  double weight, offset;
  Problem problem;  ///< of the same coordinates
};

struct Parameter {
  double scale = 1.0;        ///< its size: an error of its derivatives counts times this
  bool forces_only = false;  ///< whether it changes nothing but controllers and the start
  std::vector<Neighbour> neighbours = {};
};

}  // namespace flexarm
