// Shape functions of the generalised strains (Eq. 28-32), Ritz bases clamped at X = 0.
#pragma once

#include <Eigen/Core>
#include <array>
#include <iterator>
#include <string>

namespace flexarm {

/// The generalised strains, in the order of Eq. 33, by the names under which their physics calls them
/// (strain_physics.hpp). The one list of them is the table below.
enum Strain { bending_y, bending_z, torsion, shear_y, shear_z, extension };
/// Rows of a section's strains (Eq. 28-32).
struct StrainRow {
  enum { K1, K2, K3, phi12, phi13, eps };
};
constexpr int kMostModes = 40;  ///< of one strain

/// First-order motion of a slice by a strain, and the row of the strain in a section.
struct StrainField {
  Strain which;
  const char* name;
  bool bending;  ///< integrated twice, to a slope and a deflection; else once, to an angle or a deflection
  int position;  ///< row of the deflection among x, y, z; -1: none
  int rotation;  ///< row of the slope or angle among turns about x, y, z; -1: none
  int strain;    ///< row of the strain, see StrainRow,
  const char* row_name;
  double sign;  ///< of rotation and strain

  /// A curvature or twist, of K (1/m); else a part of phi = (eps, phi12, phi13), of x' = R (e_x + phi).
  constexpr bool is_curvature() const { return rotation >= 0; }
};
constexpr StrainField kStrainFields[] = {
    {bending_y, "bending_y", true, 1, 2, StrainRow::K3, "K3", 1.0},      // v2'' = K3
    {bending_z, "bending_z", true, 2, 1, StrainRow::K2, "K2", -1.0},     // v3'' = -K2
    {torsion, "torsion", false, -1, 0, StrainRow::K1, "K1", 1.0},        // alpha' = K1
    {shear_y, "shear_y", false, 1, -1, StrainRow::phi12, "phi12", 1.0},  // gamma2' = phi12
    {shear_z, "shear_z", false, 2, -1, StrainRow::phi13, "phi13", 1.0},  // gamma3' = phi13
    {extension, "extension", false, 0, -1, StrainRow::eps, "eps", 1.0},  // u1' = eps, not in the paper
};
constexpr int kStrains = static_cast<int>(std::size(kStrainFields));
using StrainCounts = std::array<int, kStrains>;  ///< of each strain, in the table's order
/// Strains of a section, and those per coordinate of a beam; rows K1 K2 K3 phi12 phi13 eps.
using StrainVector = Eigen::Matrix<double, kStrains, 1>;
using StrainMatrix = Eigen::Matrix<double, kStrains, Eigen::Dynamic>;
inline bool is_bending(int strain) { return kStrainFields[strain].bending; }

enum class Basis { clamped_free, legendre, loaded };
/// @throws std::invalid_argument naming the known bases
Basis basis_from_name(const std::string& name);

/// Values at one place of the n shape functions of one strain. Bending has deflection, slope and curvature;
/// torsion, shear and extension have an angle (or displacement) and its slope, the strain; `deflection` is empty for
/// them.
struct ShapeValues {
  Eigen::VectorXd deflection;  ///< v2, v3
  Eigen::VectorXd slope;       ///< v2', v3', or alpha, gamma2, gamma3, u1
  Eigen::VectorXd strain;      ///< v2'', v3'', or alpha', gamma2', gamma3', u1'
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
