// Section and material along a beam.
#pragma once

#include "flexarm/beam.hpp"

namespace flexarm {

struct Beam::Profile {
  SectionProfile section;
  Material material;
  bool uniform;

  double mass(const Section& s) const { return material.density * s.area; }
  /// Many points, on each stretch where the section is smooth.
  GaussRule fine(int n, double length) const { return GaussRule(n, length, section.breaks); }
};

}  // namespace flexarm
