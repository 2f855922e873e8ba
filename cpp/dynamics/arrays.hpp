// Dynamics on plain arrays, which the functions of vectors and the methods of steps share; lengths are the arm's.
#pragma once

#include "door/kernels.hpp"
#include "flexarm/kinematics.hpp"

namespace flexarm {

Status status_of(lanes::Outcome outcome);

/// Forward dynamics into a, which holds the prescribed ones.
Status forward(Workspace& ws, const double* q, const double* v, const double* tau, double* a);
/// Inverse dynamics into tau.
void inverse(Workspace& ws, const double* q, const double* v, const double* a, double* tau);
/// See factor_shifted, solve_shifted.
Status factor(const Arm& arm, Workspace& ws, const double* q, const double* v, const lanes::Shift& shift);
void solve(const Arm& arm, Workspace& ws, const double* r, double* x);
/// The same for a step of Newton's iteration from q and v, see FeedbackLaws::correct_within.
bool correction(const Arm& arm, Workspace& ws, const double* q, const double* v, double* r, double* x);
/// In feedback_numbers, for `limits` as they are now.
void make_room_for_limits(Workspace& ws);

/// The part of move_arm that factor_shifted and composite_mass_matrix need.
void move_chain(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v);

/// Of a run: contacts go on from this state.
void remember_contacts(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v);
/// A step notes the contacts where the dynamics were last asked, its end; if it counts, and has noted them, the run
/// remembers that. @return whether it has
void note_contacts(Workspace& ws);
bool remember_note(Workspace& ws);
/// Forces of the contacts on the arm, in the world (3 each), where the chain was moved last.
void contact_forces(Workspace& ws, double* out);

/// Takes the forces of loops off those that inverse dynamics has found, ws.tau, where the chain is. @param applied  all
/// other forces (nv) @param out  force and moment (6) of each loop on its side b, in the world
void take_loop_forces(Workspace& ws, const Eigen::VectorXd& applied, double* out);

/// Changes of the forces of joints, beams, struts and contacts by changes x of the coordinates (nv), see Kernels; after
/// `factor`.
void stiffness_times(Workspace& ws, const Eigen::VectorXd& x, Eigen::VectorXd& out);

/// E(p) of a ball's quaternion, dp/dt = E w; E^T E is a quarter of the unit matrix.
Eigen::Matrix<double, 4, 3> ball_rate_matrix(const double* p);
/// The turn of a ball from quaternion p0 to p, of any lengths: a rotation vector in the axes that turn, up to pi.
Eigen::Vector3d ball_turn(const Eigen::Vector4d& p0, const Eigen::Vector4d& p);
/// d(dp/dt)/dp of a quaternion at an angular velocity w, see `ball_rates`.
Eigen::Matrix4d ball_rate_slopes(const Eigen::Vector4d& p, const Eigen::Vector3d& w);

/// Of a place, in the world or in its node's axes.
Pose pose(const lanes::SingleFrames& frames, const lanes::Place& place, const double* numbers, bool in_world);

/// Whether every number is finite, without a branch: zero times any other is not zero.
template <class V>
bool all_finite(const Eigen::DenseBase<V>& x) {
  return (x.derived().array() * 0.0).sum() == 0.0;
}

/// Adds sign times the generalised forces of feedback at q and v, with the sum's reduction by limits.
inline void add_feedback(Workspace& ws, const Eigen::Ref<const Eigen::VectorXd>& q,
                         const Eigen::Ref<const Eigen::VectorXd>& v, double sign, Eigen::Ref<Eigen::VectorXd> tau) {
  for (const AppliedFeedback& f : ws.feedback) tau += sign * (*f.law)(f.offset, q, v) * f.law->column;
  ask(ws.limits, ws.feedback, q, v);
  for (const AppliedLimit& l : ws.limits) tau[l.rate] += sign * l.cut();
}

}  // namespace flexarm
