// Positions, velocities and their functions: frames, Jacobians, energy, momentum.
#pragma once

#include <optional>

#include "flexarm/workspace.hpp"

namespace flexarm {

/// Places the arm, all its frames, at q (nq), moving at v (nv; Eq. 82, 83, 85).
void move_arm(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v);

/// Rates of the coordinates, dq/dt = E(q) v, length nq; the same as v without balls.
void coordinate_rates(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v, Eigen::VectorXd& dq);
/// Their Jacobians by q (nq x nq) and v (nq x nv).
void coordinate_rate_jacobians(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                               Eigen::MatrixXd& by_q, Eigen::MatrixXd& by_v);
/// q0 displaced by u (nv), rates times time, into q: the coordinates themselves, and the quaternion of a ball, which
/// turns by its part of u, a rotation vector in the axes that turn.
void displace(const Arm& arm, const Eigen::VectorXd& q0, const Eigen::VectorXd& u, Eigen::VectorXd& q);
/// The u that displaces q0 to q, with turns of balls up to pi.
void displacement(const Arm& arm, const Eigen::VectorXd& q0, const Eigen::VectorXd& q, Eigen::VectorXd& u);
/// Jacobians of the displacement at the end of u: by a small displacement of q0, back (nv x nv), and by a change of u,
/// turn (nv x nv).
void displace_slopes(const Arm& arm, const Eigen::VectorXd& u, Eigen::MatrixXd& back, Eigen::MatrixXd& turn);
/// Scales the quaternions of balls in q to unit length.
void normalise(const Arm& arm, Eigen::VectorXd& q);

/// Accelerations of all frames (Eq. 86), of coordinate accelerations a (nv) and that of the base in world axes; after
/// move_arm. A base that accelerates against gravity stands for gravity.
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
  /// Whether it is a slice of a beam, rather than a link's end.
  bool on_beam() const { return on_beam_; }
  // as the kernels know it
  lanes::Place place() const;
  const double* numbers() const { return numbers_.data(); }

 private:
  template <class Spot>
  void put(const Spot& spot);
  std::size_t link_;
  bool on_beam_ = false;
  int on_ = 0, node_ = 0;
  std::vector<double> numbers_;
};

struct Pose {
  Eigen::Vector3d p = Eigen::Vector3d::Zero();      ///< world axes (m)
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();  ///< columns: the frame's axes in world axes
};

// After move_arm:
/// Pose in the world of a link's own frame, of its end, and of any place.
Pose link_pose(const Workspace& ws, std::size_t link);
Pose slice_pose(const Workspace& ws, std::size_t link);
Pose slice_pose(const Workspace& ws, const PlacedSlice& at);
/// A slice's pose in the axes of its link.
Pose slice_in_link(const Workspace& ws, const PlacedSlice& at);

/// Jacobian of a link's end, and of any place, into J: 6 x nv, [linear; angular], world axes (Eq. 91: Phi H). A J of
/// that size already is not allocated anew.
void slice_jacobian(const Arm& arm, const Workspace& ws, std::size_t link, Mat6X<double>& J);
void slice_jacobian(const Arm& arm, const Workspace& ws, const PlacedSlice& at, Mat6X<double>& J);

/// Velocity and acceleration [linear; angular] of a slice, world axes (Eq. 85, 86).
struct SliceMotion {
  Vec6<double> velocity, acceleration;
};
/// Of a link's end, and of any place; after move_arm and accelerate_arm.
SliceMotion slice_motion(const Arm& arm, const Workspace& ws, std::size_t link);
SliceMotion slice_motion(const Arm& arm, const Workspace& ws, const PlacedSlice& at);

/// Of the arm's struts.
struct StrutMotion {
  Eigen::MatrixXd motion;  ///< length (m), rate (m/s) and force, with which it pushes (N), in rows of 3, a column each
  Eigen::MatrixXd jacobian;  ///< of the lengths: dl/dt of strut k is column k times v (nv rows)
};
/// @param driven  the forces of loads on each strut (N)
void strut_motion(const Arm& arm, const Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                  const Eigen::VectorXd& driven, StrutMotion& out);

/// Of each of the arm's contacts, a column: gap (m), its rate (m/s), and the normal force (N).
void contact_motion(const Arm& arm, const Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                    Eigen::Matrix3Xd& out);

/// Of each row of the arm's loops (Loop::rows), a column: g (m, or 1) and dg/dt.
void loop_motion(const Arm& arm, const Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                 Eigen::Matrix2Xd& out);

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
