// The physics of the generalised strains: their stiffness, their motion, and their products at second order. A further
// strain is one row of the table in shape.hpp, and its terms here and in strain_physics.cpp. (Beyond
// order 2 nothing is to be added: series.cpp integrates R' = R K~ and x' = R (e_x + phi) of all rows.)
#pragma once

#include <array>
#include <vector>

#include "flexarm/quadrature.hpp"
#include "flexarm/section.hpp"
#include "flexarm/shape.hpp"
#include "flexarm/slice.hpp"

namespace flexarm {

/// Whether the shear modulus resists a strain; else Young's.
bool is_shear(int strain);
/// The data of a section for a beam, per length.
struct SectionLaw {
  Eigen::Matrix<double, kStrains, kStrains> rigidity;  ///< stresses by strains, in the order of StrainRow (N, N m^2)
  double mass;                                         ///< kg/m
  Eigen::Vector3d com = Eigen::Vector3d::Zero();       ///< of the centre of mass (m)
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();   ///< about it (kg m)

  /// EI_z, EI_y, GJ, kGA, kGA, EA of Eq. 62.
  SectionLaw(const Material& material, const Section& s);
  explicit SectionLaw(const SectionMatrix& s);

  double rigidity_of(int strain) const;
  /// Whether a strain has part in no other's stress.
  bool uncoupled() const;
  /// The inertia of a clamped mode of one strain (Euler-Bernoulli for bending).
  double modal_inertia(int strain) const;
};
/// The plane of a beam that bends and shears in no other. At order 2 and below, one that stretches has none: the
/// product of a slope and a stretch displaces it across, where the kernels of a plane have linear terms only.
Plane plane_of(const StrainCounts& modes, int order);

/// Running integrals from 0 to X of the products of shape functions that the second-order terms are made of.
struct ProductIntegrals {
  using Table = std::array<std::array<Eigen::MatrixXd, kStrains>, kStrains>;
  Table slope_slope, slope_strain;        ///< int s_i s_j^T and int s_i e_j^T of slopes s and strains e
  std::array<Eigen::MatrixXd, 2> nested;  ///< int int alpha v''^T for bending y and z

  explicit ProductIntegrals(const StrainCounts& n);

  /// Goes on from X = from to X = to.
  template <class Shapes>
  void advance(double from, double to, const Shapes& shapes_at);
};
template <class Shapes>
void ProductIntegrals::advance(double from, double to, const Shapes& shapes_at) {
  const GaussRule rule(24, to - from);
  for (int t : {bending_y, bending_z}) nested[t] += (to - from) * slope_strain[torsion][t];
  for (Eigen::Index g = 0; g < rule.points.size(); ++g) {
    const double w = rule.weights[g], left = to - from - rule.points[g];
    const std::array<ShapeValues, kStrains> s = shapes_at(from + rule.points[g]);
    for (int i = 0; i < kStrains; ++i)
      for (int j = 0; j < kStrains; ++j) {
        slope_slope[i][j] += w * s[i].slope * s[j].slope.transpose();
        slope_strain[i][j] += w * s[i].slope * s[j].strain.transpose();
      }
    for (int t : {bending_y, bending_z}) nested[t] += w * left * s[torsion].slope * s[t].strain.transpose();
  }
}
/// The second-order terms of position (Eq. 24-27 with the shear angles and the stretch, to total order 2) and of the
/// rotation vector (theta_2 = 1/2 int theta_1 x K), with theta_1 = (alpha, -v3', v2') and K = (alpha', -v3'', v2'').
std::vector<Product> second_order(const ProductIntegrals& I, const StrainCounts& first);

}  // namespace flexarm
