#include "lanes/beam_points.hpp"

#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <deque>

#include "flexarm/quadrature.hpp"
#include "shape_tables.hpp"

namespace flexarm {
namespace lanes {

namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kRank = 1e-13;    // parts of a function's size that may be left out of the span
constexpr double kRotary = 1e-13;  // parts of the mass matrix that fewer points of rotation may miss

/// What slices of these inertias (rows) add to a link's inertia by their rotation, at given elastic coordinates: J, Mae
/// and Mee in one matrix of 3 + ne.
MatrixXd rotation_inertia(const Link& link, const std::vector<SliceTable>& tables, const Eigen::MatrixX3d& inertias,
                          const LinkState<double>& s) {
  const Eigen::Index ne = link.ne();
  MatrixXd M = MatrixXd::Zero(3 + ne, 3 + ne);
  Slice<double> at(link.ne());
  for (std::size_t g = 0; g < tables.size(); ++g) {
    at = Slice<double>(link.ne());
    link.move_slice(tables[g], s, true, at);
    MatrixXd J(3, 3 + ne);
    J << Matrix3d::Identity(), at.J.bottomRows<3>();
    const Matrix3d I = at.R * inertias.row(static_cast<Eigen::Index>(g)).asDiagonal() * at.R.transpose();
    M += J.transpose() * I * J;
  }
  return M;
}

/// How well a uniform beam's inertia of rotation is summed over fewer Gauss points, at places turned by most of a
/// radian at the end. At length 1; of unit inertia about y (with x) and about z (with x), of which any section's is a
/// sum.
class RotationTrials {
 public:
  struct Few {
    std::vector<double> parts;  ///< places
    VectorXd weights;
    std::array<std::vector<MatrixXd>, 2> missed;  ///< at each place tried
  };

  explicit RotationTrials(const Beam& beam) : link_(Joint::fixed(), std::nullopt, at_length_1(beam), std::nullopt) {
    LinkState<double> s = state();
    const Eigen::Index ne = link_.ne();
    trials_.push_back(VectorXd::Zero(ne));
    const VectorXd size = link_.beam()->tip().linear.bottomRows<3>().colwise().norm().transpose();
    for (int t = 0; t < 3; ++t) {
      VectorXd q(ne);
      for (Eigen::Index k = 0; k < ne; ++k)
        q[k] = size[k] > 0.0 ? 0.6 * std::sin(1.0 + 2.3 * static_cast<double>(k) + 1.7 * t) /
                                   (size[k] * (1.0 + 0.5 * static_cast<double>(k)))
                             : 0.0;
      trials_.push_back(q);
    }
    const GaussRule rule(static_cast<int>(link_.beam()->slices().size()));
    all_ = sums({rule.points.data(), rule.points.data() + rule.points.size()}, rule.weights);
    s.qe = trials_[0];
    link_.move(s);
    link_.mass_matrix(s);
    still_ = s.M.diagonal().tail(3 + ne);
  }

  /// The fewest points that do for a beam of unit mass and these inertias about y and z; null: all are needed.
  /// `rest`: what they miss at rest.
  const Few* fewest(double about_y, double about_z, MatrixXd& rest) const {
    const VectorXd scale = (still_ + about_y * all_[0][0].diagonal() + about_z * all_[1][0].diagonal()).cwiseSqrt();
    const auto whole = [&](const Few& few, std::size_t t) -> MatrixXd {
      return about_y * few.missed[0][t] + about_z * few.missed[1][t];
    };
    for (std::size_t k = 0; k < kShares.size(); ++k) {
      const Few& few = share(k);
      rest = whole(few, 0);
      double worst = 0.0;
      for (std::size_t t = 1; t < trials_.size(); ++t) {
        const MatrixXd wrong = whole(few, t) - rest;
        worst = std::max(
            worst,
            (scale.cwiseInverse().asDiagonal() * wrong * scale.cwiseInverse().asDiagonal()).cwiseAbs().maxCoeff());
      }
      if (worst <= kRotary) return &few;
    }
    rest.setZero();
    return nullptr;
  }

 private:
  static constexpr std::array<double, 5> kShares{0.4, 0.5, 0.6, 0.7, 0.8};

