#include "flexarm/link.hpp"

#include <Eigen/Eigenvalues>

#include "flexarm/check.hpp"
#include "flexarm/dual.hpp"

namespace flexarm {

namespace {

/// Inertia about the slice's own axes turned into link axes; a null inertia is a null pointer.
template <class S>
Mat3<S> turned(const Slice<S>& at, const Eigen::Matrix3d& inertia) {
  const Mat3<S> RJ = at.R * inertia.template cast<S>();
  return RJ * at.R.transpose();
}

/// Adds [I, -x~, J_T; 0, I, J_R]^T diag(m, J) [same] of one slice: its part of Eq. 80 (lower triangle).
template <class S>
void add_mass_matrix(double m, const Eigen::Matrix3d* inertia, const Slice<S>& at, MatX<S>& M) {
  const Mat3<S> x = tilde(at.x);
  Mat3<S> Jw = -m * x * x;
  Mat3<S> J = Mat3<S>::Zero();
  if (inertia) {
    J = turned(at, *inertia);
    Jw += J;
  }
  M.template block<3, 3>(0, 0).diagonal().array() += S(m);
  M.template block<3, 3>(3, 0) += m * x;
  M.template block<3, 3>(3, 3) += Jw;
  const Eigen::Index ne = at.J.cols();
  for (Eigen::Index k = 0; k < ne; ++k) {
    const Vec3<S> f = m * at.J.col(k).template head<3>();
    Vec3<S> n = Vec3<S>::Zero();
    if (inertia) n = J * at.J.col(k).template tail<3>();
    M.row(6 + k).template segment<3>(0) += f.transpose();
    M.row(6 + k).template segment<3>(3) += (at.x.cross(f) + n).transpose();
    for (Eigen::Index i = k; i < ne; ++i) {
      S sum = at.J.col(i).template head<3>().dot(f);
      if (inertia) sum += at.J.col(i).template tail<3>().dot(n);
      M(6 + i, 6 + k) += sum;
    }
  }
}

/// Adds the same operator transposed, times the slice's inertial force and moment.
template <class S>
void add_force(double m, const Eigen::Matrix3d* inertia, const Slice<S>& at, const Vec6<S>& V, const Vec6<S>& A,
               const S* ddq, Vec6<S>& F, VecX<S>& Fe) {
  Vec3<S> a, dw;
  slice_acceleration(at, V, A, ddq, a, dw);
  const Vec3<S> f = m * a;
  Vec3<S> n = Vec3<S>::Zero();
  if (inertia) {
    const Mat3<S> J = turned(at, *inertia);
    const Vec3<S> w = V.template tail<3>() + at.Omega;
    const Vec3<S> h = J * w;
    n = J * dw + w.cross(h);
  }
  F.template head<3>() += f;
  F.template tail<3>() += at.x.cross(f) + n;
  for (Eigen::Index k = 0; k < at.J.cols(); ++k) {
    Fe[k] += at.J.col(k).template head<3>().dot(f);
    if (inertia) Fe[k] += at.J.col(k).template tail<3>().dot(n);
  }
}

}  // namespace

void RigidBody::check() const {
  non_negative("mass", mass);
  finite("com", com);
  finite("end", end);
  if (!inertia.allFinite()) bad_value("inertia", inertia.reshaped().transpose(), "must be finite");
  const double scale = inertia.cwiseAbs().maxCoeff();
  if ((inertia - inertia.transpose()).cwiseAbs().maxCoeff() > 1e-12 * scale)
    bad_value("inertia", inertia.reshaped().transpose(), "must be symmetric");
  const double least = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(inertia).eigenvalues()[0];
  if (least < -1e-12 * scale)
    bad_value("inertia", inertia.reshaped().transpose(), "must not have a negative principal moment");
}

Link::Link(Joint joint, std::optional<RigidBody> hub, std::optional<Beam> beam, std::optional<RigidBody> tip)
    : joint_(std::move(joint)),
      hub_(hub.value_or(RigidBody{})),
      tip_(tip.value_or(RigidBody{})),
      beam_(std::move(beam)) {
  hub_.check();
  tip_.check();
  if (beam_ && beam_->order() == 0) build_first_order();
}

double Link::mass() const { return hub_.mass + (beam_ ? beam_->mass() : 0.0) + tip_.mass; }

SliceTable Link::slice_at(double x) const {
  if (!beam_) bad_value("x", x, "this link has no beam; leave x out for its end");
  return beam_->slice_at(x);
}

template <class S>
void Link::move_slice(const SliceTable& table, const LinkState<S>& s, bool orient, Slice<S>& out) const {
  const SeriesTables* series = beam_->series();
  if (series && series->plane != Plane::none)
    move_planar_slice(table, hub_.end, s.series, s.qe.data(), s.dqe.data(), orient, out);
  else if (series)
    flexarm::move_slice(table, hub_.end, beam_->order(), s.series, out);
  else
    flexarm::move_slice(table, hub_.end, s.qe.data(), s.dqe.data(), orient, out);
}

template <class S>
void Link::move(LinkState<S>& s) const {
  s.hub.x = hub_.com.template cast<S>();
  if (beam_) {
    if (beam_->series()) fill_series(*beam_->series(), s.qe.data(), s.dqe.data(), s.series);
    move_slice(beam_->tip(), s, true, s.root);
  } else {
    s.root.x = hub_.end.template cast<S>();
  }
  shift_slice(s.root, Vec3<S>(tip_.com.template cast<S>()), s.com);
  shift_slice(s.root, Vec3<S>(tip_.end.template cast<S>()), s.end);
}

template <class S, class Visit>
void Link::for_each_body(const LinkState<S>& s, const Visit& visit) const {
  visit(hub_.mass, &hub_.inertia, s.hub);
  if (beam_)
    for (const MassSlice& g : beam_->slices()) {
      const bool rotary = beam_->options().rotary_inertia;
      const Eigen::Matrix3d inertia = g.inertia.asDiagonal();
      move_slice(g.table, s, rotary, s.slice);
      visit(g.mass, rotary ? &inertia : nullptr, s.slice);
    }
  visit(tip_.mass, &tip_.inertia, s.com);
}

namespace {

template <class S>
void mirror(MatX<S>& M) {
  for (Eigen::Index k = 0; k < M.cols(); ++k)
    for (Eigen::Index i = 0; i < k; ++i) M(i, k) = M(k, i);
}

}  // namespace

template <class S>
void Link::mass_matrix_and_force(LinkState<S>& s, const Vec6<S>& A, const S* ddqe, Vec6<S>& F, VecX<S>& Fe) const {
  if (cut_) {
    mass_matrix(s);
    inertial_force(s, A, ddqe, F, Fe);
    return;
  }
  s.M.setZero();
  F.setZero();
  Fe.setZero();
  for_each_body(s, [&](double m, const Eigen::Matrix3d* inertia, const Slice<S>& at) {
    add_mass_matrix(m, inertia, at, s.M);
    add_force(m, inertia, at, s.V, A, ddqe, F, Fe);
  });
  mirror(s.M);
}

template <class S>
void Link::mass_matrix(LinkState<S>& s) const {
  s.M.setZero();
  if (cut_) {
    const FirstOrderInertia& c = *cut_;
    Vec3<S> moment = c.S.template cast<S>();
    Mat3<S> J = c.J.template cast<S>();
    for (Eigen::Index k = 0; k < c.L.cols(); ++k) {
      moment += c.L.col(k).template cast<S>() * s.qe[k];
      J += c.dJ[k].template cast<S>() * s.qe[k];
    }
    s.M.template block<3, 3>(0, 0).diagonal().setConstant(S(c.mass));
    s.M.template block<3, 3>(3, 0) = tilde(moment);
    s.M.template block<3, 3>(3, 3) = J;
    s.M.bottomLeftCorner(ne(), 3) = c.L.transpose().template cast<S>();
    s.M.block(6, 3, ne(), 3) = c.C.transpose().template cast<S>();
    s.M.bottomRightCorner(ne(), ne()) = c.Mee.template cast<S>();
  } else {
    for_each_body(
        s, [&](double m, const Eigen::Matrix3d* inertia, const Slice<S>& at) { add_mass_matrix(m, inertia, at, s.M); });
  }
  mirror(s.M);
}

template <class S>
void Link::inertial_force(const LinkState<S>& s, const Vec6<S>& A, const S* ddqe, Vec6<S>& F, VecX<S>& Fe) const {
  F.setZero();
  Fe.setZero();
  if (!cut_) {
    for_each_body(s, [&](double m, const Eigen::Matrix3d* inertia, const Slice<S>& at) {
      add_force(m, inertia, at, s.V, A, ddqe, F, Fe);
    });
    return;
  }
  // Boltzmann-Hamel equations of the cut kinetic energy: momenta p = S x + L dq, h = J w + C dq + S x v.
  const FirstOrderInertia& c = *cut_;
  const Vec3<S> w = s.V.template tail<3>(), a = A.template head<3>(), dw = A.template tail<3>();
  Vec3<S> moment = c.S.template cast<S>(), rate = Vec3<S>::Zero(), Cdq = Vec3<S>::Zero();
  Vec3<S> Lddq = Vec3<S>::Zero(), Cddq = Vec3<S>::Zero();
  Mat3<S> J = c.J.template cast<S>(), J_dot = Mat3<S>::Zero();
  for (Eigen::Index k = 0; k < ne(); ++k) {
    const Vec3<S> Lk = c.L.col(k).template cast<S>(), Ck = c.C.col(k).template cast<S>();
    const Mat3<S> dJ = c.dJ[k].template cast<S>();
    moment += Lk * s.qe[k];
    rate += Lk * s.dqe[k];
    Cdq += Ck * s.dqe[k];
    J += dJ * s.qe[k];
    J_dot += dJ * s.dqe[k];
    const Vec3<S> dJw = dJ * w;
    Fe[k] = Lk.dot(a) + Ck.dot(dw) - 0.5 * w.dot(dJw);
    if (ddqe) {
      Lddq += Lk * ddqe[k];
      Cddq += Ck * ddqe[k];
      for (Eigen::Index i = 0; i < ne(); ++i) Fe[k] += c.Mee(k, i) * ddqe[i];
    }
  }
  const Vec3<S> sweep = w.cross(moment) + 2.0 * rate, h = J * w + Cdq;
  F.template head<3>() = c.mass * a + dw.cross(moment) + w.cross(sweep) + Lddq;
  F.template tail<3>() = moment.cross(a) + J * dw + J_dot * w + w.cross(h) + Cddq;
  // Only T is cut: gravity, which comes in as an acceleration -g, acts where the tip body really is.
  const Vec3<S> beyond = beyond_first_order(s);
  F.template tail<3>() -= beyond.cross(s.g);
  for (Eigen::Index k = 0; k < ne(); ++k) {
    const Vec3<S> first = c.tip.col(k).template cast<S>();
    Fe[k] -= (tip_.mass * s.com.J.col(k).template head<3>() - first).dot(s.g);
  }
}

template <class S>
Vec3<S> Link::beyond_first_order(const LinkState<S>& s) const {
  const Eigen::Vector3d rest = hub_.end + beam_->length() * Eigen::Vector3d::UnitX() + tip_.com;
  Vec3<S> m = tip_.mass * (s.com.x - rest.template cast<S>());
  for (Eigen::Index k = 0; k < ne(); ++k) m -= cut_->tip.col(k).template cast<S>() * s.qe[k];
  return m;
}

template <class S>
Vec3<S> Link::mass_moment(const LinkState<S>& s) const {
  Vec3<S> sum = Vec3<S>::Zero();
  if (cut_) {
    sum = cut_->S.template cast<S>();
    for (Eigen::Index k = 0; k < ne(); ++k) sum += cut_->L.col(k).template cast<S>() * s.qe[k];
    sum += beyond_first_order(s);
  } else {
    for_each_body(s, [&](double m, const Eigen::Matrix3d*, const Slice<S>& at) { sum += m * at.x; });
  }
  return sum;
}

void Link::build_first_order() {
  // At rest the slices of order 1 give M(0); a body's second moment changes with x_i = J_T,i and the turn
  // J_R,i.
  LinkState<double> s(nj(), &*beam_, 0);
  move(s);
  mass_matrix(s);
  FirstOrderInertia c;
  c.mass = s.M(0, 0);
  c.S = mass_moment(s);  // cut_ is not set yet: the exact one
  c.J = s.M.block<3, 3>(3, 3);
  c.L = s.M.block(0, 6, 3, ne());
  c.C = s.M.block(3, 6, 3, ne());
  c.Mee = s.M.bottomRightCorner(ne(), ne());
  c.tip = tip_.mass * s.com.J.topRows<3>();
  c.dJ.assign(static_cast<std::size_t>(ne()), Eigen::Matrix3d::Zero());
  for_each_body(s, [&](double m, const Eigen::Matrix3d* inertia, const Slice<double>& at) {
    const Eigen::Matrix3d x = tilde(at.x);
    for (Eigen::Index k = 0; k < at.J.cols(); ++k) {
      const Eigen::Matrix3d xk = tilde(at.J.col(k).head<3>()), turn = tilde(at.J.col(k).tail<3>());
      Eigen::Matrix3d& d = c.dJ[k];
      d -= m * (xk * x + x * xk);
      if (inertia) d += turn * *inertia - *inertia * turn;
    }
  });
  cut_ = std::move(c);
}

#define FLEXARM_INSTANTIATE(S)                                                                                     \
  template void Link::move<S>(LinkState<S>&) const;                                                                \
  template void Link::move_slice<S>(const SliceTable&, const LinkState<S>&, bool, Slice<S>&) const;                \
  template void Link::mass_matrix<S>(LinkState<S>&) const;                                                         \
  template void Link::mass_matrix_and_force<S>(LinkState<S>&, const Vec6<S>&, const S*, Vec6<S>&, VecX<S>&) const; \
  template void Link::inertial_force<S>(const LinkState<S>&, const Vec6<S>&, const S*, Vec6<S>&, VecX<S>&) const;  \
  template Vec3<S> Link::mass_moment<S>(const LinkState<S>&) const;
FLEXARM_INSTANTIATE(double)
FLEXARM_INSTANTIATE(Tangent)

}  // namespace flexarm
