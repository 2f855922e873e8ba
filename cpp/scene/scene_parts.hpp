// The parts of an arm from their tables. Internal.
#pragma once

#include "flexarm/link.hpp"
#include "scene_value.hpp"

namespace flexarm {

constexpr std::size_t kTerms = 60;  // Legendre polynomials of a shape or a profile, at most

/// A body, of a hub, a tip or a basis_tip.
RigidBody read_body(const At& table);
Beam read_beam(const At& table);

struct SectionKind;

/// A cross section as a scene has it: by its sides, radii or integrals; NaN: left out.
struct SectionSpec {
  const SectionKind* kind;  ///< null: a SectionMatrix, of rows of stiffness and inertia
  std::vector<double> sizes;

  Section section() const;
  SectionMatrix matrix() const;
};

/// Sections along a beam, linear between the places x; a uniform one has no places.
struct SectionAlong {
  std::vector<double> x;
  std::vector<SectionSpec> parts;

  SectionSpec at(double place) const;
};

/// Linear interpolation, constant outside.
double interpolated(double at, const std::vector<double>& x, const std::vector<double>& y);

Patch read_patch(const At& table, const SectionAlong& section, double length);

}  // namespace flexarm
