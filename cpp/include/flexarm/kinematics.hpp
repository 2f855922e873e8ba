// Outward sweep of positions and velocities, and what follows from it alone: frames, Jacobians, energy.
#pragma once

#include "flexarm/workspace.hpp"

namespace flexarm {

/// Moves every slice; fills phi, phi_e, H, V and N of every link (Eq. 68, 69, 73-75, 82, 83, 85). q, v:
/// length nv.
template <class S>
void move_arm(const Arm& arm, SweepWorkspace<S>& ws, const VecX<S>& q, const VecX<S>& v);

/// Takes the workspace's loads on a link off its force F and elastic forces Fe, by the transposed Jacobians of the
/// slices they act on (Eq. 53); after move_arm.
template <class S>
void subtract_loads(const Arm& arm, SweepWorkspace<S>& ws, std::size_t link, Vec6<S>& F, VecX<S>& Fe);

/// Rates of the coordinates, dq/dt = E(q) v, length nq; the same as v without balls.
void coordinate_rates(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v, Eigen::VectorXd& dq);
/// Their Jacobians by q (nq x nq) and v (nq x nv).
void coordinate_rate_jacobians(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                               Eigen::MatrixXd& by_q, Eigen::MatrixXd& by_v);

struct Pose {
  Eigen::Vector3d p = Eigen::Vector3d::Zero();      ///< world axes (m)
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();  ///< columns: the frame's axes in world axes
};

/// Pose in the world of a link's own frame, after move_arm.
Pose link_pose(const Arm& arm, const Workspace& ws, std::size_t link);
/// Pose in the world of a slice (in link axes) of a link, after move_arm.
Pose slice_pose(const Arm& arm, const Workspace& ws, std::size_t link, const Slice<double>& slice);
/// Jacobian of such a slice: 6 x nv, [linear; angular], world axes (Eq. 91: Phi H).
Eigen::Matrix<double, 6, Eigen::Dynamic> slice_jacobian(const Arm& arm, const Workspace& ws, std::size_t link,
                                                        const Slice<double>& slice);

struct Energy {
  double kinetic;    ///< J
  double potential;  ///< elastic, less sum of m g . p from the world's origin (J)
};
Energy energy(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v);

}  // namespace flexarm
