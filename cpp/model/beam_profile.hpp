// Section and material along a beam.
#pragma once

#include "flexarm/beam.hpp"
#include "strain_physics.hpp"

namespace flexarm {

struct Beam::Profile : Along<SectionLaw> {
  bool uniform;
  bool shears = true;  ///< whether it has a shear modulus
  bool matrices;       ///< or else doubly symmetric

  template <class Any, class... More>
  Profile(const Along<Any>& along, bool is_uniform, const More&... material)
      : Along<SectionLaw>{[=](double x) { return SectionLaw(material..., along.at(x)); }, along.breaks},
        uniform(is_uniform),
        matrices(sizeof...(More) == 0) {
    ((shears = material.shear_modulus > 0.0), ...);
  }

  /// Many points, on each stretch where the section is smooth.
  GaussRule fine(int n, double length) const { return GaussRule(n, length, breaks); }
};

/// @throws std::invalid_argument naming the field and the value
/// @param shears  whether the beam has a shear modulus
void check_options(const BeamOptions& options, bool shears);

}  // namespace flexarm
