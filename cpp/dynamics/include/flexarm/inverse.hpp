// Inverse dynamics: tau = M(q) a + h(q, v), by one sweep outward and one inward. No factorisation.
#pragma once

#include "flexarm/kinematics.hpp"

namespace flexarm {

/// Generalised forces for given accelerations, into ws.tau. h holds gravity, elastic and damping forces.
/// O(N).
/// @param q, v, a coordinates (rad, m), rates and accelerations, length nv
/// @param with_masses  leaves each link's own mass matrix (Eq. 80) in its M, for little
template <class S>
void inverse_dynamics(const Arm& arm, SweepWorkspace<S>& ws, const VecX<S>& q, const VecX<S>& v, const VecX<S>& a,
                      bool with_masses = false);

/// Its inward half alone: the forces of a motion whose accelerations are in the workspace already, after
/// forward_dynamics_ab or accelerate_arm.
template <class S>
void joint_forces(const Arm& arm, SweepWorkspace<S>& ws, const VecX<S>& a, bool with_masses = false);

/// The same of one workspace, on the kernel where that knows the arm.
void inverse_dynamics(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                      const Eigen::VectorXd& a, bool with_masses = false);
/// Inverse dynamics where the workspace is: after move_arm, forward or inverse dynamics at q and v. Without feedback.
void joint_forces(const Arm& arm, Workspace& ws, const Eigen::VectorXd& a);

}  // namespace flexarm
