#include "flexarm/kinematics.hpp"

#include "flexarm/check.hpp"
#include "lanes/single.hpp"

namespace flexarm {

void coordinate_rates(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v, Eigen::VectorXd& dq) {
  for (std::size_t n = 0; n < arm.size(); ++n) {
    const Joint& joint = arm.link(n).joint();
    const int i = arm.first_q(n), j = arm.first(n), ne = arm.link(n).ne();
    joint.rates(q.data() + i, v.data() + j, dq.data() + i);
    dq.segment(i + joint.nq(), ne) = v.segment(j + joint.nv(), ne);
  }
}

void coordinate_rate_jacobians(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                               Eigen::MatrixXd& by_q, Eigen::MatrixXd& by_v) {
  by_q.setZero();
  by_v.setZero();
  for (std::size_t n = 0; n < arm.size(); ++n) {
    const Joint& joint = arm.link(n).joint();
    const int i = arm.first_q(n), j = arm.first(n), nq = joint.nq(), nv = joint.nv(), ne = arm.link(n).ne();
    joint.rate_jacobians(q.data() + i, v.data() + j, by_q.block(i, i, nq, nq), by_v.block(i, j, nq, nv));
    by_v.block(i + nq, j + nv, ne, ne).setIdentity();
  }
}

namespace {

Pose pose(const lanes::SingleFrames& frames, const lanes::Place& place, const double* numbers, bool in_world) {
  Pose out;
  Eigen::Matrix<double, 3, 3, Eigen::RowMajor> R;
  frames->pose(frames.self(), place, numbers, in_world, out.p.data(), R.data());
  out.R = R;
  return out;
}
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
  ws.chain().move(q.data(), v.data());
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
  return e;
}

Momentum momentum(const Arm&, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  lanes::Sums sums;
  (*ws.frames)->sums(ws.frames->self(), q.data(), v.data(), sums);
  return {Eigen::Map<const Vec6<double>>(sums.momentum), sums.mass,
          Eigen::Map<const Eigen::Vector3d>(sums.moment) / sums.mass};
}

}  // namespace flexarm
