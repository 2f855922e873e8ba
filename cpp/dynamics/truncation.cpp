#include "flexarm/truncation.hpp"

#include <algorithm>

#include "flexarm/kinematics.hpp"

namespace flexarm {

namespace {

/// A beam alone, and places along it.
struct Clamped {
  Arm arm;
  Workspace ws;
  std::vector<PlacedSlice> places;

  explicit Clamped(const Beam& beam) : arm({Link(Joint::fixed(), std::nullopt, beam, heavy())}), ws(arm) {
    constexpr int kPlaces = 8;
    for (int k = 1; k <= kPlaces; ++k) places.emplace_back(arm, 0, beam.length() * k / kPlaces);
  }
  /// So that every coordinate of the arm moves some inertia.
  static RigidBody heavy() {
    RigidBody body;
    body.mass = 1.0;
    body.inertia.setIdentity();
    return body;
  }
};

}  // namespace

Eigen::VectorXd truncation(const Beam& beam, const Eigen::MatrixXd& q) {
  Eigen::VectorXd out = Eigen::VectorXd::Zero(q.rows());
  if (beam.order() != kExact || beam.ne() == 0) return out;
  Clamped own(beam), fine(beam.with_points(2 * beam.points() + 8));
  const Eigen::VectorXd still = Eigen::VectorXd::Zero(beam.ne());
  for (Eigen::Index row = 0; row < q.rows(); ++row) {
    for (Clamped* c : {&own, &fine}) move_arm(c->arm, c->ws, q.row(row), still);
    for (std::size_t k = 0; k < own.places.size(); ++k) {
      const Pose a = slice_pose(own.ws, own.places[k]), b = slice_pose(fine.ws, fine.places[k]);
      const double wrong =
          std::max((a.p - b.p).cwiseAbs().maxCoeff() / beam.length(), (a.R - b.R).cwiseAbs().maxCoeff());
      if (!(wrong <= out[row])) out[row] = wrong;  // NaN as well
    }
  }
  return out;
}

}  // namespace flexarm
