#include "flexarm/kinematics.hpp"

#include <algorithm>
#include <cmath>

#include "arrays.hpp"
#include "flexarm/check.hpp"
#include "setup/single.hpp"
#include "space/ball.hpp"
#include "turning.hpp"

namespace flexarm {

Eigen::Matrix<double, 4, 3> ball_rate_matrix(const double* p) {
  const Eigen::Vector3d e(p[1], p[2], p[3]);
  Eigen::Matrix<double, 4, 3> E;
  E.row(0) = -0.5 * e.transpose();
  E.bottomRows<3>() = 0.5 * (p[0] * Eigen::Matrix3d::Identity() + tilde(e));
  return E;
}

Eigen::Matrix4d ball_rate_slopes(const Eigen::Vector4d& p, const Eigen::Vector3d& w) {
  Eigen::Matrix4d Q = kPull * ((1.0 - p.squaredNorm()) * Eigen::Matrix4d::Identity() - 2.0 * p * p.transpose());
  Q.block<1, 3>(0, 1) -= 0.5 * w.transpose();
  Q.block<3, 1>(1, 0) += 0.5 * w;
  Q.block<3, 3>(1, 1) -= 0.5 * tilde(w);
  return Q;
}

Eigen::Vector3d ball_turn(const Eigen::Vector4d& p0, const Eigen::Vector4d& p) {
  Eigen::Vector4d seen;  // p relative to p0, of any length
  seen << p0.dot(p), 2.0 * ball_rate_matrix(p0.data()).transpose() * p;
  return Eigen::Vector3d(BallTurn<double>(seen.data()).vector);
}

namespace {

const lanes::Layout& layout_of(const Arm& arm) { return lanes::KernelArm::of(arm).layout(); }

}  // namespace

void coordinate_rates(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v, Eigen::VectorXd& dq) {
  ::coordinate_rates(layout_of(arm), q.data(), v.data(), dq.data());
}

void coordinate_rate_jacobians(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                               Eigen::MatrixXd& by_q, Eigen::MatrixXd& by_v) {
  by_q.setZero();
  by_v.setZero();
  for_coordinates(
      layout_of(arm), [&](int i, int j, bool) { by_v(i, j) = 1.0; },
      [&](int i, int j) {
        by_q.block<4, 4>(i, i) = ball_rate_slopes(q.segment<4>(i), v.segment<3>(j));
        by_v.block<4, 3>(i, j) = ball_rate_matrix(q.data() + i);
      });
}

void displace(const Arm& arm, const Eigen::VectorXd& q0, const Eigen::VectorXd& u, Eigen::VectorXd& q) {
  ::displace(layout_of(arm), q0.data(), u.data(), q.data());
}

void displacement(const Arm& arm, const Eigen::VectorXd& q0, const Eigen::VectorXd& q, Eigen::VectorXd& u) {
  for_coordinates(
      layout_of(arm), [&](int i, int j, bool) { u[j] = q[i] - q0[i]; },
      [&](int i, int j) { u.segment<3>(j) = ball_turn(q0.segment<4>(i), q.segment<4>(i)); });
}

void displace_slopes(const Arm& arm, const Eigen::VectorXd& u, Eigen::MatrixXd& back, Eigen::MatrixXd& turn) {
  back.setIdentity();
  turn.setIdentity();
  for_coordinates(
      layout_of(arm), [](int, int, bool) {},
      [&](int, int j) {
        back.block<3, 3>(j, j) = turned_back(u.segment<3>(j));
        turn.block<3, 3>(j, j) = turn_slopes(u.segment<3>(j));
      });
}

void normalise(const Arm& arm, Eigen::VectorXd& q) { ::normalise(layout_of(arm), q.data()); }

Pose pose(const lanes::SingleFrames& frames, const lanes::Place& place, const double* numbers, bool in_world) {
  Pose out;
  Eigen::Matrix<double, 3, 3, Eigen::RowMajor> R;
  frames->pose(frames.self(), place, numbers, in_world, out.p.data(), R.data());
  out.R = R;
  return out;
}

namespace {

void jacobian(const lanes::SingleFrames& frames, const lanes::Place& place, const double* numbers, Mat6X<double>& J,
              Eigen::Index nv) {
  J.resize(6, nv);
  frames->jacobian(frames.self(), place, numbers, J.data());
}
SliceMotion motion(const lanes::SingleFrames& frames, const lanes::Place& place, const double* numbers) {
  SliceMotion m;
  frames->motion(frames.self(), place, numbers, m.velocity.data(), m.acceleration.data());
  return m;
}

}  // namespace

PlacedSlice::PlacedSlice(const Arm& arm, std::size_t link, std::optional<double> x) : link_(link) {
  if (link >= arm.size()) bad_value("link", link, "there is no such link");
  if (x)
    *this = PlacedSlice(arm, link, arm.link(link).slice_at(*x));
  else
    put(lanes::KernelArm::in_space(arm).end(link));
}

PlacedSlice::PlacedSlice(const Arm& arm, std::size_t link, const SliceTable& table) : link_(link), on_beam_(true) {
  put(lanes::KernelArm::in_space(arm).slice(arm, link, table));
}

template <class Spot>
void PlacedSlice::put(const Spot& spot) {
  on_ = spot.place.on;
  node_ = spot.place.node;
  numbers_.assign(spot.numbers.begin(), spot.numbers.end());
}

lanes::Place PlacedSlice::place() const { return {static_cast<lanes::Place::On>(on_), node_}; }

void move_arm(const Arm&, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  (*ws.frames)->place(ws.frames->self(), q.data(), v.data());
  ws.place(q, v);
}

void accelerate_arm(const Arm&, Workspace& ws, const Eigen::VectorXd& a, const Eigen::Vector3d& base) {
  (*ws.frames)->accelerate(ws.frames->self(), base.data(), a.data());
}

Pose link_pose(const Workspace& ws, std::size_t link) {
  const lanes::KernelArm::Spot& at = ws.frames->arm().origin(link);
  return pose(*ws.frames, at.place, at.numbers.data(), true);
}
Pose slice_pose(const Workspace& ws, std::size_t link) {
  const lanes::KernelArm::Spot& at = ws.frames->arm().end(link);
  return pose(*ws.frames, at.place, at.numbers.data(), true);
}
Pose slice_pose(const Workspace& ws, const PlacedSlice& at) { return pose(*ws.frames, at.place(), at.numbers(), true); }
Pose slice_in_link(const Workspace& ws, const PlacedSlice& at) {
  if (at.place().on == lanes::Place::slice) return pose(*ws.frames, at.place(), at.numbers(), false);
  const Pose link = link_pose(ws, at.link()), out = slice_pose(ws, at);
  return {link.R.transpose() * (out.p - link.p), link.R.transpose() * out.R};
}

void slice_jacobian(const Arm&, const Workspace& ws, std::size_t link, Mat6X<double>& J) {
  const lanes::KernelArm::Spot& at = ws.frames->arm().end(link);
  jacobian(*ws.frames, at.place, at.numbers.data(), J, ws.a.size());
}
void slice_jacobian(const Arm&, const Workspace& ws, const PlacedSlice& at, Mat6X<double>& J) {
  jacobian(*ws.frames, at.place(), at.numbers(), J, ws.a.size());
}

SliceMotion slice_motion(const Arm&, const Workspace& ws, std::size_t link) {
  const lanes::KernelArm::Spot& at = ws.frames->arm().end(link);
  return motion(*ws.frames, at.place, at.numbers.data());
}
SliceMotion slice_motion(const Arm&, const Workspace& ws, const PlacedSlice& at) {
  return motion(*ws.frames, at.place(), at.numbers());
}

void strut_motion(const Arm& arm, const Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                  const Eigen::VectorXd& driven, StrutMotion& out) {
  const Eigen::Index n = static_cast<Eigen::Index>(arm.struts().size());
  if (driven.size() != n) bad_value("driven", driven.size(), "must be one force for each of the arm's struts");
  out.motion.resize(3, n);
  out.jacobian.resize(arm.nv(), n);
  if (n > 0)
    (*ws.frames)->struts(ws.frames->self(), q.data(), v.data(), driven.data(), out.motion.data(), out.jacobian.data());
}

void contact_motion(const Arm& arm, const Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                    Eigen::Matrix3Xd& out) {
  out.resize(3, static_cast<Eigen::Index>(arm.contacts().size()));
  if (out.size() > 0) (*ws.frames)->contacts(ws.frames->self(), q.data(), v.data(), out.data());
}

void loop_motion(const Arm& arm, const Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                 Eigen::Matrix2Xd& out) {
  Eigen::Index rows = 0;
  for (const Loop& loop : arm.loops()) rows += static_cast<Eigen::Index>(loop.rows().size());
  out.resize(2, rows);
  if (rows > 0) (*ws.frames)->loops(ws.frames->self(), q.data(), v.data(), out.data());
}

Energy energy(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  lanes::Sums sums;
  (*ws.frames)->sums(ws.frames->self(), q.data(), v.data(), sums);
  Energy e{sums.kinetic, -arm.gravity().dot(Eigen::Map<const Eigen::Vector3d>(sums.moment))};
  for (std::size_t n = 0; n < arm.size(); ++n) {
    const Link& link = arm.link(n);
    e.potential += link.joint().potential(q.data() + arm.first_q(n));
    if (!link.beam()) continue;
    const auto qe = q.segment(arm.first_q(n) + link.joint().nq(), link.ne());
    e.potential += 0.5 * qe.dot(link.beam()->stiffness().lazyProduct(qe));
  }
  Eigen::Matrix3Xd touching;
  contact_motion(arm, ws, q, v, touching);
  for (Eigen::Index k = 0; k < touching.cols(); ++k) {
    const Contact& contact = arm.contacts()[static_cast<std::size_t>(k)];
    const double depth = std::max(0.0, -touching(0, k)), power = contact.exponent + 1.0;
    e.potential += contact.stiffness * std::pow(depth, power) / power;
  }
  Eigen::Matrix2Xd gaps;
  loop_motion(arm, ws, q, v, gaps);
  Eigen::Index row = 0;
  for (const Loop& loop : arm.loops())
    for (const Loop::Row& r : loop.rows()) {
      const double g = gaps(0, row++), stiffness = loop.stiffness_of(r);
      if (std::isfinite(stiffness)) e.potential += 0.5 * stiffness * g * g;
    }
  if (arm.struts().empty()) return e;
  StrutMotion lines;
  strut_motion(arm, ws, q, v, Eigen::VectorXd::Zero(static_cast<Eigen::Index>(arm.struts().size())), lines);
  for (std::size_t k = 0; k < arm.struts().size(); ++k) {
    const Strut& strut = arm.struts()[k];
    const double depth = lines.motion(0, static_cast<Eigen::Index>(k)) - strut.length;
    if (depth > 0.0 || !strut.tension_only) e.potential += 0.5 * strut.stiffness * depth * depth;
  }
  return e;
}

Momentum momentum(const Arm&, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  lanes::Sums sums;
  (*ws.frames)->sums(ws.frames->self(), q.data(), v.data(), sums);
  return {Eigen::Map<const Vec6<double>>(sums.momentum), sums.mass,
          Eigen::Map<const Eigen::Vector3d>(sums.moment) / sums.mass};
}

}  // namespace flexarm
