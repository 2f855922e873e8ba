// Materials and cross sections. Axes of a section: y and z, its principal axes; x is the beam's axis.
#pragma once

#include <Eigen/Core>
#include <array>
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

/// Shares of the area that bear shear, k in k G A: along y and along z.
struct ShearCorrection {
  double y, z;

  ShearCorrection(double both) : y(both), z(both) {}
  ShearCorrection(double along_y, double along_z) : y(along_y), z(along_z) {}
};

/// Two opposite faces of a section.
struct Face {
  double distance;              ///< from the neutral axis (m)
  double breadth;               ///< (m)
  std::optional<double> twist;  ///< shear strain of the face in torsion, per twist and distance; none: a rectangle's,
                                ///< which varies over the breadth: see surface_twist
};

/// A cross section, by the integrals that the beam needs.
struct Section {
  double area;                       ///< m^2
  double second_moment_y;            ///< integral of z^2 dA (m^4); resists bending along z
  double second_moment_z;            ///< integral of y^2 dA (m^4); resists bending along y
  double torsion_constant;           ///< Saint-Venant's J (m^4)
  ShearCorrection shear_correction;  ///< k in k G A
  /// Extent of the section along y and z (m), and its faces across them; none if unknown.
  std::array<std::optional<double>, 2> reach = {};
  std::array<std::optional<Face>, 2> faces = {};

  /// @throws std::invalid_argument naming the field and the value
  Section(double area, double second_moment_y, double second_moment_z, double torsion_constant,
          ShearCorrection shear_correction = 5.0 / 6.0);

  /// Full rectangle of sides y and z (m); torsion constant from Saint-Venant's series.
  static Section rectangle(double y, double z, ShearCorrection shear_correction = 5.0 / 6.0);
  /// Disc or tube (m).
  static Section circle(double radius, double inner_radius = 0.0, ShearCorrection shear_correction = 9.0 / 10.0);

  // Shapes whose default shear correction is that of the shear flow without Poisson's ratio.

  /// Tube of an outer radius (m).
  static Section tube(double radius, double thickness, std::optional<ShearCorrection> shear_correction = {});
  /// Full ellipse of axes y and z, from edge to edge (m).
  static Section ellipse(double y, double z, std::optional<ShearCorrection> shear_correction = {});
  /// Hollow rectangle of outer sides y and z; thickness of the walls across y and of those across z (m).
  static Section box(double y, double z, double thickness_y, double thickness_z,
                     std::optional<ShearCorrection> shear_correction = {});
  /// I-beam: web along y, the depth y over all; flanges across it, z wide; their thicknesses (m).
  static Section i_beam(double y, double z, double flange, double web,
                        std::optional<ShearCorrection> shear_correction = {});
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
