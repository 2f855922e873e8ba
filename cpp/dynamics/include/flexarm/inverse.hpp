// Inverse dynamics: tau = M(q) a + h(q, v), by one sweep outward and one inward (Eq. 84-87). No factorisation.
#pragma once

#include <memory>

#include "flexarm/kinematics.hpp"

namespace flexarm {

/// Generalised forces for given accelerations, into ws.tau, less those of the workspace's loads and laws. h holds
/// gravity, elastic and damping forces. O(N).
/// @param q, v, a coordinates (nq; rad, m), rates and accelerations (nv)
void inverse_dynamics(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                      const Eigen::VectorXd& a);

/// The same where the workspace is, after move_arm, forward or inverse dynamics. Without the laws.
void joint_forces(const Arm& arm, Workspace& ws, const Eigen::VectorXd& a);

/// Forces through joints. Allocates at set-up.
class JointReactions {
 public:
  explicit JointReactions(const Arm& arm, const std::vector<Load>& loads = {});
  JointReactions(JointReactions&&) noexcept;
  ~JointReactions();
  /// Value of a load from now on.
  void set_wrench(std::size_t load, const Vec6<double>& wrench);
  /// Force and moment [f; m] (N, N m) through the joint of a link, on it: at its own frame and in its axes, or
  /// (inboard) at the end of its parent.
  Vec6<double> operator()(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a,
                          std::size_t link, bool inboard);

 private:
  struct InSpace;
  std::unique_ptr<InSpace> in_space_;
};

}  // namespace flexarm
