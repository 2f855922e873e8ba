// Shape functions of the generalised strains (Eq. 28-32), Ritz bases clamped at X = 0.
#pragma once

#include <Eigen/Core>
#include <string>

namespace flexarm {

/// The five generalised strains, in the order of Eq. 33.
enum Strain { bending_y, bending_z, torsion, shear_y, shear_z };
constexpr int kStrains = 5;
constexpr const char* kStrainNames[kStrains] = {"bending_y", "bending_z", "torsion", "shear_y", "shear_z"};
inline bool is_bending(int strain) { return strain <= bending_z; }

enum class Basis { clamped_free, legendre };
/// @throws std::invalid_argument naming the known bases
Basis basis_from_name(const std::string& name);

/// Values at one place of the n shape functions of one strain. Bending has deflection, slope and curvature;
/// torsion and shear have an angle (or deflection) and its slope, the strain; `deflection` is empty for them.
struct ShapeValues {
  Eigen::VectorXd deflection;  ///< v2, v3
  Eigen::VectorXd slope;       ///< v2', v3', or alpha, gamma2, gamma3
  Eigen::VectorXd strain;      ///< v2'', v3'', or alpha', gamma2', gamma3'
};

/// Shape functions 1..n of a bending strain at x on a beam of the given length.
ShapeValues bending_shapes(Basis basis, int n, double length, double x);
/// Shape functions 1..n of torsion or shear.
ShapeValues simple_shapes(Basis basis, int n, double length, double x);

inline ShapeValues shapes(Basis basis, int strain, int n, double length, double x) {
  return is_bending(strain) ? bending_shapes(basis, n, length, x) : simple_shapes(basis, n, length, x);
}

}  // namespace flexarm
