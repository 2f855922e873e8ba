#include "flexarm/inverse.hpp"

namespace flexarm {

template <class S>
void inverse_dynamics(const Arm& arm, SweepWorkspace<S>& ws, const VecX<S>& q, const VecX<S>& v, const VecX<S>& a) {
  move_arm(arm, ws, q, v);
  // outward: A = Phi A- + Phi_e ddqe- + H ddq + N (Eq. 86); the base accelerates against gravity
  for (std::size_t n = 0; n < arm.size(); ++n) {
    LinkState<S>& s = ws.links[n];
    const int j = arm.first(n);
    Vec6<S> A;
    if (n == 0) {
      Vec6<S> world = Vec6<S>::Zero();
      world.template head<3>() = -arm.gravity().template cast<S>();
      A = s.phi.outward(world);
    } else {
      A = s.phi.outward(ws.links[n - 1].A);
      for (Eigen::Index k = 0; k < s.phi_e.cols(); ++k) A += s.phi_e.col(k) * a[j - s.phi_e.cols() + k];
    }
    for (Eigen::Index k = 0; k < s.H.cols(); ++k) A += s.H.col(k) * a[j + k];
    s.A = A + s.N;
  }
  // inward: F = M_rfr A_rfr + N_rfr + Phi^T F+ (Eq. 84); T = H_rfr^T F_rfr (Eq. 87)
  for (std::size_t n = arm.size(); n-- > 0;) {
    const Link& link = arm.link(n);
    LinkState<S>& s = ws.links[n];
    const int j = arm.first(n), e = j + link.nj();
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
    ws.tau.segment(e, link.ne()) = s.Fe;
  }
}
template void inverse_dynamics<double>(const Arm&, SweepWorkspace<double>&, const VecX<double>&, const VecX<double>&,
                                       const VecX<double>&);
template void inverse_dynamics<Tangent>(const Arm&, SweepWorkspace<Tangent>&, const VecX<Tangent>&,
                                        const VecX<Tangent>&, const VecX<Tangent>&);

InverseDerivatives::InverseDerivatives(const Arm& arm, const std::vector<Load>& loads)
    : dq(Eigen::MatrixXd::Zero(arm.nv(), arm.nq())),
      dv(Eigen::MatrixXd::Zero(arm.nv(), arm.nv())),
      ws_(arm, loads),
      q_(arm.nq()),
      v_(arm.nv()),
      a_(arm.nv()) {}

void InverseDerivatives::operator()(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                    const Eigen::VectorXd& a) {
  constexpr int W = static_cast<int>(std::tuple_size<decltype(Tangent::d)>::value);
  const int nq = arm.nq(), nv = arm.nv();
  for (int i = 0; i < nq; ++i) q_[i] = q[i];
  for (int i = 0; i < nv; ++i) {
    v_[i] = v[i];
    a_[i] = a[i];
  }
  for (int first = 0; first < nq + nv; first += W) {  // directions: every coordinate, then every rate
    const int last = std::min(first + W, nq + nv);
    const auto direction = [&](int k) -> double& { return (k < nq ? q_[k] : v_[k - nq]).d[k - first]; };
    for (int k = first; k < last; ++k) direction(k) = 1.0;
    inverse_dynamics(arm, ws_, q_, v_, a_);
    for (int k = first; k < last; ++k) {
      direction(k) = 0.0;
      for (int i = 0; i < nv; ++i) (k < nq ? dq(i, k) : dv(i, k - nq)) = ws_.tau[i].d[k - first];
    }
  }
}

}  // namespace flexarm
