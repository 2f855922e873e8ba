// The link: joint, rigid hub, elastic beam, rigid tip; each body may be missing (Sec. 4.2). Its velocity
// coordinates are [V; dqe]; a solver asks it for its mass matrix (Eq. 80) and its inertial force (Eq. 81) and
// never looks inside.
#pragma once

#include <Eigen/Cholesky>
#include <optional>
#include <vector>

#include "flexarm/beam.hpp"
#include "flexarm/joint.hpp"

namespace flexarm {

struct RigidBody {
  double mass = 0.0;                                  ///< kg
  Eigen::Vector3d com = Eigen::Vector3d::Zero();      ///< centre of mass, body axes (m)
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();  ///< about the centre of mass, body axes (kg m^2)
  Eigen::Vector3d end = Eigen::Vector3d::Zero();      ///< where the next body begins, body axes (m)

  /// @throws std::invalid_argument naming the field and the value
  void check() const;
};

/// Numbers of one link that change. All memory is taken by the constructor.
template <class S>
struct LinkState {
  // positions and velocities
  JointMotion<S> joint;
  Series<S> series;                        ///< beyond order 2
  mutable Slice<S> slice;                  ///< a Gauss point of the beam: scratch, so that long arms stay small
  Slice<S> hub;                            ///< the hub's centre of mass, at rest in the link
  Slice<S> root, com, end;                 ///< the beam's last slice, the tip body's centre of mass, the link's end
  Slice<S> seat;                           ///< where the next link sits: `end` carried by the next joint
  Phi<S> phi;                              ///< from the link below to this one (Eq. 68)
  Mat6X<S> phi_e;                          ///< elastic part of Phi_rfr from the link below (Eq. 73, 82)
  Mat6X<S> H;                              ///< joint Jacobian, 6 x nj
  Vec6<S> V, N, A;                         ///< velocity; bias acceleration (Eq. 69, 75, 86); acceleration
  VecX<S> resistance;                      ///< of the joint: springs, dampers, stops
  VecX<S> qe, dqe;                         ///< elastic coordinates
  Vec3<S> g;                               ///< gravity in link axes
  Mat3<S> attitude = Mat3<S>::Identity();  ///< of the link in the world; kept where a load asks for it
  // forces and inertias
  Vec6<S> F;   ///< force through the joint, on the link
  VecX<S> Fe;  ///< elastic generalised forces
  MatX<S> M;   ///< M_rfr, (6 + ne)^2 (Eq. 80)

  LinkState(int nj, const Beam* beam, int ne_below);
  /// Seats the link on the one below, once both have moved: that one's `seat`, and phi and phi_e (Eq. 68, 73, 82).
  void sit_on(LinkState& below);
};

template <class S>
LinkState<S>::LinkState(int nj, const Beam* beam, int ne_below) {
  const int ne = beam ? beam->ne() : 0;
  if (beam && beam->series()) series = Series<S>(*beam->series(), ne);
  for (Slice<S>* at : {&slice, &root, &com, &end, &seat}) *at = Slice<S>(ne);
  phi_e = Mat6X<S>::Zero(6, ne_below);
  H = Mat6X<S>::Zero(6, nj);
  resistance = VecX<S>::Zero(nj);
  for (Vec6<S>* v : {&V, &N, &A, &F}) v->setZero();
  g.setZero();
  for (VecX<S>* v : {&qe, &dqe, &Fe}) *v = VecX<S>::Zero(ne);
  M = MatX<S>::Zero(6 + ne, 6 + ne);
}

template <class S>
void LinkState<S>::sit_on(LinkState& below) {
  shift_slice(below.end, joint.p, below.seat);
  below.seat.R = below.end.R * joint.R;
  const Mat3<S> Rt = below.seat.R.transpose();
  phi.R = below.seat.R;
  phi.r = below.seat.x;
  for (Eigen::Index k = 0; k < phi_e.cols(); ++k) {
    phi_e.col(k).template head<3>() = Rt * below.seat.J.col(k).template head<3>();
    phi_e.col(k).template tail<3>() = Rt * below.seat.J.col(k).template tail<3>();
  }
}

class Link {
 public:
  /// @throws std::invalid_argument naming the field and the value
  Link(Joint joint, std::optional<RigidBody> hub, std::optional<Beam> beam, std::optional<RigidBody> tip);

  const Joint& joint() const { return joint_; }
  const RigidBody& hub() const { return hub_; }
  const RigidBody& tip() const { return tip_; }
  const std::optional<Beam>& beam() const { return beam_; }
  int nj() const { return joint_.nv(); }
  int ne() const { return beam_ ? beam_->ne() : 0; }

  /// The slice at x metres along the beam. @throws std::invalid_argument without a beam, or outside it
  SliceTable slice_at(double x) const;

  /// Moves the link's end and the tip body's slice from the elastic coordinates in `s` (qe, dqe). What follows moves
  /// the beam's Gauss points one after the other, each time: that costs less than to fetch them again from memory.
  template <class S>
  void move(LinkState<S>& s) const;
  /// Moves one slice of the beam, after `move`.
  template <class S>
  void move_slice(const SliceTable& table, const LinkState<S>& s, bool orient, Slice<S>& out) const;
  /// M_rfr of Eq. 80 into s.M.
  template <class S>
  void mass_matrix(LinkState<S>& s) const;
  /// M_rfr [A; ddqe] + N_rfr (Eq. 80, 81) into F and Fe, for s.V, `A` and `ddqe` (null: zero).
  template <class S>
  void inertial_force(const LinkState<S>& s, const Vec6<S>& A, const S* ddqe, Vec6<S>& F, VecX<S>& Fe) const;
  /// Both in one pass over the slices.
  template <class S>
  void mass_matrix_and_force(LinkState<S>& s, const Vec6<S>& A, const S* ddqe, Vec6<S>& F, VecX<S>& Fe) const;
  /// Sum of mass times position, in link axes, for the energy of gravity.
  template <class S>
  Vec3<S> mass_moment(const LinkState<S>& s) const;
  double mass() const;

 private:
  /// Order 0: kinetic energy cut at first order in (qe, dqe) together, plus dqe^T Mee(0) dqe / 2.
  struct FirstOrderInertia {
    double mass = 0.0;
    Eigen::Vector3d S = Eigen::Vector3d::Zero();  ///< mass moment at rest
    Eigen::Matrix3d J = Eigen::Matrix3d::Zero();  ///< second moment at rest
    Eigen::Matrix3Xd L, C;                        ///< Mre: linear and angular rows; L is also dS/dqe
    std::vector<Eigen::Matrix3d> dJ;              ///< dJ/dqe_i
    Eigen::MatrixXd Mee;
    Eigen::Matrix3Xd tip;  ///< the tip body's part of L
  };
  void build_first_order();
  /// Order 0: mass times what the tip body's centre of mass moves beyond first order.
  template <class S>
  Vec3<S> beyond_first_order(const LinkState<S>& s) const;
  /// visit(mass, inertia about the slice's own axes, slice) for the hub, the beam's slices and the tip body.
  template <class S, class Visit>
  void for_each_body(const LinkState<S>& s, const Visit& visit) const;

  Joint joint_;
  RigidBody hub_, tip_;
  std::optional<Beam> beam_;
  std::optional<FirstOrderInertia> cut_;  ///< order 0 only
};

}  // namespace flexarm