  static Beam at_length_1(const Beam& beam) {
    BeamOptions o = beam.options();
    o.rotary_inertia = false;
    o.damping_ratio = o.kelvin_voigt = 0.0;
    o.gauss_points = static_cast<int>(beam.slices().size());
    for (std::size_t s = 0; s < kStrains; ++s)
      if (o.modes[s] > 0) o.shapes[s] = beam.unit().shapes[s].coefficients();
    if (o.basis == Basis::loaded) o.basis = Basis::legendre;
    return Beam(1.0, Section(1.0, 1.0, 1.0, 1.0), Material(1.0, 1.0, std::nullopt, 1.0), o);
  }
  LinkState<double> state() const { return LinkState<double>(0, &*link_.beam(), 0); }

  std::array<std::vector<MatrixXd>, 2> sums(const std::vector<double>& parts, const VectorXd& weights) const {
    LinkState<double> s = state();
    const std::vector<SliceTable> tables = link_.beam()->tables_at(parts);
    std::array<std::vector<MatrixXd>, 2> out;
    for (const VectorXd& q : trials_) {
      s.qe = q;
      link_.move(s);
      out[0].push_back(rotation_inertia(link_, tables, weights * Eigen::RowVector3d(1.0, 1.0, 0.0), s));
      out[1].push_back(rotation_inertia(link_, tables, weights * Eigen::RowVector3d(1.0, 0.0, 1.0), s));
    }
    return out;
  }

  const Few& share(std::size_t k) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    while (few_.size() <= k) {
      const double full = static_cast<double>(link_.beam()->slices().size());
      const GaussRule rule(static_cast<int>(std::ceil(kShares[few_.size()] * full)));
      Few few{{rule.points.data(), rule.points.data() + rule.points.size()}, rule.weights, {}};
      few.missed = sums(few.parts, few.weights);
      for (std::size_t i = 0; i < 2; ++i)
        for (std::size_t t = 0; t < trials_.size(); ++t) few.missed[i][t] = all_[i][t] - few.missed[i][t];
      few_.push_back(std::move(few));
    }
    return few_[k];
  }

  Link link_;
  std::vector<VectorXd> trials_;
  std::array<std::vector<MatrixXd>, 2> all_;
  VectorXd still_;  // inertias without rotary inertia, of unit mass
  mutable std::mutex mutex_;
  mutable std::deque<Few> few_;  // whose entries stay where they are
};

/// Names a uniform beam's slices at length 1.
std::string name_of(const Beam& beam) { return beam.unit().key + "|" + std::to_string(beam.slices().size()); }

/// The fewest Gauss points that do for rotation, where the beam is uniform: what they miss at rest is added (`rest`).
std::vector<MassSlice> rotation_slices(const Beam& beam, MatrixXd& rest) {
  const std::vector<MassSlice>& all = beam.slices();
  const Eigen::Index ne = beam.ne();
  rest = MatrixXd::Zero(3 + ne, 3 + ne);
  if (!beam.options().rotary_inertia) return {};
  const double L = beam.length(), mass = beam.mass();
  if (!beam.uniform() || !(mass > 0.0)) return all;
  Vector3d inertia = Vector3d::Zero();
  for (const MassSlice& s : all) inertia += s.inertia;
  static auto& kept = *new Kept<RotationTrials>(std::size_t(64) << 20);
  const std::shared_ptr<const RotationTrials> trials = kept.get(
      name_of(beam), [&] { return std::make_shared<const RotationTrials>(beam); },
      [&](const RotationTrials&) { return static_cast<std::size_t>(8 * 60 * (3 + ne) * (3 + ne)); });
  const double unit = mass * L * L;
  const RotationTrials::Few* few = trials->fewest(inertia[1] / unit, inertia[2] / unit, rest);
  if (!few) return all;
  VectorXd scale = VectorXd::Ones(3 + ne);  // of the coordinates at length 1
  for (int s = 0; s < kStrains; ++s)
    scale.segment(3 + beam.first(s), beam.options().modes[s]).setConstant(std::pow(L, -beam.unit().power(s)));
  rest = unit * scale.asDiagonal() * rest * scale.asDiagonal();
  const std::vector<SliceTable> tables = beam.tables_at(few->parts);
  std::vector<MassSlice> slices;
  for (std::size_t g = 0; g < tables.size(); ++g)
    slices.push_back({tables[g], 0.0, few->weights[static_cast<Eigen::Index>(g)] * inertia});
  return slices;
}

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
  BeamPoints& points = beam.points();
  std::call_once(points.has_basis, [&] { points.basis = basis_of_slices(beam); });
  return points.basis;
}
const BeamPoints& turning_of(const Beam& beam) {
  BeamPoints& points = beam.points();
  std::call_once(points.has_turning, [&] { points.turning = rotation_slices(beam, points.rest); });
  return points;
}

}  // namespace lanes
}  // namespace flexarm
