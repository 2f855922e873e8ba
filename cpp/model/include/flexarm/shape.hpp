// Shape functions of the generalised strains (Eq. 28-32), Ritz bases clamped at X = 0.
#pragma once

#include <Eigen/Core>
#include <string>

namespace flexarm {

/// The five generalised strains, in the order of Eq. 33.
enum Strain { bending_y, bending_z, torsion, shear_y, shear_z };
constexpr int kStrains = 5;
constexpr int kMostModes = 40;  ///< of one strain

/// How a strain moves a slice to first order, and where it stands among K1 K2 K3 phi12 phi13 (Eq. 28-32).
struct StrainField {
  const char* name;
  bool bending;  ///< integrated twice, to a slope and a deflection; else once, to an angle or a deflection
  int position;  ///< row of the deflection among x, y, z; -1: none
  int rotation;  ///< row of the slope or angle among turns about x, y, z; -1: none
  int strain;    ///< row of the strain
  double sign;   ///< of rotation and strain
};
constexpr StrainField kStrainFields[kStrains] = {
    {"bending_y", true, 1, 2, 2, 1.0},   // v2'' = K3
    {"bending_z", true, 2, 1, 1, -1.0},  // v3'' = -K2
    {"torsion", false, -1, 0, 0, 1.0},   // alpha' = K1
    {"shear_y", false, 1, -1, 3, 1.0},   // gamma2' = phi12
    {"shear_z", false, 2, -1, 4, 1.0},   // gamma3' = phi13
};
inline bool is_bending(int strain) { return kStrainFields[strain].bending; }

enum class Basis { clamped_free, legendre, loaded };
/// @throws std::invalid_argument naming the known bases
Basis basis_from_name(const std::string& name);

/// Values at one place of the n shape functions of one strain. Bending has deflection, slope and curvature;
/// torsion and shear have an angle (or deflection) and its slope, the strain; `deflection` is empty for them.
struct ShapeValues {
  Eigen::VectorXd deflection;  ///< v2, v3
  Eigen::VectorXd slope;       ///< v2', v3', or alpha, gamma2, gamma3
  Eigen::VectorXd strain;      ///< v2'', v3'', or alpha', gamma2', gamma3'
};

/// The shape functions of one strain of a beam.
class ShapeSet {
 public:
  /// Shape functions 1..n of the clamped-free or the Legendre basis.
  ShapeSet(int strain, Basis basis, int n, double length);
  /// Strains of any form: column k holds the coefficients of shape k + 1 in the Legendre polynomials P_0, P_1, ... of
  /// 2X/L - 1.
  /// @throws std::invalid_argument when a shape is zero or a combination of those before it
  ShapeSet(int strain, Eigen::MatrixXd legendre, double length);

  int size() const { return n_; }
  bool clamped_free() const { return legendre_.size() == 0 && basis_ == Basis::clamped_free; }
  const Eigen::MatrixXd& coefficients() const { return legendre_; }
  /// The same shapes on a beam of another length.
  ShapeSet at_length(double length) const;
  /// Number of Legendre polynomials in user-given or loaded shapes; 0 for the bases that need none.
  Eigen::Index terms() const { return legendre_.rows(); }
  ShapeValues at(double x) const;

 private:
  int strain_;
  Basis basis_;
  int n_;
  double length_;
  Eigen::MatrixXd legendre_;
};

}  // namespace flexarm
