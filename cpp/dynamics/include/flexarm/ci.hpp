// Composite-inertia method (Eq. 90): forms the joint-space mass matrix and factorises it, O(N^3).
#pragma once

#include "flexarm/inverse.hpp"

namespace flexarm {

/// Takes CI's memory, O(nv^2), which a Workspace does not begin with. Without it, the first call of the following takes
/// what it needs; further calls allocate nothing.
void take_composite(const Arm& arm, Workspace& ws);

/// H^T Phi^T M Phi H of Eq. 90 into ws.M (nv x nv, symmetric), by composite inertias, where the workspace is: after
/// move_arm, or forward or inverse dynamics. O(N^2).
void composite_mass_matrix(const Arm& arm, Workspace& ws);
/// The same at q (nq), which leaves the workspace nowhere: nothing but this goes on from there.
void composite_mass_matrix(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q);

/// Accelerations from generalised forces, into ws.a; same contract as forward_dynamics_ab.
Status forward_dynamics_ci(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                           const Eigen::VectorXd& tau);

}  // namespace flexarm
