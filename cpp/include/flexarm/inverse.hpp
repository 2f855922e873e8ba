// Inverse dynamics: tau = M(q) a + h(q, v), by one sweep outward and one inward. No factorisation.
#pragma once

#include "flexarm/kinematics.hpp"

namespace flexarm {

/// Generalised forces for given accelerations, into ws.tau. h holds gravity, elastic and damping forces.
/// O(N).
/// @param q, v, a coordinates (rad, m), rates and accelerations, length nv
template <class S>
void inverse_dynamics(const Arm& arm, SweepWorkspace<S>& ws, const VecX<S>& q, const VecX<S>& v, const VecX<S>& a);

/// Exact Jacobians of inverse dynamics, by dual numbers through the same sweeps. O(N^2).
class InverseDerivatives {
 public:
  explicit InverseDerivatives(const Arm& arm, const std::vector<Load>& loads = {});
  /// Value of a load from now on.
  void set_wrench(std::size_t load, const Vec6<double>& wrench) { ws_.loads[load].wrench = wrench; }
  /// dtau/dq (nv x nq) and dtau/dv (nv x nv) at (q, v, a). (dtau/da is the mass matrix.)
  void operator()(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a);
  Eigen::MatrixXd dq, dv;

 private:
  SweepWorkspace<Tangent> ws_;
  VecX<Tangent> q_, v_, a_;
};

}  // namespace flexarm
