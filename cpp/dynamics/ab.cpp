#include "flexarm/ab.hpp"

#include <cmath>

#include "lanes/single.hpp"
#include "sweeps.hpp"

namespace flexarm {

namespace {

// In the paper's symbols, for link n (the rfr of every subscript left out; ~ for the breve of what is articulated):
//   s.phi, s.phi_e  Phi_n,n-1          s.M    M, then M~ (Eq. 96)     b.N, b.Ne  N, then N~ (Eq. 95), rigid and elastic
//   s.H             H_n                s.N    the bias of A (Eq. 86)  b.T        T~ (Eq. 93)
//   b.U             M~ H, rigid rows   b.D    D (Eq. 94)              b.W        L^-1 U^T, with D = L L^T

/// M of link n with everything above it (Eq. 96), and its U and D (Eq. 94).
void articulate(const Arm& arm, Workspace& ws, std::size_t n) {
  const bool last = n + 1 == arm.size();
  ws.articulated[n].articulate(arm.link(n), last ? nullptr : &ws.links[n + 1], last ? nullptr : &ws.articulated[n + 1],
                               ws.links[n]);
}

/// D = L L^T and W = L^-1 U^T.
Status factor(ArticulatedLink& b) {
  if (!b.factorise()) return all_finite(b.D) ? Status::singular : Status::not_finite;
  return all_finite(b.factor.matrixLLT().diagonal()) ? Status::ok : Status::not_finite;
}

/// Adds what the link above leaves of its bias (Eq. 95), through Phi^T.
void carry_bias(const Arm& arm, Workspace& ws, std::size_t n) {
  if (n + 1 >= arm.size()) return;
  const LinkState<double>& up = ws.links[n + 1];
  ArticulatedLink &b = ws.articulated[n], &ub = ws.articulated[n + 1];
  ub.N.noalias() += ub.U * ub.T;
  if (ub.lone) {  // along a free coordinate, what is applied to it and no rounding
    const auto h = up.H.col(ub.free[0]);
    ub.N += h * ((ub.applied - h.dot(ub.N)) / h.squaredNorm());
  }
  b.N += up.phi.inward(ub.N);
  b.Ne.noalias() += up.phi_e.transpose() * ub.N;
}

/// T, which holds the applied forces, less the bias (Eq. 93), and through D^-1.
void condense(const LinkState<double>& s, ArticulatedLink& b) {
  const Eigen::Index nf = static_cast<Eigen::Index>(b.free.size());
  if (b.lone) b.applied = b.T[0];
  for (Eigen::Index k = 0; k < nf; ++k) b.T[k] -= s.H.col(b.free[k]).dot(b.N);
  b.T.tail(b.Ne.size()) -= b.Ne;
  b.factor.solveInPlace(b.T);
}

/// Inward sweep: articulated inertia and bias of every link (Eq. 93-96).
Status eliminate(const Arm& arm, Workspace& ws, const Eigen::VectorXd& tau) {
  for (std::size_t n = arm.size(); n-- > 0;) {
    const Link& link = arm.link(n);
    LinkState<double>& s = ws.links[n];
    ArticulatedLink& b = ws.articulated[n];
    const int j = arm.first(n), e = j + link.nj(), ne = link.ne();
    const int nf = static_cast<int>(b.free.size());
    link.mass_matrix_and_force<double>(s, Vec6<double>::Zero(), nullptr, b.N, b.Ne);
    articulate(arm, ws, n);
    const Status status = factor(b);
    if (status != Status::ok) return status;
    if (!ws.loads.empty()) subtract_loads(arm, ws, n, b.N, b.Ne);
    if (link.beam()) {
      b.Ne.noalias() += link.beam()->stiffness() * s.qe;
      if (link.beam()->damped()) b.Ne.noalias() += link.beam()->damping() * s.dqe;
    }
    carry_bias(arm, ws, n);
    for (int k = 0; k < link.nj(); ++k)  // a prescribed acceleration is part of the bias acceleration
      if (ws.prescribed[j + k]) s.N += s.H.col(k) * ws.a[j + k];
    b.N.noalias() += s.M.topLeftCorner<6, 6>() * s.N;
    b.Ne.noalias() += b.U.rightCols(ne).transpose() * s.N;
    for (int k = 0; k < nf; ++k) b.T[k] = tau[j + b.free[k]] - s.resistance[b.free[k]];
    b.T.tail(ne) = tau.segment(e, ne);
    condense(s, b);
  }
  return Status::ok;
}

/// Outward sweep: ddq = D^-1 (T - U^T Phi A-), A = Phi A- + H ddq + N (first rows of Eq. 92; Eq. 86), into `a`;
/// with the bias accelerations N and gravity, or without.
template <bool biased>
void expand(const Arm& arm, Workspace& ws, Eigen::VectorXd& a) {
  for (std::size_t n = 0; n < arm.size(); ++n) {
    LinkState<double>& s = ws.links[n];
    ArticulatedLink& b = ws.articulated[n];
    const int j = arm.first(n), e = j + static_cast<int>(s.H.cols()), nf = static_cast<int>(b.free.size());
    if (n == 0) {
      Vec6<double> world = Vec6<double>::Zero();
      if (biased) world.head<3>() = -arm.gravity();
      s.A = s.phi.outward(world);
    } else {
      s.A = s.phi.outward(ws.links[n - 1].A);
      s.A.noalias() += s.phi_e * a.segment(j - s.phi_e.cols(), s.phi_e.cols());
    }
    // T holds D^-1 T; the second part goes through the factor's halves: D^-1 U^T A = L^-T (W A)
    b.turn.noalias() = b.W * s.A;
    b.factor.matrixU().solveInPlace(b.turn);
    b.T -= b.turn;
    for (int k = 0; k < nf; ++k) a[j + b.free[k]] = b.T[k];
    a.segment(e, s.qe.size()) = b.T.tail(s.qe.size());
    if (biased) s.A += s.N;
    for (int k = 0; k < nf; ++k) s.A += s.H.col(b.free[k]) * b.T[k];
  }
}

/// v^T M v of one link, before anything is added to its M.
double twice_kinetic(const LinkState<double>& s) {
  const Eigen::Index ne = s.qe.size();
  Vec6<double> p = s.M.topLeftCorner<6, 6>() * s.V;
  double sum = 0.0;
  for (Eigen::Index k = 0; k < ne; ++k) {
    p += 2.0 * s.dqe[k] * s.M.block<6, 1>(0, 6 + k);
    sum += s.dqe[k] * s.M.col(6 + k).tail(ne).dot(s.dqe);
  }
  return sum + s.V.dot(p);
}

}  // namespace

Status forward_dynamics_ab(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                           const Eigen::VectorXd& tau) {
  move_arm<double>(arm, ws, q, v);
  if (!ws.feedback.empty()) {
    ws.total = tau;
    add_feedback(ws.feedback, q, v, 1.0, ws.total);
  }
  const Status status = eliminate(arm, ws, ws.feedback.empty() ? tau : ws.total);
  if (status == Status::ok) expand<true>(arm, ws, ws.a);
  if (!all_finite(q) || !all_finite(v)) return Status::not_finite;
  return status != Status::ok || all_finite(ws.a) ? status : Status::not_finite;
}

long operation_count(const Arm& arm) {
  const lanes::KernelArm* known = lanes::KernelArm::of(arm);
  return known ? lanes::operation_count(*known) : 0;
}

Status forward_dynamics(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                        const Eigen::VectorXd& tau) {
  if (!ws.fast) return forward_dynamics_ab(arm, ws, q, v, tau);
  const Eigen::VectorXd* total = &tau;
  if (!ws.feedback.empty()) {
    ws.total = tau;
    add_feedback(ws.feedback, q, v, 1.0, ws.total);
    total = &ws.total;
  }
  const bool good = ws.kernels().forward(q.data(), v.data(), total->data(), ws.a.data());
  const bool finite = all_finite(q) && all_finite(v) && all_finite(ws.a);
  if (good && finite) return Status::ok;
  // the kernels do not say why: a pivot may be too small, or not a number
  const Status status = forward_dynamics_ab(arm, ws, q, v, tau);
  return status == Status::ok && !good && finite ? Status::singular : status;
}

namespace {

/// x = S^-1 r, without feedback.
void solve_chain(const Arm& arm, Workspace& ws, const Eigen::VectorXd& r, Eigen::VectorXd& x) {
  for (std::size_t n = arm.size(); n-- > 0;) {
    ArticulatedLink& b = ws.articulated[n];
    const Eigen::Index j = arm.first(n), ne = b.Ne.size(), nf = static_cast<Eigen::Index>(b.free.size());
    b.N.setZero();
    b.Ne.setZero();
    carry_bias(arm, ws, n);
    for (Eigen::Index k = 0; k < nf; ++k) b.T[k] = r[j + b.free[k]];
    b.T.tail(ne) = r.segment(j + arm.link(n).nj(), ne);
    condense(ws.links[n], b);
  }
  x.setZero();
  expand<false>(arm, ws, x);
}

/// Slopes of feedback for Woodbury's formula.
void factor_feedback(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                     const Shift& shift) {
  const Eigen::Index n = static_cast<Eigen::Index>(ws.feedback.size());
  for (Eigen::Index l = 0; l < n; ++l) {
    const AppliedFeedback& f = ws.feedback[static_cast<std::size_t>(l)];
    auto slopes = ws.feedback_slopes.col(l);
    slopes.setZero();
    if (std::abs((*f.law)(f.offset, q, v)) < f.law->limit)
      for (int i : ws.free) {
        const int at = arm.coordinate_of(i);
        slopes[i] = f.law->by_v[i] * shift.damping + (at < 0 ? 0.0 : f.law->by_q[at] * shift.stiffness);
      }
    solve_chain(arm, ws, f.law->column, ws.feedback_x);
    ws.feedback_columns.col(l) = ws.feedback_x;
  }
  ws.feedback_matrix.noalias() = ws.feedback_slopes.transpose() * ws.feedback_columns;
  ws.feedback_matrix.diagonal().array() += 1.0;
  ws.feedback_factor.compute(ws.feedback_matrix);
}

}  // namespace

Status factor_shifted(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                      const Shift& shift, bool have_masses) {
  ws.twice_kinetic = 0.0;
  for (std::size_t n = arm.size(); n-- > 0;) {
    const Link& link = arm.link(n);
    LinkState<double>& s = ws.links[n];
    ArticulatedLink& b = ws.articulated[n];
    const Eigen::Index ne = link.ne();
    if (!have_masses) link.mass_matrix(s);
    ws.twice_kinetic += twice_kinetic(s);
    articulate(arm, ws, n);
    if (link.joint().passive()) {
      for (int k = 0; k < link.nj(); ++k)
        ws.twice_kinetic += link.joint().forces()[k].reflected_inertia * std::pow(v[arm.first(n) + k], 2);
      for (std::size_t k = 0; k < b.free.size(); ++k) {
        const auto [by_q, by_v] =
            link.joint().resistance_slopes(b.free[k], q.data() + arm.first_q(n), v.data() + arm.first(n));
        b.add_to_joint(static_cast<Eigen::Index>(k), shift.stiffness * by_q + shift.damping * by_v);
      }
    }
    if (link.beam()) {
      b.D.bottomRightCorner(ne, ne) += shift.stiffness * link.beam()->stiffness();
      if (link.beam()->damped()) b.D.bottomRightCorner(ne, ne) += shift.damping * link.beam()->damping();
    }
    const Status status = factor(b);
    if (status != Status::ok) return status;
  }
  if (!ws.feedback.empty()) factor_feedback(arm, ws, q, v, shift);
  return std::isfinite(ws.twice_kinetic) ? Status::ok : Status::not_finite;
}

void solve_shifted(const Arm& arm, Workspace& ws, const Eigen::VectorXd& r, Eigen::VectorXd& x) {
  solve_chain(arm, ws, r, x);
  if (ws.feedback.empty()) return;
  // (S + c g^T)^-1 r = x - S^-1 c (1 + g^T S^-1 c)^-1 g^T x, with x = S^-1 r
  ws.feedback_rhs.noalias() = ws.feedback_slopes.transpose() * x;
  ws.feedback_share = ws.feedback_factor.solve(ws.feedback_rhs);
  x.noalias() -= ws.feedback_columns * ws.feedback_share;
}

}  // namespace flexarm
