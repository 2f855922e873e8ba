// Composite-inertia method (Eq. 90): forms the joint-space mass matrix and factorises it, O(N^3).
#pragma once

#include "flexarm/inverse.hpp"

namespace flexarm {

/// Allocates CI's memory, O(nv^2), which a new Workspace lacks. Without this call, the first call below allocates it;
/// further calls allocate nothing.
void take_composite(const Arm& arm, Workspace& ws);

/// H^T Phi^T M Phi H of Eq. 90 into ws.M (nv x nv, symmetric), by composite inertias, at the workspace's state: after
/// move_arm, or forward or inverse dynamics. O(N^2).
void composite_mass_matrix(const Arm& arm, Workspace& ws);
/// The same at q (nq). Afterwards the workspace has no state for functions that continue from one.
void composite_mass_matrix(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q);

/// Accelerations from generalised forces, into ws.a; same contract as forward_dynamics_ab.
Status forward_dynamics_ci(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                           const Eigen::VectorXd& tau);

}  // namespace flexarm
