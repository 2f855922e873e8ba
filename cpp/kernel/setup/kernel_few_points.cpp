// Few points for small coordinates: how many, and up to where they are enough.
#include <algorithm>
#include <cmath>

#include "setup/sampled_tables.hpp"

namespace flexarm {
namespace lanes {

using Eigen::ArrayXXd;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

/// Of each coordinate, at the points of a rule: how far it moves a slice, and how far it turns (or shears) it.
struct ShapeTable {
  VectorXd weights;
  ArrayXXd moved, turned;  // by points and coordinates

  ShapeTable(const Beam& beam, const std::vector<SliceTable>& tables)
      : weights(GaussRule(static_cast<int>(tables.size()) - 2).weights),
        moved(weights.size(), beam.ne()),
        turned(weights.size(), beam.ne()) {
    for (Index i = 0; i < weights.size(); ++i)
      for (Index k = 0; k < beam.ne(); ++k) {
        const StrainField& f = strain_of(beam, static_cast<int>(k));
        const SliceTable& t = tables[static_cast<std::size_t>(i + 1)];
        moved(i, k) = t.linear(f.position >= 0 ? f.position : 3 + f.rotation, k);
        turned(i, k) = f.is_curvature() ? t.linear(3 + f.rotation, k) : t.strains(f.strain, k);
      }
  }
  /// Integrals of the squares of how each coordinate moves (rows), times turns (columns).
  ArrayXXd integrals(const ArrayXXd& turns) const {
    return (moved.square().matrix().transpose() * weights.asDiagonal() * turns.matrix()).array();
  }
};

/// How many integrate products of some three shapes; the bounds below tell where they suffice. It depends alone
/// on numbers that arms side by side share. 0: there is nothing to save, slices are not at the points, or the beam is
/// curved at rest.
int few_points(const Beam& beam) {
  const BeamOptions& o = beam.options();
  const std::vector<MassSlice>& slices = beam.slices();
  const bool on_points =
      std::all_of(slices.begin(), slices.end(), [](const MassSlice& s) { return s.table.point >= 0; });
  if (o.gauss_points > 0 || !beam.uniform() || beam.curved() || !on_points) return 0;
  const bool given = std::any_of(o.shapes.begin(), o.shapes.end(), [](const MatrixXd& s) { return s.size() > 0; });
  constexpr double kPart = 0.5;  // of the wave numbers that all points resolve
  const int n = given                        ? 2 * beam.points() / 3
                : o.basis == Basis::legendre ? 2 * *std::max_element(o.modes.begin(), o.modes.end()) + 6
                                             : enough_gauss_points(o, {}, beam.length(), false, kPart),
            even = n + n % 2;
  return even + 3 <= beam.points() ? even : 0;
}

std::vector<SliceTable> tables_at_points(const Beam& beam, int points) {
  const VectorXd at = GaussRule(points).points;
  std::vector<double> parts{0.0};
  parts.insert(parts.end(), at.data(), at.data() + at.size());
  parts.push_back(1.0);
  return beam.tables_at(parts, false);
}

VectorXd bounds_of_few(const Beam& beam, const std::vector<SliceTable>& few, const std::vector<SliceTable>& all) {
  constexpr double kSmall = 1e-13;    // part of a coordinate's inertia
  constexpr double kNothing = 2e-15;  // which rounding leaves
  constexpr double kMost = 2.0;       // rad
  constexpr double kSafe = 0.6;       // for coordinates that act together, and in motion
  constexpr int kPowers = 12;
  const ShapeTable coarse(beam, few), fine(beam, all);
  const Eigen::RowVectorXd size = fine.turned.abs().colwise().maxCoeff();
  const VectorXd inertia = fine.weights.transpose() * fine.moved.square().matrix();
  ArrayXXd at_few = ArrayXXd::Ones(coarse.turned.rows(), beam.ne()),
           at_all = ArrayXXd::Ones(fine.turned.rows(), beam.ne());
  VectorXd most = VectorXd::Constant(beam.ne(), kMost);
  double factorial = 1.0;
  for (int power = 0; power <= kPowers; ++power) {
    const ArrayXXd error = (coarse.integrals(at_few) - fine.integrals(at_all)).abs();
    for (Index k = 0; k < beam.ne(); ++k) {
      const double wrong = (error.col(k) / inertia.array()).maxCoeff();
      if (power == 0 && !(wrong <= kSmall)) most.setZero();
      if (power > 0 && !(wrong <= kNothing))
        most[k] = std::min(most[k], std::pow(kSmall * factorial / wrong, 1.0 / power));
      at_few.col(k) *= coarse.turned.col(k) / size[k];
      at_all.col(k) *= fine.turned.col(k) / size[k];
    }
    factorial *= power + 1;
  }
  return size.transpose().cwiseQuotient(kSafe * most);
}

}  // namespace

const PointTables& PointTables::of(const Beam& beam) {
  return beam.kept().get<PointTables>([&] {
    PointTables out;
    out.all = tables_at_points(beam, beam.points());
    const int few = few_points(beam);
    if (few == 0) return out;
    out.few = tables_at_points(beam, few);
    out.bounds = bounds_of_few(beam, out.few, out.all);
    return out;
  });
}

}  // namespace lanes
}  // namespace flexarm
