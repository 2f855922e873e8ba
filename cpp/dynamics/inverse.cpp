#include "flexarm/inverse.hpp"

#include <type_traits>

#include "lanes/single.hpp"
#include "sweeps.hpp"

namespace flexarm {

template <class S>
void inverse_dynamics(const Arm& arm, SweepWorkspace<S>& ws, const VecX<S>& q, const VecX<S>& v, const VecX<S>& a,
                      bool with_masses) {
  move_arm(arm, ws, q, v);
  accelerate_arm<S>(arm, ws, a, -arm.gravity());  // the base accelerates against gravity
  joint_forces(arm, ws, a, with_masses);
  if constexpr (std::is_same_v<S, double>) add_feedback(ws.feedback, q, v, -1.0, ws.tau);
}

template <class S>
void joint_forces(const Arm& arm, SweepWorkspace<S>& ws, const VecX<S>& a, bool with_masses) {
  // inward: F = M_rfr A_rfr + N_rfr + Phi^T F+ (Eq. 84); T = H_rfr^T F_rfr (Eq. 87)
  for (std::size_t n = arm.size(); n-- > 0;) {
    const Link& link = arm.link(n);
    LinkState<S>& s = ws.links[n];
    const int j = arm.first(n), e = j + link.nj();
    if (with_masses)
      link.mass_matrix_and_force(s, s.A, a.data() + e, s.F, s.Fe);
    else
      link.inertial_force(s, s.A, a.data() + e, s.F, s.Fe);
    if (!ws.loads.empty()) subtract_loads(arm, ws, n, s.F, s.Fe);
    if (link.beam()) {  // elastic and damping forces (Eq. 62)
      const Eigen::MatrixXd &K = link.beam()->stiffness(), &D = link.beam()->damping();
      const bool damped = link.beam()->damped();
      for (int k = 0; k < link.ne(); ++k)
        for (int i = 0; i < link.ne(); ++i) {
          s.Fe[k] += K(k, i) * s.qe[i];
          if (damped) s.Fe[k] += D(k, i) * s.dqe[i];
        }
    }
    if (n + 1 < arm.size()) {
      const LinkState<S>& above = ws.links[n + 1];
      s.F += above.phi.inward(above.F);
      for (Eigen::Index k = 0; k < link.ne(); ++k) s.Fe[k] += above.phi_e.col(k).dot(above.F);
    }
    for (Eigen::Index k = 0; k < s.H.cols(); ++k) ws.tau[j + k] = s.H.col(k).dot(s.F) + s.resistance[k];
    if (link.joint().passive())
      for (int k = 0; k < link.nj(); ++k) ws.tau[j + k] += link.joint().forces()[k].reflected_inertia * a[j + k];
    ws.tau.segment(e, link.ne()) = s.Fe;
  }
}

void inverse_dynamics(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                      const Eigen::VectorXd& a, bool with_masses) {
  if (!ws.fast) return inverse_dynamics<double>(arm, ws, q, v, a, with_masses);
  ws.kernels().inverse(q.data(), v.data(), a.data(), ws.tau.data());
  add_feedback(ws.feedback, q, v, -1.0, ws.tau);
}

void joint_forces(const Arm& arm, Workspace& ws, const Eigen::VectorXd& a) {
  if (ws.fast) return ws.fast->forces(a.data(), ws.tau.data());
  accelerate_arm<double>(arm, ws, a, -arm.gravity());
  joint_forces<double>(arm, ws, a);
}

#define FLEXARM_INSTANTIATE(S)                                                                                      \
  template void inverse_dynamics<S>(const Arm&, SweepWorkspace<S>&, const VecX<S>&, const VecX<S>&, const VecX<S>&, \
                                    bool);                                                                          \
  template void joint_forces<S>(const Arm&, SweepWorkspace<S>&, const VecX<S>&, bool);
FLEXARM_INSTANTIATE(double)
FLEXARM_INSTANTIATE(Tangent)

}  // namespace flexarm
