// The link: joint, rigid hub, elastic beam, rigid tip; each body may be missing (Sec. 4.2). Its velocity coordinates
// are [V; dqe].
#pragma once

#include <optional>

#include "flexarm/beam.hpp"
#include "flexarm/joint.hpp"

namespace flexarm {

struct RigidBody {
  double mass = 0.0;                                  ///< kg
  Eigen::Vector3d com = Eigen::Vector3d::Zero();      ///< centre of mass, body axes (m)
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();  ///< about the centre of mass, body axes (kg m^2)
  Eigen::Vector3d end = Eigen::Vector3d::Zero();      ///< where the next body begins, body axes (m)

  /// @throws std::invalid_argument naming the field and the value
  void check() const;
};

class Link {
 public:
  /// @throws std::invalid_argument naming the field and the value
  Link(Joint joint, std::optional<RigidBody> hub, std::optional<Beam> beam, std::optional<RigidBody> tip);

  const Joint& joint() const { return joint_; }
  const RigidBody& hub() const { return hub_; }
  const RigidBody& tip() const { return tip_; }
  const std::optional<Beam>& beam() const { return beam_; }
  int nj() const { return joint_.nv(); }
  int ne() const { return beam_ ? beam_->ne() : 0; }

  /// The slice at x metres along the beam. @throws std::invalid_argument without a beam, or outside it
  SliceTable slice_at(double x) const;

  double mass() const;

 private:
  Joint joint_;
  RigidBody hub_, tip_;
  std::optional<Beam> beam_;
};

}  // namespace flexarm
