// Outward sweep of positions and velocities, and what follows from it alone: frames, Jacobians, energy.
#pragma once

#include <optional>

#include "flexarm/workspace.hpp"

namespace flexarm {

/// Moves every slice; fills phi, phi_e, H, V and N of every link (Eq. 68, 69, 73-75, 82, 83, 85). q, v:
/// length nv.
template <class S>
void move_arm(const Arm& arm, SweepWorkspace<S>& ws, const VecX<S>& q, const VecX<S>& v);

/// Places the arm: all its frames at q, moving at v.
void move_arm(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v);

/// Takes the workspace's loads on a link off its force F and elastic forces Fe, by the transposed Jacobians of the
/// slices they act on (Eq. 53); after move_arm.
template <class S>
void subtract_loads(const Arm& arm, SweepWorkspace<S>& ws, std::size_t link, Vec6<S>& F, VecX<S>& Fe);

/// Rates of the coordinates, dq/dt = E(q) v, length nq; the same as v without balls.
void coordinate_rates(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v, Eigen::VectorXd& dq);
/// Their Jacobians by q (nq x nq) and v (nq x nv).
void coordinate_rate_jacobians(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                               Eigen::MatrixXd& by_q, Eigen::MatrixXd& by_v);

/// Accelerations of every link, into s.A, for given coordinate accelerations and that of the base in world axes (Eq.
/// 86); after move_arm. A base that accelerates against gravity stands for gravity.
template <class S>
void accelerate_arm(const Arm& arm, SweepWorkspace<S>& ws, const VecX<S>& a, const Eigen::Vector3d& base);

/// The same of all frames; after move_arm.
void accelerate_arm(const Arm& arm, Workspace& ws, const Eigen::VectorXd& a,
                    const Eigen::Vector3d& base = Eigen::Vector3d::Zero());

namespace lanes {
struct Place;
}

/// A place on an arm, made at set-up: a slice of a beam, or a link's end, where the next joint sits.
class PlacedSlice {
 public:
  /// @param x  metres along the link's beam, or nothing for the link's end
  /// @throws std::invalid_argument where there is no such place
  PlacedSlice(const Arm& arm, std::size_t link, std::optional<double> x = {});
  PlacedSlice(const Arm& arm, std::size_t link, const SliceTable& table);

  std::size_t link() const { return link_; }
  // as the kernels know it
  lanes::Place place() const;
  const double* numbers() const { return numbers_.data(); }
  // as Eigen's path knows it
  const std::optional<SliceTable>& table() const { return table_; }
  const Link& of() const { return *of_; }
  Slice<double>& scratch() const { return scratch_; }

 private:
  std::size_t link_;
  int on_ = 0, node_ = 0;
  std::vector<double> numbers_;
  std::optional<SliceTable> table_;
  const Link* of_;
  mutable Slice<double> scratch_;
};

template <class S>
struct Pose {
  Vec3<S> p = Vec3<S>::Zero();      ///< world axes (m)
  Mat3<S> R = Mat3<S>::Identity();  ///< columns: the frame's axes in world axes
};

/// Pose in the world of a link's own frame, after move_arm.
template <class S>
Pose<S> link_pose(const SweepWorkspace<S>& ws, std::size_t link);
/// Pose in the world of a slice (in link axes) of a link, after move_arm.
template <class S>
Pose<S> slice_pose(const SweepWorkspace<S>& ws, std::size_t link, const Slice<S>& slice);
/// The same of a link's own frame, of its end, and of any place; after move_arm.
Pose<double> link_pose(const Workspace& ws, std::size_t link);
Pose<double> slice_pose(const Workspace& ws, std::size_t link);
Pose<double> slice_pose(const Workspace& ws, const PlacedSlice& at);
/// A slice's pose in the axes of its link.
Pose<double> slice_in_link(const Workspace& ws, const PlacedSlice& at);

/// Jacobian of such a slice into J: 6 x nv, [linear; angular], world axes (Eq. 91: Phi H). A J of that size already is
/// not allocated anew.
template <class S>
void slice_jacobian(const Arm& arm, const SweepWorkspace<S>& ws, std::size_t link, const Slice<S>& slice, Mat6X<S>& J);
/// The same, allocated.
template <class S>
Mat6X<S> slice_jacobian(const Arm& arm, const SweepWorkspace<S>& ws, std::size_t link, const Slice<S>& slice) {
  Mat6X<S> J;
  slice_jacobian(arm, ws, link, slice, J);
  return J;
}

/// The same of a link's end, and of any place.
void slice_jacobian(const Arm& arm, const Workspace& ws, std::size_t link, Mat6X<double>& J);
void slice_jacobian(const Arm& arm, const Workspace& ws, const PlacedSlice& at, Mat6X<double>& J);

/// Velocity and acceleration [linear; angular] of a slice, world axes (Eq. 85, 86).
template <class S>
struct SliceMotion {
  Vec6<S> velocity, acceleration;
};
/// After move_arm and accelerate_arm with the same a.
template <class S>
SliceMotion<S> slice_motion(const Arm& arm, const SweepWorkspace<S>& ws, std::size_t link, const Slice<S>& slice,
                            const VecX<S>& a);

/// The same of a link's end, and of any place; after move_arm and accelerate_arm.
SliceMotion<double> slice_motion(const Arm& arm, const Workspace& ws, std::size_t link);
SliceMotion<double> slice_motion(const Arm& arm, const Workspace& ws, const PlacedSlice& at);

struct Energy {
  double kinetic;    ///< J
  double potential;  ///< elastic, less sum of m g . p from the world's origin (J)
};
Energy energy(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v);

/// Of the whole arm, world axes.
struct Momentum {
  Vec6<double> momentum;           ///< [linear (kg m/s); angular about the world's origin (kg m^2/s)]
  double mass;                     ///< kg
  Eigen::Vector3d centre_of_mass;  ///< m; not a number without mass
};
Momentum momentum(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v);

}  // namespace flexarm
