#include "flexarm/joint.hpp"

#include <cmath>

#include "flexarm/check.hpp"

namespace flexarm {

namespace {

Eigen::Vector3d unit(const Eigen::Vector3d& axis) {
  finite("axis", axis);
  const double size = axis.stableNorm();
  if (!(size > 0.0)) bad_value("axis", axis.transpose(), "must not be zero");
  return std::abs(size - 1.0) < 1e-15 ? axis : axis.stableNormalized();  // idempotent
}

void check_placement(const char* side, const Placement& place) {
  finite(std::string(side) + ".position", place.position);
  const Eigen::Matrix3d& R = place.rotation;
  if (!R.allFinite() || (R * R.transpose() - Eigen::Matrix3d::Identity()).norm() > 1e-9 || R.determinant() < 0.0)
    bad_value(std::string(side) + ".rotation", R.reshaped().transpose(), "must be a rotation matrix");
}

/// The angle of a ball's turn, from its quaternion (of any length): at most pi.
double angle_of(const double* q) {
  return 2.0 * std::atan2(Eigen::Map<const Eigen::Vector3d>(q + 1).norm(), std::abs(q[0]));
}

}  // namespace

Joint::Joint(std::vector<ElementaryMotion> motions, bool ball, std::vector<std::string> labels,
             std::vector<JointForce> forces, const Placement& inboard, const Placement& outboard)
    : motions_(std::move(motions)),
      ball_(ball),
      labels_(std::move(labels)),
      forces_(std::move(forces)),
      inboard_(inboard),
      outboard_(outboard) {
  for (ElementaryMotion& m : motions_) m.axis = unit(m.axis);
  if (nv() > 6) bad_value("axes", motions_.size(), "at most six freedoms, a ball counting three");
  if (static_cast<int>(labels_.size()) != nv()) bad_value("labels", labels_.size(), "one for each freedom");
  if (!forces_.empty() && static_cast<int>(forces_.size()) != nv())
    bad_value("forces", forces_.size(), "one for each freedom");
  for (std::size_t i = 0; i < forces_.size(); ++i) {
    JointForce& f = forces_[i];
    if (std::isnan(f.stiction)) f.stiction = f.coulomb;
    const std::string at = "[" + std::to_string(i) + "]";
    non_negative("stiffness" + at, f.stiffness);
    non_negative("damping" + at, f.damping);
    non_negative("limit_stiffness" + at, f.limit_stiffness);
    non_negative("limit_damping" + at, f.limit_damping);
    non_negative("coulomb" + at, f.coulomb);
    non_negative("reflected_inertia" + at, f.reflected_inertia);
    if (!(f.torque_limit > 0.0)) bad_value("torque_limit" + at, f.torque_limit, "must be positive, in N m or N");
    if (!(f.stiction >= f.coulomb && std::isfinite(f.stiction)))
      bad_value("stiction" + at, f.stiction, "must be finite, and at least coulomb");
    if (!std::isfinite(f.rest)) bad_value("rest" + at, f.rest, "must be finite");
    if (!(f.lower < f.upper)) bad_value("lower" + at, f.lower, "must be below upper");
    const bool stops = std::isfinite(f.lower) || std::isfinite(f.upper);
    if (stops && !(f.limit_stiffness > 0.0))
      bad_value("limit_stiffness" + at, f.limit_stiffness, "must be positive where there is a limit");
  }
  if (ball_ && !forces_.empty()) check_ball_forces();
  check_placement("inboard", inboard_);
  check_placement("outboard", outboard_);
}

void Joint::check_ball_forces() const {
  const JointForce& first = forces_[motions_.size()];
  for (std::size_t i = motions_.size(); i < forces_.size(); ++i) {
    const JointForce& f = forces_[i];
    const std::string at = "[" + std::to_string(i) + "]";
    if (f.stiction > 0.0)
      bad_value("coulomb" + at, f.coulomb, "a ball has no dry friction; use three rotations (Axes)");
    if (std::isfinite(f.torque_limit))
      bad_value("torque_limit" + at, f.torque_limit, "a ball has no motor; use three rotations (Axes)");
    if (f.rest != 0.0)
      bad_value("rest" + at, f.rest, "a ball's spring is at rest where it is not turned; use outboard");
    if (std::isfinite(f.lower) && f.lower != -f.upper)
      bad_value("lower" + at, f.lower,
                "of a ball, upper is the largest angle of its turn: lower must be left out or -upper");
    if (std::isfinite(f.upper) && !(f.upper > 0.0 && f.upper < kPi))
      bad_value("upper" + at, f.upper, "of a ball, must be an angle between 0 and pi");
    if (f.stiffness != first.stiffness || f.upper != first.upper || f.limit_stiffness != first.limit_stiffness ||
        f.limit_damping != first.limit_damping)
      bad_value("stiffness" + at, f.stiffness, "spring and limits of a ball must be the same about all three axes");
  }
}

Joint Joint::fixed() { return Joint({}, false, {}); }
Joint Joint::revolute(const Eigen::Vector3d& axis) { return Joint({{true, axis}}, false, {"revolute"}); }
Joint Joint::prismatic(const Eigen::Vector3d& axis) { return Joint({{false, axis}}, false, {"prismatic"}); }

Eigen::VectorXd Joint::zero() const {
  Eigen::VectorXd q = Eigen::VectorXd::Zero(nq());
  if (ball_) q[static_cast<Eigen::Index>(motions_.size())] = 1.0;
  return q;
}

double Joint::potential(const double* q) const {
  double sum = 0.0;
  const auto add = [&](const JointForce& f, double stretch, double depth) {
    sum += 0.5 * f.stiffness * stretch * stretch + 0.5 * f.limit_stiffness * depth * depth;
  };
  for (std::size_t i = 0; i < forces_.size() && i < motions_.size(); ++i) {
    const JointForce& f = forces_[i];
    add(f, q[i] - f.rest, std::max(0.0, q[i] - f.upper) + std::max(0.0, f.lower - q[i]));
  }
  if (ball_ && !forces_.empty()) {
    const double angle = angle_of(q + motions_.size());
    const JointForce& f = forces_[motions_.size()];
    add(f, angle, std::max(0.0, angle - f.upper));
  }
  return sum;
}

}  // namespace flexarm
