// Materials and cross sections. Axes of a section: y and z, its principal axes; x is the beam's axis.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <vector>

namespace flexarm {

/// Linear elastic material. Give Poisson's ratio or the shear modulus when the beam has torsion or shear.
struct Material {
  double density;         ///< kg/m^3
  double youngs_modulus;  ///< Pa
  double shear_modulus;   ///< Pa; 0 when it was not given

  /// @throws std::invalid_argument naming the field and the value
  Material(double density, double youngs_modulus, std::optional<double> poisson_ratio = {},
           std::optional<double> shear_modulus = {});
};

/// A cross section, by the integrals that the beam needs.
struct Section {
  double area;              ///< m^2
  double second_moment_y;   ///< integral of z^2 dA (m^4); resists bending along z
  double second_moment_z;   ///< integral of y^2 dA (m^4); resists bending along y
  double torsion_constant;  ///< Saint-Venant's J (m^4)
  double shear_correction;  ///< k in k G A

  /// @throws std::invalid_argument naming the field and the value
  Section(double area, double second_moment_y, double second_moment_z, double torsion_constant,
          double shear_correction = 5.0 / 6.0);

  /// Full rectangle of sides y and z (m); torsion constant from Saint-Venant's series.
  static Section rectangle(double y, double z, double shear_correction = 5.0 / 6.0);
  /// Disc or tube (m).
  static Section circle(double radius, double inner_radius = 0.0, double shear_correction = 9.0 / 10.0);
};

/// Any cross section, by its matrices per unit length, in the order force or velocity along x, y, z, then moment or
/// angular velocity about them. It holds its material.
struct SectionMatrix {
  using Matrix = Eigen::Matrix<double, 6, 6>;
  Matrix stiffness;  ///< [N V_y V_z M_x M_y M_z] by [eps phi12 phi13 K1 K2 K3] (N, N m, N m^2)
  Matrix inertia;    ///< [m 1, -m c~; m c~, J], with c the centre of mass and J about the axis (kg/m, kg, kg m)

  /// @throws std::invalid_argument naming the field and the value
  SectionMatrix(const Matrix& stiffness, const Matrix& inertia);

  double mass() const { return inertia(0, 0); }  ///< kg/m
  Eigen::Vector3d com() const;                   ///< zero without mass
  Eigen::Matrix3d inertia_about_com() const;
};

/// The section along a beam that is not uniform.
template <class Any>
struct Along {
  std::function<Any(double)> at;  ///< at x metres from the clamp
  std::vector<double> breaks;     ///< between 0 and the length: where it is not smooth
};
using SectionProfile = Along<Section>;
using SectionMatrixProfile = Along<SectionMatrix>;

}  // namespace flexarm
