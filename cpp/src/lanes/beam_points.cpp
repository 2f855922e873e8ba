#include "lanes/beam_points.hpp"

#include <Eigen/SVD>
#include <cmath>

namespace flexarm {
namespace lanes {

namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kRank = 1e-13;  // parts of a function's size that may be left out of the span

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
}  // namespace lanes
}  // namespace flexarm
