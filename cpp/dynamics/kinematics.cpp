#include "flexarm/kinematics.hpp"

#include <cmath>

#include "flexarm/check.hpp"
#include "lanes/single.hpp"

namespace flexarm {

template <class S>
void move_arm(const Arm& arm, SweepWorkspace<S>& ws, const VecX<S>& q, const VecX<S>& v) {
  for (std::size_t n = 0; n < arm.size(); ++n) {
    const Link& link = arm.link(n);
    LinkState<S>& s = ws.links[n];
    const Joint& joint = link.joint();
    const S *qj = q.data() + arm.first_q(n), *vj = v.data() + arm.first(n);
    joint.move(qj, vj, s.joint);
    s.H = s.joint.H;
    if (joint.passive())
      for (int k = 0; k < joint.nv(); ++k) s.resistance[k] = joint.resistance(k, qj, vj);
    s.qe = q.segment(arm.first_q(n) + joint.nq(), link.ne());
    s.dqe = v.segment(arm.first(n) + joint.nv(), link.ne());
    link.move(s);

    // V_n = Phi V_{n-1} + Phi_e dqe_{n-1} + H dq (Eq. 82, 85); N_n: the same with accelerations left out (Eq.
    // 83, 86)
    if (n == 0) {
      s.phi.R = s.joint.R;
      s.phi.r = s.joint.p;
      s.V = s.joint.V;
      s.N = s.joint.c;
      s.g = s.phi.R.transpose() * arm.gravity().template cast<S>();
      s.attitude = s.phi.R;
      continue;
    }
    LinkState<S>& below = ws.links[n - 1];
    s.sit_on(below);
    const Mat3<S> Rt = s.phi.R.transpose();
    s.g = Rt * below.g;
    if (!ws.loads.empty()) s.attitude = below.attitude * s.phi.R;
    const Vec6<S> carried = s.phi.outward(below.V);
    s.V = carried + s.joint.V;
    for (Eigen::Index k = 0; k < s.phi_e.cols(); ++k) s.V += s.phi_e.col(k) * below.dqe[k];

    Vec3<S> a, dw;
    slice_acceleration<S>(below.seat, below.V, Vec6<S>::Zero(), nullptr, a, dw);
    const Vec3<S> v_rel = s.joint.V.template head<3>(), w_rel = s.joint.V.template tail<3>();
    const Vec3<S> w = s.V.template tail<3>() - w_rel;
    s.N.template head<3>() = Rt * a + 2.0 * w.cross(v_rel);
    s.N.template tail<3>() = Rt * dw + w.cross(w_rel);
    s.N += s.joint.c;
  }
}
template void move_arm<double>(const Arm&, SweepWorkspace<double>&, const VecX<double>&, const VecX<double>&);
template void move_arm<Tangent>(const Arm&, SweepWorkspace<Tangent>&, const VecX<Tangent>&, const VecX<Tangent>&);

template <class S>
void subtract_loads(const Arm& arm, SweepWorkspace<S>& ws, std::size_t link, Vec6<S>& F, VecX<S>& Fe) {
  for (AppliedLoad<S>& applied : ws.loads) {
    if (applied.load.link != link) continue;
    const LinkState<S>& s = ws.links[link];
    const auto act = [&](const Slice<S>& at, double weight) {
      const Mat3<S> R = applied.load.world_axes ? Mat3<S>(s.attitude.transpose()) : at.R;
      const Vec6<S> W = (weight * applied.wrench).template cast<S>();
      const Vec3<S> f = R * W.template head<3>(), m = R * W.template tail<3>();
      F.template head<3>() -= f;
      F.template tail<3>() -= at.x.cross(f) + m;
      for (Eigen::Index k = 0; k < at.J.cols(); ++k)
        Fe[k] -= at.J.col(k).template head<3>().dot(f) + at.J.col(k).template tail<3>().dot(m);
    };
    if (applied.load.points.empty()) act(s.end, 1.0);
    for (const Load::Point& point : applied.load.points) {
      arm.link(link).move_slice(point.slice, s, true, applied.slice);
      act(applied.slice, point.weight);
    }
  }
}
template void subtract_loads<double>(const Arm&, SweepWorkspace<double>&, std::size_t, Vec6<double>&, VecX<double>&);
template void subtract_loads<Tangent>(const Arm&, SweepWorkspace<Tangent>&, std::size_t, Vec6<Tangent>&,
                                      VecX<Tangent>&);

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

template <class S>
void accelerate_arm(const Arm& arm, SweepWorkspace<S>& ws, const VecX<S>& a, const Eigen::Vector3d& base) {
  // A = Phi A- + Phi_e ddqe- + H ddq + N (Eq. 86)
  for (std::size_t n = 0; n < arm.size(); ++n) {
    LinkState<S>& s = ws.links[n];
    const int j = arm.first(n);
    Vec6<S> A;
    if (n == 0) {
      Vec6<S> world = Vec6<S>::Zero();
      world.template head<3>() = base.template cast<S>();
      A = s.phi.outward(world);
    } else {
      A = s.phi.outward(ws.links[n - 1].A);
      for (Eigen::Index k = 0; k < s.phi_e.cols(); ++k) A += s.phi_e.col(k) * a[j - s.phi_e.cols() + k];
    }
    for (Eigen::Index k = 0; k < s.H.cols(); ++k) A += s.H.col(k) * a[j + k];
    s.A = A + s.N;
  }
}

template <class S>
Pose<S> link_pose(const SweepWorkspace<S>& ws, std::size_t link) {
  Pose<S> pose;
  for (std::size_t n = 0; n <= link; ++n) {
    pose.p += pose.R * ws.links[n].phi.r;
    pose.R = (pose.R * ws.links[n].phi.R).eval();
  }
  return pose;
}

template <class S>
Pose<S> slice_pose(const SweepWorkspace<S>& ws, std::size_t link, const Slice<S>& slice) {
  Pose<S> pose = link_pose(ws, link);
  pose.p += pose.R * slice.x;
  pose.R = (pose.R * slice.R).eval();
  return pose;
}

namespace {

/// [linear; angular] from link axes into world axes.
template <class S, class Column>
void turn_out(const Mat3<S>& R, Column&& x) {
  const Vec3<S> linear = R * x.template head<3>(), angular = R * x.template tail<3>();
  x.template head<3>() = linear;
  x.template tail<3>() = angular;
}

}  // namespace

template <class S>
void slice_jacobian(const Arm& arm, const SweepWorkspace<S>& ws, std::size_t link, const Slice<S>& slice, Mat6X<S>& J) {
  J.setZero(6, arm.nv());
  int used = 0;  // columns of the links passed so far
  for (std::size_t n = 0; n <= link; ++n) {
    const LinkState<S>& s = ws.links[n];
    for (int k = 0; k < used; ++k) J.col(k) = s.phi.outward(J.col(k));
    const auto ne_below = s.phi_e.cols();
    J.middleCols(used - ne_below, ne_below) = s.phi_e;
    J.middleCols(used, s.H.cols()) = s.H;
    used += static_cast<int>(s.H.cols() + s.qe.size());
  }
  const Eigen::Index ne = slice.J.cols();
  const Mat3<S> R = link_pose(ws, link).R;
  for (int k = 0; k < used; ++k) {
    J.col(k).template head<3>() += J.col(k).template tail<3>().cross(slice.x);
    if (k >= used - ne) J.col(k) = slice.J.col(k - (used - ne));
    turn_out(R, J.col(k));
  }
}

template <class S>
SliceMotion<S> slice_motion(const Arm& arm, const SweepWorkspace<S>& ws, std::size_t link, const Slice<S>& slice,
                            const VecX<S>& a) {
  const LinkState<S>& s = ws.links[link];
  const Mat3<S> R = link_pose(ws, link).R;
  SliceMotion<S> m;
  const Vec3<S> w = s.V.template tail<3>();
  m.velocity.template head<3>() = s.V.template head<3>() + w.cross(slice.x) + slice.u_dot;
  m.velocity.template tail<3>() = w + slice.Omega;
  Vec3<S> linear, angular;
  slice_acceleration(slice, s.V, s.A, a.data() + arm.first(link) + s.H.cols(), linear, angular);
  m.acceleration << linear, angular;
  turn_out(R, m.velocity);
  turn_out(R, m.acceleration);
  return m;
}

#define FLEXARM_INSTANTIATE(S)                                                                                    \
  template void accelerate_arm<S>(const Arm&, SweepWorkspace<S>&, const VecX<S>&, const Eigen::Vector3d&);        \
  template Pose<S> link_pose<S>(const SweepWorkspace<S>&, std::size_t);                                           \
  template Pose<S> slice_pose<S>(const SweepWorkspace<S>&, std::size_t, const Slice<S>&);                         \
  template void slice_jacobian<S>(const Arm&, const SweepWorkspace<S>&, std::size_t, const Slice<S>&, Mat6X<S>&); \
  template SliceMotion<S> slice_motion<S>(const Arm&, const SweepWorkspace<S>&, std::size_t, const Slice<S>&,     \
                                          const VecX<S>&);
FLEXARM_INSTANTIATE(double)
FLEXARM_INSTANTIATE(Tangent)

// --- On the kernels; the lines with `!ws.frames` are for arms that these do not know. ---

namespace {

const Slice<double>& slice_of(const Workspace& ws, const PlacedSlice& at) {
  if (!at.table()) return ws.links[at.link()].end;
  at.of().move_slice(*at.table(), ws.links[at.link()], true, at.scratch());
  return at.scratch();
}

Energy energy_on_eigen(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  move_arm(arm, ws, q, v);
  Energy e{0.0, 0.0};
  for (std::size_t n = 0; n < arm.size(); ++n) {
    const Link& link = arm.link(n);
    LinkState<double>& s = ws.links[n];
    link.mass_matrix(s);
    const Eigen::Index ne = link.ne();
    s.Fe.noalias() = 0.5 * s.M.bottomRightCorner(ne, ne) * s.dqe;  // scratch, so that nothing is allocated
    s.Fe.noalias() += s.M.bottomLeftCorner(ne, 6) * s.V;
    e.kinetic += 0.5 * s.V.dot(s.M.topLeftCorner<6, 6>() * s.V) + s.dqe.dot(s.Fe);
    if (link.joint().passive())
      for (int k = 0; k < link.nj(); ++k)
        e.kinetic += 0.5 * link.joint().forces()[k].reflected_inertia * std::pow(v[arm.first(n) + k], 2);
    e.potential += link.joint().potential(q.data() + arm.first_q(n));
    if (link.beam()) {
      s.Fe.noalias() = link.beam()->stiffness() * s.qe;
      e.potential += 0.5 * s.qe.dot(s.Fe);
    }
    const Pose<double> pose = link_pose<double>(ws, n);
    e.potential -= arm.gravity().dot(link.mass() * pose.p + pose.R * link.mass_moment(s));
  }
  return e;
}

Momentum momentum_on_eigen(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  move_arm(arm, ws, q, v);
  Momentum sum{Vec6<double>::Zero(), 0.0, Eigen::Vector3d::Zero()};
  for (std::size_t n = 0; n < arm.size(); ++n) {
    const Link& link = arm.link(n);
    LinkState<double>& s = ws.links[n];
    link.mass_matrix(s);
    Vec6<double> P = s.M.topLeftCorner<6, 6>() * s.V;  // of the link, about its origin: the six rigid rows of Eq. 80
    P.noalias() += s.M.topRightCorner(6, link.ne()) * s.dqe;
    const Pose<double> pose = link_pose<double>(ws, n);
    turn_out(pose.R, P);
    P.tail<3>() += pose.p.cross(P.head<3>());
    sum.momentum += P;
    sum.mass += link.mass();
    sum.centre_of_mass += link.mass() * pose.p + pose.R * link.mass_moment(s);
  }
  sum.centre_of_mass /= sum.mass;
  return sum;
}

Pose<double> pose(const lanes::SingleFrames& frames, const lanes::Place& place, const double* numbers, bool in_world) {
  Pose<double> out;
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
SliceMotion<double> motion(const lanes::SingleFrames& frames, const lanes::Place& place, const double* numbers) {
  SliceMotion<double> m;
  frames->motion(frames.self(), place, numbers, m.velocity.data(), m.acceleration.data());
  return m;
}

}  // namespace

PlacedSlice::PlacedSlice(const Arm& arm, std::size_t link, std::optional<double> x) : link_(link) {
  if (link >= arm.size()) bad_value("link", link, "there is no such link");
  of_ = &arm.link(link);
  if (x) {
    *this = PlacedSlice(arm, link, of_->slice_at(*x));
  } else if (const lanes::KernelArm* known = lanes::KernelArm::in_space(arm)) {
    const lanes::KernelArm::Spot spot = known->end(link);
    on_ = spot.place.on;
    node_ = spot.place.node;
    numbers_.assign(spot.numbers.begin(), spot.numbers.end());
  }
}

PlacedSlice::PlacedSlice(const Arm& arm, std::size_t link, const SliceTable& table)
    : link_(link), table_(table), of_(&arm.link(link)), scratch_(of_->ne()) {
  if (const lanes::KernelArm* known = lanes::KernelArm::in_space(arm)) {
    const lanes::KernelArm::Spot spot = known->slice(arm, link, table);
    on_ = spot.place.on;
    node_ = spot.place.node;
    numbers_.assign(spot.numbers.begin(), spot.numbers.end());
  }
}

lanes::Place PlacedSlice::place() const { return {static_cast<lanes::Place::On>(on_), node_}; }

void move_arm(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  if (ws.frames) (*ws.frames)->place(ws.frames->self(), q.data(), v.data());
  if (ws.fast)
    ws.kernels().move(q.data(), v.data());
  else
    move_arm<double>(arm, ws, q, v);
}

void accelerate_arm(const Arm& arm, Workspace& ws, const Eigen::VectorXd& a, const Eigen::Vector3d& base) {
  if (ws.frames) return (*ws.frames)->accelerate(ws.frames->self(), base.data(), a.data());
  ws.placed_a = a;
  accelerate_arm<double>(arm, ws, a, base);
}

Pose<double> link_pose(const Workspace& ws, std::size_t link) {
  if (!ws.frames) return link_pose<double>(ws, link);
  const lanes::KernelArm::Spot& at = ws.frames->arm().origin(link);
  return pose(*ws.frames, at.place, at.numbers.data(), true);
}
Pose<double> slice_pose(const Workspace& ws, std::size_t link) {
  if (!ws.frames) return slice_pose<double>(ws, link, ws.links[link].end);
  const lanes::KernelArm::Spot& at = ws.frames->arm().end(link);
  return pose(*ws.frames, at.place, at.numbers.data(), true);
}
Pose<double> slice_pose(const Workspace& ws, const PlacedSlice& at) {
  if (!ws.frames) return slice_pose<double>(ws, at.link(), slice_of(ws, at));
  return pose(*ws.frames, at.place(), at.numbers(), true);
}
Pose<double> slice_in_link(const Workspace& ws, const PlacedSlice& at) {
  if (!ws.frames) {
    const Slice<double>& slice = slice_of(ws, at);
    return {slice.x, slice.R};
  }
  if (at.place().on == lanes::Place::slice) return pose(*ws.frames, at.place(), at.numbers(), false);
  const Pose<double> link = link_pose(ws, at.link()), out = slice_pose(ws, at);
  return {link.R.transpose() * (out.p - link.p), link.R.transpose() * out.R};
}

void slice_jacobian(const Arm& arm, const Workspace& ws, std::size_t link, Mat6X<double>& J) {
  if (!ws.frames) return slice_jacobian<double>(arm, ws, link, ws.links[link].end, J);
  const lanes::KernelArm::Spot& at = ws.frames->arm().end(link);
  jacobian(*ws.frames, at.place, at.numbers.data(), J, ws.a.size());
}
void slice_jacobian(const Arm& arm, const Workspace& ws, const PlacedSlice& at, Mat6X<double>& J) {
  if (!ws.frames) return slice_jacobian<double>(arm, ws, at.link(), slice_of(ws, at), J);
  jacobian(*ws.frames, at.place(), at.numbers(), J, ws.a.size());
}

SliceMotion<double> slice_motion(const Arm& arm, const Workspace& ws, std::size_t link) {
  if (!ws.frames) return slice_motion<double>(arm, ws, link, ws.links[link].end, ws.placed_a);
  const lanes::KernelArm::Spot& at = ws.frames->arm().end(link);
  return motion(*ws.frames, at.place, at.numbers.data());
}
SliceMotion<double> slice_motion(const Arm& arm, const Workspace& ws, const PlacedSlice& at) {
  if (!ws.frames) return slice_motion<double>(arm, ws, at.link(), slice_of(ws, at), ws.placed_a);
  return motion(*ws.frames, at.place(), at.numbers());
}

Energy energy(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  if (!ws.frames) return energy_on_eigen(arm, ws, q, v);
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

Momentum momentum(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  if (!ws.frames) return momentum_on_eigen(arm, ws, q, v);
  lanes::Sums sums;
  (*ws.frames)->sums(ws.frames->self(), q.data(), v.data(), sums);
  return {Eigen::Map<const Vec6<double>>(sums.momentum), sums.mass,
          Eigen::Map<const Eigen::Vector3d>(sums.moment) / sums.mass};
}

}  // namespace flexarm
