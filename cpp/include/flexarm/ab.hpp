// Articulated-body method (Eq. 92-96): O(N), and keeps its digits on long or badly scaled chains.
#pragma once

#include "flexarm/inverse.hpp"

namespace flexarm {

/// Accelerations from generalised forces, into ws.a; tau (length nv) is ignored where ws.prescribed.
/// @return Status::singular when a coordinate has no inertia; ws.a is then undefined
Status forward_dynamics_ab(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                           const Eigen::VectorXd& tau);

/// The method of choice.
inline Status forward_dynamics(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                               const Eigen::VectorXd& tau) {
  return forward_dynamics_ab(arm, ws, q, v, tau);
}

}  // namespace flexarm
