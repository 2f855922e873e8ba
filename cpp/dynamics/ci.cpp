#include "flexarm/ci.hpp"

#include "sweeps.hpp"

namespace flexarm {

void take_composite(const Arm& arm, Workspace& ws) {
  const Eigen::Index n = static_cast<Eigen::Index>(ws.free.size());
  ws.M.resize(arm.nv(), arm.nv());  // resize does nothing where the size is right
  ws.M_free.setIdentity(n, n);
  ws.factor.compute(ws.M_free);
}

void composite_inertias(const Arm& arm, Workspace& ws, bool have_masses) {
  for (std::size_t n = arm.size(); n-- > 0;) {
    if (!have_masses) arm.link(n).mass_matrix(ws.links[n]);
    if (n + 1 < arm.size()) carry_inertia(ws.links[n + 1], ws.links[n + 1].M.topLeftCorner<6, 6>(), ws.links[n]);
  }
}

void composite_mass_matrix(const Arm& arm, Workspace& ws, bool have_masses) {
  composite_inertias(arm, ws, have_masses);
  ws.M.setZero(arm.nv(), arm.nv());
  for (std::size_t n = arm.size(); n-- > 0;) {
    const Link& link = arm.link(n);
    const LinkState<double>& s = ws.links[n];
    const int j = arm.first(n), nj = link.nj(), ne = link.ne(), e = j + nj;
    // H^T M H of this link, then M H carried inward by Phi^T to every link below
    const int n_own = nj + ne;
    auto F = ws.columns.leftCols(n_own);
    F.leftCols(nj).noalias() = s.M.topLeftCorner<6, 6>() * s.H;
    F.rightCols(ne) = s.M.topRightCorner(6, ne);
    ws.M.block(j, j, nj, n_own).noalias() = s.H.transpose() * F;
    for (int k = 0; k < nj; ++k)
      for (int i = 0; i < k; ++i) ws.M(j + i, j + k) = ws.M(j + k, j + i);
    if (link.joint().passive())
      for (int k = 0; k < nj; ++k) ws.M(j + k, j + k) += link.joint().forces()[k].reflected_inertia;
    ws.M.block(e, j, ne, nj) = ws.M.block(j, e, nj, ne).transpose();
    ws.M.block(e, e, ne, ne) = s.M.bottomRightCorner(ne, ne);
    for (std::size_t m = n; m-- > 0;) {
      const LinkState<double>& up = ws.links[m + 1];
      const LinkState<double>& below = ws.links[m];
      const int jb = arm.first(m), njb = arm.link(m).nj(), neb = arm.link(m).ne();
      ws.M.block(jb + njb, j, neb, n_own).noalias() = up.phi_e.transpose() * F;
      up.phi.inward(F, F);
      ws.M.block(jb, j, njb, n_own).noalias() = below.H.transpose() * F;
      ws.M.block(j, jb, n_own, njb + neb) = ws.M.block(jb, j, njb + neb, n_own).transpose();
    }
  }
}

Status forward_dynamics_ci(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                           const Eigen::VectorXd& tau) {
  // tau - H^T Phi^T (M Phi N + N) of Eq. 90: inverse dynamics with the free accelerations at zero
  for (int i : ws.free) ws.a[i] = 0.0;
  inverse_dynamics<double>(arm, ws, q, v, ws.a, true);
  composite_mass_matrix(arm, ws, true);
  const Eigen::Index n = static_cast<Eigen::Index>(ws.free.size());
  ws.M_free.resize(n, n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const int i = ws.free[k];
    ws.rhs[k] = tau[i] - ws.tau[i];
    for (Eigen::Index l = 0; l < n; ++l) ws.M_free(k, l) = ws.M(i, ws.free[l]);
  }
  ws.factor.compute(ws.M_free);
  if (ws.factor.info() != Eigen::Success) return all_finite(ws.M_free) ? Status::singular : Status::not_finite;
  ws.factor.solveInPlace(ws.rhs);
  for (Eigen::Index k = 0; k < n; ++k) ws.a[ws.free[k]] = ws.rhs[k];
  return all_finite(q) && all_finite(v) && all_finite(ws.a) ? Status::ok : Status::not_finite;
}

}  // namespace flexarm
