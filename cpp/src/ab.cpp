#include "flexarm/ab.hpp"

#include "sweeps.hpp"

namespace flexarm {

namespace {

// In the paper's symbols, for link n (the rfr of every subscript left out; ~ for the breve of what is articulated):
//   s.phi, s.phi_e  Phi_n,n-1          s.M    M, then M~ (Eq. 96)     b.N, b.Ne  N, then N~ (Eq. 95), rigid and elastic
//   s.H             H_n                s.N    the bias of A (Eq. 86)  b.T        T~ (Eq. 93)
//   b.U             M~ H, rigid rows   b.D    D (Eq. 94)              b.W        L^-1 U^T, with D = L L^T

/// Inward sweep: articulated inertia and bias of every link (Eq. 93-96).
Status eliminate(const Arm& arm, Workspace& ws, const Eigen::VectorXd& tau) {
  for (std::size_t n = arm.size(); n-- > 0;) {
    const Link& link = arm.link(n);
    LinkState<double>& s = ws.links[n];
    ArticulatedLink& b = ws.articulated[n];
    const int j = arm.first(n), e = j + link.nj(), ne = link.ne();
    const int nf = static_cast<int>(b.free.size());
    link.mass_matrix(s);
    link.inertial_force<double>(s, Vec6<double>::Zero(), nullptr, b.N, b.Ne);
    if (!ws.loads.empty()) subtract_loads(arm, ws, n, b.N, b.Ne);
    if (link.beam()) {
      b.Ne.noalias() += link.beam()->stiffness() * s.qe;
      if (link.beam()->damped()) b.Ne.noalias() += link.beam()->damping() * s.dqe;
    }
    if (n + 1 < arm.size()) {  // what the link above leaves after its elimination, through Phi^T (Eq. 95, 96)
      const LinkState<double>& up = ws.links[n + 1];
      const ArticulatedLink& ub = ws.articulated[n + 1];
      Mat6<double> Ma = up.M.topLeftCorner<6, 6>();
      Ma.noalias() -= ub.W.transpose() * ub.W;
      Vec6<double> Na = ub.N;
      Na.noalias() += up.M.topLeftCorner<6, 6>() * up.N;
      Na.noalias() += ub.U * ub.T;
      carry_inertia(up, Ma, s);
      b.N += up.phi.inward(Na);
      b.Ne.noalias() += up.phi_e.transpose() * Na;
    }
    for (int k = 0; k < link.nj(); ++k)  // a prescribed acceleration is part of the bias acceleration
      if (ws.prescribed[j + k]) s.N += s.H.col(k) * ws.a[j + k];

    // U = M H, D = H^T M H (Eq. 94), T = T - H^T (N + M N_acc) (Eq. 93)
    const auto Mrr = s.M.topLeftCorner<6, 6>();
    for (int k = 0; k < nf; ++k) b.U.col(k).noalias() = Mrr * s.H.col(b.free[k]);
    b.U.rightCols(ne) = s.M.topRightCorner(6, ne);
    Vec6<double> load = b.N;
    load.noalias() += Mrr * s.N;
    for (int k = 0; k < nf; ++k) {
      const int column = b.free[k];
      for (int i = 0; i < nf + ne; ++i) b.D(i, k) = b.D(k, i) = s.H.col(column).dot(b.U.col(i));
      b.T[k] = tau[j + column] - s.resistance[column] - s.H.col(column).dot(load);
    }
    b.D.bottomRightCorner(ne, ne) = s.M.bottomRightCorner(ne, ne);
    for (int k = 0; k < ne; ++k) b.T[nf + k] = tau[e + k] - b.Ne[k] - b.U.col(nf + k).dot(s.N);
    b.factor.compute(b.D);
    if (b.factor.info() != Eigen::Success) return Status::singular;
    b.W = b.U.transpose();
    b.factor.matrixL().solveInPlace(b.W);
    b.factor.solveInPlace(b.T);
  }
  return Status::ok;
}

}  // namespace

Status forward_dynamics_ab(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                           const Eigen::VectorXd& tau) {
  move_arm(arm, ws, q, v);
  const Status status = eliminate(arm, ws, tau);
  if (status != Status::ok) return status;
  // outward: ddq = D^-1 (T - U^T Phi A-), A = Phi A- + H ddq + N (first rows of Eq. 92; Eq. 86)
  for (std::size_t n = 0; n < arm.size(); ++n) {
    LinkState<double>& s = ws.links[n];
    ArticulatedLink& b = ws.articulated[n];
    const int j = arm.first(n), e = j + static_cast<int>(s.H.cols()), nf = static_cast<int>(b.free.size());
    if (n == 0) {
      Vec6<double> world = Vec6<double>::Zero();
      world.head<3>() = -arm.gravity();
      s.A = s.phi.outward(world);
    } else {
      s.A = s.phi.outward(ws.links[n - 1].A);
      s.A.noalias() += s.phi_e * ws.a.segment(j - s.phi_e.cols(), s.phi_e.cols());
    }
    // T holds D^-1 T; the second part goes through the factor's halves: D^-1 U^T A = L^-T (W A)
    b.turn.noalias() = b.W * s.A;
    b.factor.matrixU().solveInPlace(b.turn);
    b.T -= b.turn;
    for (int k = 0; k < nf; ++k) ws.a[j + b.free[k]] = b.T[k];
    ws.a.segment(e, s.qe.size()) = b.T.tail(s.qe.size());
    s.A += s.N;
    for (int k = 0; k < nf; ++k) s.A += s.H.col(b.free[k]) * b.T[k];
  }
  return Status::ok;
}

}  // namespace flexarm
