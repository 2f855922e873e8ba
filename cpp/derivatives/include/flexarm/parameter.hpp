// Parameters, by which a run has derivatives: numbers of its arm, or of the forces and laws that act on it.
#pragma once

#include <vector>

#include "flexarm/problem.hpp"

namespace flexarm {

/// The same problem with a parameter changed by `offset`. `weight` times its result, summed over all neighbours, is
/// the derivative by the parameter: a difference of high order, which is exact for polynomials.
struct Neighbour {
  double weight, offset;
  Problem problem;  ///< of the same coordinates
};

struct Parameter {
  double scale = 1.0;        ///< its size: an error of its derivatives counts times this
  bool forces_only = false;  ///< whether it changes nothing but controllers and the start
  bool start_only = false;   ///< whether it changes nothing but the start
  std::vector<Neighbour> neighbours = {};
};

}  // namespace flexarm
