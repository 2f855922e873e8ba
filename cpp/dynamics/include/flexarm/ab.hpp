// Articulated-body method (Eq. 92-96): O(N), and keeps its digits on long or badly scaled chains.
#pragma once

#include "flexarm/inverse.hpp"

namespace flexarm {

/// Accelerations from generalised forces, into ws.a; tau (length nv) is ignored where ws.prescribed.
/// @return Status::singular when a coordinate has no inertia; ws.a is then undefined
Status forward_dynamics_ab(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                           const Eigen::VectorXd& tau);

/// Floating-point operations of one forward_dynamics at q, v: a beam that bends little may need fewer points.
long operation_count(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v);

/// Terms that an implicit step adds to the mass matrix.
struct Shift {
  double damping = 0.0;    ///< s
  double stiffness = 0.0;  ///< s^2
};

/// Factors S = M + shift.damping D + shift.stiffness K of the coordinates that are not prescribed, in O(N). D and K are
/// the damping and stiffness of beams and of joints (springs, dampers, the stops they touch at q, v): they are
/// block-diagonal by link, so that they cost nothing in the elimination. At the state of the last move_arm, forward or
/// inverse dynamics of the workspace. Also sets ws.twice_kinetic.
/// @return Status::singular when S is not positive definite
Status factor_shifted(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                      const Shift& shift);
/// x = S^-1 r (length nv) by the last factor_shifted, zero where prescribed; r and x are two vectors.
void solve_shifted(const Arm& arm, Workspace& ws, const Eigen::VectorXd& r, Eigen::VectorXd& x);

/// The method of choice: AB.
Status forward_dynamics(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                        const Eigen::VectorXd& tau);

}  // namespace flexarm
