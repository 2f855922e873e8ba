// Joints (Sec. 4.1): a sequence of elementary motions, with a ball (unit quaternion) at the end if singularities must
// be avoided. A joint is data; the kernel moves it.
#pragma once

#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "flexarm/spatial.hpp"

namespace flexarm {

/// One elementary motion: a translation along, or a rotation about, an axis of the frame after the motions before it.
struct ElementaryMotion {
  bool rotation;
  Eigen::Vector3d axis;  ///< unit vector
};

/// A place on one side of a joint.
struct Placement {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
};

/// Passive force of one joint coordinate: spring, damper and soft stops. A ball's three are alike but for damping: the
/// spring acts on the whole rotation, and `upper` is the largest angle of that.
struct JointForce {
  double stiffness = 0.0, rest = 0.0, damping = 0.0;
  double lower = -std::numeric_limits<double>::infinity(), upper = std::numeric_limits<double>::infinity();
  double limit_stiffness = 0.0, limit_damping = 0.0;
  double coulomb = 0.0;  ///< Coulomb friction (friction.hpp): sliding
  /// The largest force when sticking, at least `coulomb`; not a number: equal to `coulomb`.
  double stiction = std::numeric_limits<double>::quiet_NaN();
  double reflected_inertia = 0.0;  ///< of the rotor, seen at the joint: gear ratio squared times its own
  /// Of the motor: the largest force of drives and controllers together (AppliedLimit).
  double torque_limit = std::numeric_limits<double>::infinity();
};

class Joint {
 public:
  /// @param motions  at most six freedoms together with the ball's three
  /// @param ball     whether a ball follows them: four coordinates (unit quaternion w x y z), three rates (angular
  ///                 velocity in link axes)
  /// @param labels   one for each rate
  /// @param forces   one for each rate, or none
  /// @throws std::invalid_argument naming the field and the value
  Joint(std::vector<ElementaryMotion> motions, bool ball, std::vector<std::string> labels,
        std::vector<JointForce> forces = {}, const Placement& inboard = {}, const Placement& outboard = {});

  static Joint fixed();
  static Joint revolute(const Eigen::Vector3d& axis);
  static Joint prismatic(const Eigen::Vector3d& axis);

  int nq() const { return nv() + (ball_ ? 1 : 0); }
  int nv() const { return static_cast<int>(motions_.size()) + (ball_ ? 3 : 0); }
  bool has_ball() const { return ball_; }
  const std::vector<std::string>& labels() const { return labels_; }
  const std::vector<ElementaryMotion>& motions() const { return motions_; }
  const Placement& inboard() const { return inboard_; }
  const Placement& outboard() const { return outboard_; }

  /// The zero position (a ball's: the unit quaternion 1 0 0 0).
  Eigen::VectorXd zero() const;

  bool passive() const { return !forces_.empty(); }
  /// One for each rate, or none.
  const std::vector<JointForce>& forces() const { return forces_; }
  /// Potential energy of springs and stops.
  double potential(const double* q) const;

 private:
  void check_ball_forces() const;

  std::vector<ElementaryMotion> motions_;
  bool ball_;
  std::vector<std::string> labels_;
  std::vector<JointForce> forces_;
  Placement inboard_, outboard_;
};

}  // namespace flexarm
