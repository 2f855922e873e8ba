// Composite-inertia method (Eq. 90): forms the joint-space mass matrix and factorises it, O(N^3).
#pragma once

#include "flexarm/inverse.hpp"

namespace flexarm {

/// Takes CI's memory, O(nv^2), which a Workspace does not begin with. Without it, the first call of the following takes
/// what it needs; further calls allocate nothing.
void take_composite(const Arm& arm, Workspace& ws);

/// M of every link with everything above it, the links above held rigid, into its M (Eq. 80); after move_arm. O(N).
/// @param have_masses  after inverse_dynamics(..., with_masses = true)
void composite_inertias(const Arm& arm, Workspace& ws, bool have_masses = false);

/// H^T Phi^T M Phi H of Eq. 90 into ws.M (nv x nv, symmetric), by composite inertias; after move_arm.
void composite_mass_matrix(const Arm& arm, Workspace& ws, bool have_masses = false);

/// Accelerations from generalised forces, into ws.a; same contract as forward_dynamics_ab.
Status forward_dynamics_ci(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                           const Eigen::VectorXd& tau);

}  // namespace flexarm
