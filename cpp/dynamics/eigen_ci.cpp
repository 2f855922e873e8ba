#include "eigen.hpp"
#include "sweeps.hpp"

namespace flexarm {
namespace eigen {

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

}  // namespace eigen
}  // namespace flexarm
