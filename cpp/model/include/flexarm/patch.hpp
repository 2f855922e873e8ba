// Piezoelectric patches bonded to a beam (Eq. 54-61): stiffness, mass, and a force linear in the voltage.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "flexarm/shape.hpp"

namespace flexarm {

/// Piezoelectric material. The field E3 through the thickness strains it by d31 E3 along the actuation axis and d32 E3
/// across it, in its plane, and shears it by d15 E3 in the plane of the two.
struct Piezo {
  double youngs_modulus, poisson_ratio;  ///< Pa; of the isotropic elasticity, at constant field
  double density;                        ///< kg/m^3
  double d31, d32, d15;                  ///< m/V
  double permittivity;                   ///< F/m at constant stress; 0 when it was not given

  /// @throws std::invalid_argument naming the field and the value
  Piezo(double youngs_modulus, double poisson_ratio, double density, double d31, double d32, double d15,
        double permittivity);
};

/// A layer of a section: on the sides at +y and -y, or at +z and -z.
struct PatchLayer {
  int across = 1;                       ///< the faces' normal: 1 for y, 2 for z
  bool plus = true, minus = true;       ///< which sides
  bool opposed = true;                  ///< of a pair: the minus side has -V, and the same angle; else V and -angle
  double angle = 0.0;                   ///< of the actuation axis, from x towards the face's other axis (rad)
  double width = 0.0, thickness = 0.0;  ///< m
  double inner = 0.0;                   ///< from the neutral axis to the layer's inner face (m)
  double electrode = 1.0;               ///< share of the width, negative where its polarity is reversed
  double twist = 1.0;                   ///< shear in the layer's plane per twist K1 and distance, see surface_twist
};

/// Contributions of patches at a place. Rows are those of StrainVector.
struct PatchSection {
  using Rigidity = Eigen::Matrix<double, kStrains, kStrains>;
  Rigidity rigidity = Rigidity::Zero();               ///< first term of Eq. 58
  StrainVector force = StrainVector::Zero();          ///< per volt, of Eq. 59
  double capacitance = 0.0;                           ///< per length, strains held (F/m)
  double mass = 0.0;                                  ///< per length (kg/m)
  Eigen::Vector3d inertia = Eigen::Vector3d::Zero();  ///< per length, about the axis (kg m)
};

/// Plane stress in the layer, without stress across the beam's axis, so that with the free strains e = d V/t
/// sigma = E (strain_xx - e_xx) and tau = G (shear_xs - e_xs) (Eq. 54), integrated exactly over its thickness. The
/// strains are those of Eq. 18, but for torsion (see `PatchLayer::twist`).
/// @throws std::invalid_argument naming the field and the value
PatchSection patch_section(const Piezo& material, const PatchLayer& layer);

/// Mean over a width of the shear strain at the face of a rectangle in torsion, per twist and distance from the axis,
/// by Saint-Venant's series: 2 for a thin strip, 1 if sections stayed plane.
/// @param depth  of the rectangle, across the face (m)
/// @param breadth  along it (m); the width is in its middle
double surface_twist(double depth, double breadth, double width);

/// A patch along a beam.
struct Patch {
  double start = 0.0, end = 0.0;           ///< m from the clamp
  std::function<PatchSection(double)> at;  ///< at x metres
  std::vector<double> breaks = {};         ///< between its ends: where `at` is not smooth
  bool stiffness = true, mass = true;      ///< whether it adds its own
};

}  // namespace flexarm
