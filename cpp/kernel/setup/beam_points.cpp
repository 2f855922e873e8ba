#include "setup/beam_points.hpp"

#include <Eigen/SVD>
#include <cmath>

#include "flexarm/quadrature.hpp"
#include "shape_tables.hpp"

namespace flexarm {
namespace lanes {

namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kRank = 1e-13;  // parts of a function's size that may be left out of the span

/// Names a uniform beam's slices at length 1.
std::string name_of(const Beam& beam) { return beam.unit().key + "|" + std::to_string(beam.slices().size()); }

/// Orthonormal functions that span the products of all slices' positions, times the root of the masses.
MatrixXd product_basis(const std::vector<const std::vector<Product>*>& products, const VectorXd& mass) {
  const Eigen::Index n = mass.size();
  std::vector<VectorXd> functions;
  for (Eigen::Index g = 0; g < n; ++g) {
    std::size_t k = 0;
    for_products(*products[static_cast<std::size_t>(g)], true, [&](double c) {
      if (g == 0) functions.push_back(VectorXd::Zero(n));
      functions[k++][g] = std::sqrt(mass[g]) * c;
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

/// Of a uniform beam, whatever its length and mass.
MatrixXd uniform_basis(const Beam& beam) {
  const GaussRule rule(static_cast<int>(beam.slices().size()));
  const std::vector<double> parts(rule.points.data(), rule.points.data() + rule.points.size());
  static auto& kept = *new Kept<MatrixXd>(std::size_t(8) << 20);
  const auto make = [&] {
    const std::shared_ptr<const std::vector<UnitSlice>> slices = unit_slices(beam.unit(), parts);
    std::vector<const std::vector<Product>*> products;
    for (const UnitSlice& s : *slices) products.push_back(&s.products);
    return std::make_shared<const MatrixXd>(product_basis(products, rule.weights));
  };
  return *kept.get(name_of(beam), make, [](const MatrixXd& m) { return static_cast<std::size_t>(8 * m.size()); });
}

MatrixXd basis_of_slices(const Beam& beam) {
  if (beam.uniform() && beam.mass() > 0.0) return uniform_basis(beam);
  const std::vector<MassSlice>& slices = beam.slices();
  std::vector<const std::vector<Product>*> products;
  VectorXd mass(static_cast<Eigen::Index>(slices.size()));
  for (std::size_t g = 0; g < slices.size(); ++g) {
    products.push_back(&slices[g].table.products);
    mass[static_cast<Eigen::Index>(g)] = slices[g].mass;
  }
  return product_basis(products, mass);
}

}  // namespace

const MatrixXd& basis_of(const Beam& beam) {
  return beam.kept().get<MatrixXd>([&] { return basis_of_slices(beam); });
}

}  // namespace lanes
}  // namespace flexarm
