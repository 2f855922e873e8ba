// Composite-inertia method (Eq. 90): forms the joint-space mass matrix and factorises it, O(N^3).
#pragma once

#include "flexarm/inverse.hpp"

namespace flexarm {

/// H^T Phi^T M Phi H of Eq. 90 into ws.M (nv x nv, symmetric), by composite inertias; after move_arm.
void composite_mass_matrix(const Arm& arm, Workspace& ws);

/// Accelerations from generalised forces, into ws.a; same contract as forward_dynamics_ab.
Status forward_dynamics_ci(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                           const Eigen::VectorXd& tau);

}  // namespace flexarm
