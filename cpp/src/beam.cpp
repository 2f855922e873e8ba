#include "flexarm/beam.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "flexarm/check.hpp"
#include "flexarm/quadrature.hpp"

namespace flexarm {

namespace {

using Eigen::MatrixXd;

/// Running integrals from 0 to X of the products of shape functions that the second-order terms are made of.
struct ProductIntegrals {
  using Table = std::array<std::array<MatrixXd, kStrains>, kStrains>;
  Table slope_slope, slope_strain;  ///< int s_i s_j^T and int s_i e_j^T of slopes s and strains e
  std::array<MatrixXd, 2> nested;   ///< int int alpha v''^T for bending y and z

  explicit ProductIntegrals(const std::array<int, kStrains>& n) {
    for (int i = 0; i < kStrains; ++i)
      for (int j = 0; j < kStrains; ++j) slope_slope[i][j] = slope_strain[i][j] = MatrixXd::Zero(n[i], n[j]);
    for (int t : {bending_y, bending_z}) nested[t] = MatrixXd::Zero(n[torsion], n[t]);
  }

  /// Goes on from X = from to X = to.
  template <class Shapes>
  void advance(double from, double to, const Shapes& shapes_at) {
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
};

/// The second-order terms of position (Eq. 24-27 with the shear angles, to total order 2) and of the rotation
/// vector (theta_2 = 1/2 int theta_1 x K), with theta_1 = (alpha, -v3', v2') and K = (alpha', -v3'', v2'').
std::vector<Product> second_order(const ProductIntegrals& I, const std::array<int, kStrains>& first) {
  std::vector<Product> terms;
  const auto add = [&](int row, int i, int j, const MatrixXd& C) {
    if (C.size() > 0) terms.push_back({row, first[i], first[j], C});
  };
  // x1 = X - int (v2'^2 + v3'^2)/2 + v2' gamma2' + v3' gamma3': the shortening
  add(0, bending_y, bending_y, -I.slope_slope[bending_y][bending_y]);
  add(0, bending_z, bending_z, -I.slope_slope[bending_z][bending_z]);
  add(0, bending_y, shear_y, -I.slope_strain[bending_y][shear_y]);
  add(0, bending_z, shear_z, -I.slope_strain[bending_z][shear_z]);
  // x2 = v2 + gamma2 - int (int alpha v3'' + alpha gamma3'),  x3 = v3 + gamma3 + int (int alpha v2'' + alpha
  // gamma2')
  add(1, torsion, bending_z, -I.nested[bending_z]);
  add(1, torsion, shear_z, -I.slope_strain[torsion][shear_z]);
  add(2, torsion, bending_y, I.nested[bending_y]);
  add(2, torsion, shear_y, I.slope_strain[torsion][shear_y]);
  // theta_2 = 1/2 int (v2' v3'' - v3' v2'', v2' alpha' - alpha v2'', v3' alpha' - alpha v3'')
  const auto antisymmetric = [&](int i, int j) -> MatrixXd {
    return 0.5 * (I.slope_strain[i][j] - I.slope_strain[j][i].transpose());
  };
  add(3, bending_y, bending_z, antisymmetric(bending_y, bending_z));
  add(4, bending_y, torsion, antisymmetric(bending_y, torsion));
  add(5, bending_z, torsion, antisymmetric(bending_z, torsion));
  return terms;
}

}  // namespace

int enough_gauss_points(const BeamOptions& o) {
  const int bending = std::max(o.modes[bending_y], o.modes[bending_z]);
  const int simple = std::max({o.modes[torsion], o.modes[shear_y], o.modes[shear_z]});
  if (o.basis == Basis::legendre) {
    // degree of a slice's position: deflection n + 1; shortening 2n + 1; alpha and gamma n; at order i products of i
    const int linear = std::max(bending + 1, simple), m = std::max(bending, simple);
    const int quadratic = std::max({linear, 2 * bending + 1, bending + simple + 1});
    const int degree = o.order < 2 ? linear : o.order == 2 ? quadratic : 3 * m + 1;
    // the rotation exp(theta) is no polynomial
    if (o.order == kExact) return degree + 9;
    return o.order > 0 && o.rotary_inertia ? std::max(degree, quadratic) + 3 + (bending + simple) / 2 : degree + 1;
  }
  // The integrand holds products of two (order i: 2 i) modes of wave number beta ~ (n - 1/2) pi over the
  // length. n points integrate cos(k X/L) to (e k / 8n)^2n.
  const double beta = 3.14159265358979323846 * std::max(bending - 0.5, simple - 0.5);
  const int products = o.order == 1 && o.rotary_inertia ? 2 : std::clamp(o.order, 1, 3);
  const double k = 2.0 * products * std::max(beta, 1.9);
  int n = 4;
  while (2.0 * n * std::log(std::exp(1.0) * k / (8.0 * n)) > std::log(1e-12)) ++n;
  return n;
}

Beam::Beam(double length, const Section& section, const Material& material, const BeamOptions& options)
    : length_(positive("length", length)), section_(section), material_(material), options_(options) {
  for (int s = 0; s < kStrains; ++s) {
    const int n = options_.modes[s];
    if (n < 0 || n > 40) bad_value(std::string("modes.") + kStrainNames[s], n, "must be from 0 to 40");
    first_[s] = ne_;
    ne_ += n;
  }
  if (options_.order < 0 || options_.order > kExact)
    bad_value("order", options_.order, "must be 0, 1, 2, 3 or \"exact\"");
  non_negative("damping_ratio", options_.damping_ratio);
  non_negative("kelvin_voigt", options_.kelvin_voigt);
  if (options_.gauss_points < 0 || options_.gauss_points > 400)
    bad_value("gauss_points", options_.gauss_points, "must be from 1 to 400, or 0 to let the basis choose");
  const bool needs_shear = options_.modes[torsion] + options_.modes[shear_y] + options_.modes[shear_z] > 0;
  if (needs_shear && material_.shear_modulus <= 0.0)
    bad_value("shear_modulus", "not given", "torsion and shear need the material's poisson_ratio or shear_modulus");

  // Slices: the Gauss points and, last, the tip.
  const int n = options_.gauss_points > 0 ? options_.gauss_points : enough_gauss_points(options_);
  rule_ = GaussRule(n, length_);
  std::vector<double> stations(rule_.points.data(), rule_.points.data() + n);
  stations.push_back(length_);
  std::vector<SliceTable> all = tables(stations);
  const double rho = material_.density, iy = section_.second_moment_y, iz = section_.second_moment_z;
  mass_ = rho * section_.area * length_;
  for (int g = 0; g < n; ++g) {
    const double w = rho * rule_.weights[g];
    const Eigen::Vector3d inertia =
        options_.rotary_inertia ? Eigen::Vector3d(w * (iy + iz), w * iy, w * iz) : Eigen::Vector3d::Zero();
    slices_.push_back({all[g], w * section_.area, inertia});
  }
  tip_ = all[n];
  if (options_.order > 2) {
    SeriesTables series{MatrixXd(n, n), {}};
    for (int g = 0; g < n; ++g) {
      series.cumulative.row(g) = all[g].weights;
      series.strains.push_back(all[g].strains);
    }
    series_ = std::move(series);
  }

  // Elastic forces (Eq. 62) and, for modal damping, the mass of the clamped beam at rest.
  const double G = material_.shear_modulus;
  const double rigidity[kStrains] = {material_.youngs_modulus * iz, material_.youngs_modulus * iy,
                                     G * section_.torsion_constant, section_.shear_correction * G * section_.area,
                                     section_.shear_correction * G * section_.area};
  stiffness_ = damping_ = MatrixXd::Zero(ne_, ne_);
  const GaussRule fine(2 * *std::max_element(options_.modes.begin(), options_.modes.end()) + 16, length_);
  for (Eigen::Index g = 0; g < fine.points.size(); ++g)
    for (int s = 0; s < kStrains; ++s) {
      const int ns = options_.modes[s];
      const Eigen::VectorXd e = shapes(options_.basis, s, ns, length_, fine.points[g]).strain;
      stiffness_.block(first_[s], first_[s], ns, ns) += fine.weights[g] * rigidity[s] * e * e.transpose();
    }
  damping_ = options_.kelvin_voigt * stiffness_;
  if (options_.damping_ratio > 0.0 && ne_ > 0) {
    MatrixXd M = MatrixXd::Zero(ne_, ne_);
    for (const MassSlice& s : slices_) {
      const auto Jx = s.table.linear.topRows<3>(), Jt = s.table.linear.bottomRows<3>();
      M += s.mass * Jx.transpose() * Jx + Jt.transpose() * s.inertia.asDiagonal() * Jt;
    }
    const Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd> modes(stiffness_, M);
    if (modes.info() != Eigen::Success || !modes.eigenvalues().allFinite())
      bad_value("damping_ratio", options_.damping_ratio, "the clamped beam has a mode without inertia");
    const MatrixXd MV = M * modes.eigenvectors();
    const Eigen::VectorXd d = 2.0 * options_.damping_ratio * modes.eigenvalues().cwiseMax(0.0).cwiseSqrt();
    damping_ += MV * d.asDiagonal() * MV.transpose();
  }
}

std::vector<SliceTable> Beam::tables(const std::vector<double>& stations) const {
  const std::array<int, kStrains>& n = options_.modes;
  const auto shapes_at = [&](double X) {
    std::array<ShapeValues, kStrains> s;
    for (int i = 0; i < kStrains; ++i) s[i] = shapes(options_.basis, i, n[i], length_, X);
    return s;
  };
  const double step = length_ / (2.0 + 0.5 * *std::max_element(n.begin(), n.end()));  // the integrals' longest stride
  ProductIntegrals integrals(n);
  std::vector<SliceTable> out;
  double from = 0.0;
  for (double X : stations) {
    if (options_.order == 2 && X > from) {
      const int strides = static_cast<int>(std::ceil((X - from) / step));
      for (int k = 0; k < strides; ++k)
        integrals.advance(from + (X - from) * k / strides, from + (X - from) * (k + 1) / strides, shapes_at);
      from = X;
    }
    SliceTable t;
    t.X = X;
    t.linear = MatrixXd::Zero(6, ne_);
    t.strains = MatrixXd::Zero(5, ne_);
    const std::array<ShapeValues, kStrains> s = shapes_at(X);
    const auto fill = [&](auto& rows, int row, int strain, const Eigen::VectorXd& v, double sign = 1.0) {
      rows.block(row, first_[strain], 1, n[strain]) = sign * v.transpose();
    };
    fill(t.linear, 1, bending_y, s[bending_y].deflection);
    fill(t.linear, 2, bending_z, s[bending_z].deflection);
    fill(t.linear, 1, shear_y, s[shear_y].slope);
    fill(t.linear, 2, shear_z, s[shear_z].slope);
    fill(t.linear, 3, torsion, s[torsion].slope);
    fill(t.linear, 4, bending_z, s[bending_z].slope, -1.0);
    fill(t.linear, 5, bending_y, s[bending_y].slope);
    fill(t.strains, 0, torsion, s[torsion].strain);
    fill(t.strains, 1, bending_z, s[bending_z].strain, -1.0);
    fill(t.strains, 2, bending_y, s[bending_y].strain);
    fill(t.strains, 3, shear_y, s[shear_y].strain);
    fill(t.strains, 4, shear_z, s[shear_z].strain);
    if (options_.order == 2) t.products = second_order(integrals, first_);
    if (options_.order > 2) t.weights = integral_weights(rule_, length_, X);
    out.push_back(std::move(t));
  }
  return out;
}

SliceTable Beam::slice_at(double X) const {
  if (!(X >= 0.0 && X <= length_))
    bad_value("x", X, "must be on the beam, from 0 to its length, " + std::to_string(length_) + " m");
  return tables({X}).front();
}

}  // namespace flexarm
