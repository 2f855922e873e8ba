#include "lanes/beam_points.hpp"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "flexarm/quadrature.hpp"

namespace flexarm {
namespace lanes {

namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kRank = 1e-13;    // parts of a function's size that may be left out of the span
constexpr double kRotary = 1e-13;  // parts of the mass matrix that fewer points of rotation may miss

/// What rotation adds to a link's inertia at given elastic coordinates: J, Mae and Mee in one matrix of 3 + ne.
MatrixXd rotation_inertia(const Link& link, const std::vector<MassSlice>& slices, LinkState<double>& s) {
  const Eigen::Index ne = link.ne();
  MatrixXd M = MatrixXd::Zero(3 + ne, 3 + ne);
  Slice<double> at(link.ne());
  for (const MassSlice& g : slices) {
    at = Slice<double>(link.ne());
    link.move_slice(g.table, s, true, at);
    MatrixXd J(3, 3 + ne);
    J << Matrix3d::Identity(), at.J.bottomRows<3>();
    const Matrix3d I = at.R * g.inertia.asDiagonal() * at.R.transpose();
    M += J.transpose() * I * J;
  }
  return M;
}

/// The fewest Gauss points that do for rotation, where the beam is uniform: what they miss at rest is added (`rest`).
std::vector<MassSlice> rotation_slices(const Beam& beam, MatrixXd& rest) {
  const std::vector<MassSlice>& all = beam.slices();
  const Eigen::Index ne = beam.ne(), full = static_cast<Eigen::Index>(all.size());
  rest = MatrixXd::Zero(3 + ne, 3 + ne);
  if (!beam.options().rotary_inertia) return {};
  const GaussRule rule(static_cast<int>(full), beam.length());
  double mass = 0.0;
  Vector3d inertia = Vector3d::Zero();
  for (const MassSlice& s : all) {
    mass += s.mass;
    inertia += s.inertia;
  }
  for (Eigen::Index g = 0; g < full; ++g) {
    const double part = rule.weights[g] / beam.length();
    const MassSlice& s = all[static_cast<std::size_t>(g)];
    if (std::abs(s.table.X - rule.points[g]) > 1e-12 * beam.length() || std::abs(s.mass - part * mass) > 1e-12 * mass ||
        (s.inertia - part * inertia).norm() > 1e-12 * inertia.norm())
      return all;
  }
  const Link link(Joint::fixed(), std::nullopt, beam, std::nullopt);
  // places to compare at: turned by most of a radian at the end
  LinkState<double> s(0, &*link.beam(), 0);
  std::vector<VectorXd> trials{VectorXd::Zero(ne)};
  const VectorXd size = beam.tip().linear.bottomRows<3>().colwise().norm().transpose();
  for (int t = 0; t < 3; ++t) {
    VectorXd q(ne);
    for (Eigen::Index k = 0; k < ne; ++k)
      q[k] = size[k] > 0.0 ? 0.6 * std::sin(1.0 + 2.3 * static_cast<double>(k) + 1.7 * t) /
                                 (size[k] * (1.0 + 0.5 * static_cast<double>(k)))
                           : 0.0;
    trials.push_back(q);
  }
  std::vector<MatrixXd> exact;
  VectorXd scale;
  for (const VectorXd& q : trials) {
    s.qe = q;
    link.move(s);
    exact.push_back(rotation_inertia(link, all, s));
    if (scale.size() > 0) continue;
    link.mass_matrix(s);
    scale = s.M.diagonal().tail(3 + ne).cwiseSqrt();
  }
  for (const double share : {0.4, 0.5, 0.6, 0.7, 0.8}) {
    const int n = static_cast<int>(std::ceil(share * static_cast<double>(full)));
    const GaussRule few(n, beam.length());
    const std::vector<SliceTable> tables = beam.tables({few.points.data(), few.points.data() + n});
    std::vector<MassSlice> slices;
    for (int g = 0; g < n; ++g)
      slices.push_back({tables[static_cast<std::size_t>(g)], 0.0, few.weights[g] / beam.length() * inertia});
    double worst = 0.0;
    for (std::size_t t = 0; t < trials.size(); ++t) {
      s.qe = trials[t];
      link.move(s);
      MatrixXd missed = exact[t] - rotation_inertia(link, slices, s);
      if (t == 0)
        rest = missed;
      else
        worst =
            std::max(worst, (scale.cwiseInverse().asDiagonal() * (missed - rest) * scale.cwiseInverse().asDiagonal())
                                .cwiseAbs()
                                .maxCoeff());
    }
    if (worst <= kRotary) return slices;
  }
  rest.setZero();
  return all;
}

/// Orthonormal functions that span the products of all slices' positions, times the root of the masses.
MatrixXd product_basis(const std::vector<MassSlice>& slices) {
  const Eigen::Index n = static_cast<Eigen::Index>(slices.size());
  std::vector<VectorXd> functions;
  for (Eigen::Index g = 0; g < n; ++g) {
    const MassSlice& s = slices[static_cast<std::size_t>(g)];
    std::size_t k = 0;
    for_products(s.table, true, [&](double c) {
      if (g == 0) functions.push_back(VectorXd::Zero(n));
      functions[k++][g] = std::sqrt(s.mass) * c;
    });
  }
  MatrixXd F(n, static_cast<Eigen::Index>(functions.size()));
  Eigen::Index used = 0;
  for (const VectorXd& f : functions)
    if (f.norm() > 0.0) F.col(used++) = f.normalized();
  if (used == 0) return MatrixXd(n, 0);
  const Eigen::JacobiSVD<MatrixXd> svd(F.leftCols(used), Eigen::ComputeThinU);
  Eigen::Index rank = 0;
  while (rank < svd.singularValues().size() && svd.singularValues()[rank] > kRank * svd.singularValues()[0]) ++rank;
  return svd.matrixU().leftCols(rank);
}

}  // namespace

const MatrixXd& basis_of(const Beam& beam) {
  BeamPoints& points = beam.points();
  std::call_once(points.has_basis, [&] { points.basis = product_basis(beam.slices()); });
  return points.basis;
}
const BeamPoints& turning_of(const Beam& beam) {
  BeamPoints& points = beam.points();
  std::call_once(points.has_turning, [&] { points.turning = rotation_slices(beam, points.rest); });
  return points;
}

}  // namespace lanes
}  // namespace flexarm
