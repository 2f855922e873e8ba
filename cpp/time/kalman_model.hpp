// The model of the Kalman filter: an implicit step of an arm with parameters, and its tangent.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>

#include "flexarm/derivatives.hpp"
#include "flexarm/kalman.hpp"
#include "flexarm/step.hpp"

namespace flexarm {

/// The step of ImplicitStep, begun anew, whose residual has the forces of parameters as well:
///   r(q, v, a; p) = inverse dynamics + friction(v) - tau.
/// Inverse dynamics is linear in a payload's mass m: (1 - m) times that of the arm + m times that of the arm with 1 kg
/// more. So are its derivatives, which makes those by the mass, and by all else with it, exact.
class KalmanModel {
 public:
  KalmanModel(const Arm& arm, double h, const std::vector<KalmanParameter>& parameters, const KalmanOptions& options);

  /// q and v to the step's end.
  /// @param slack  error in v, in the norm of kinetic energy, that does not matter
  /// @return when not ok, q and v are of no use
  Status step(Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& p, const Eigen::VectorXd& tau,
              double slack);
  /// Small changes of the beginning, the parameters and the forces, to those of the end, in place: exact.
  void tangent(Eigen::VectorXd& dq, Eigen::VectorXd& dv, const Eigen::VectorXd& dp, const Eigen::VectorXd& dtau);
  /// Second derivative of the residual at the step's end, by the payload and along the change that `tangent` found
  /// last, of which dq and dv are given (nv).
  void bend(const Eigen::VectorXd& dq, const Eigen::VectorXd& dv, Eigen::VectorXd& out) const;
  /// The largest part of its inertia that a rate owes to a kilogram of payload, at the step's end (1/kg).
  double share() const;
  /// Which parameter is the payload; -1: none.
  int payload() const { return payload_; }
  /// Diagonal of the mass matrix at the last step's beginning.
  const Eigen::VectorXd& inertia() const { return inertia_; }
  void resume(const Eigen::VectorXd& inertia) { inertia_ = inertia; }
  Workspace& workspace() { return ws_; }

 private:
  /// An instant of the step: derivatives of the residual.
  struct Instant {
    Eigen::MatrixXd by_q, by_v, by_a, by_p;
  };
  /// The arm with 1 kg at its end.
  struct Loaded {
    explicit Loaded(const Arm& bare);
    Arm arm;
    Workspace ws;
    InverseDerivatives inverse;
  };
  void residual(const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a);
  void differentiate(const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a, Instant& at);
  void mass_matrix(const Eigen::VectorXd& q, Eigen::MatrixXd& M);
  Status begin(const Eigen::VectorXd& q, const Eigen::VectorXd& v);
  void to_end(Eigen::VectorXd& q, Eigen::VectorXd& v);
  void rub(const Eigen::VectorXd& v);
  void factor();
  /// Coulomb friction over c.
  double sliding(double v) const { return v / std::hypot(v, speed_); }

  const Arm* arm_;
  std::vector<KalmanParameter> parameters_;
  double speed_;
  int max_iterations_, payload_ = -1;  ///< which parameter
  double h_;
  ImplicitEnd alpha_;
  Workspace ws_;
  InverseDerivatives inverse_;
  std::optional<Loaded> loaded_;
  double mass_ = 0.0;
  std::vector<AppliedLimit> limits_;  ///< of the arm's motors: no more is applied
  Eigen::VectorXd p_, tau_, r_, a0_, a_, turn_, q0_, v0_, coulomb_, damping_, inertia_, zero_, r0_;
  Eigen::VectorXd rub_, rubbing_, slope_;  ///< of Coulomb friction: force, slope in the iteration, true slope by v
  Instant first_, last_;
  Eigen::MatrixXd S_;
  Eigen::LLT<Eigen::MatrixXd> begin_;
  Eigen::PartialPivLU<Eigen::MatrixXd> end_;
};

}  // namespace flexarm
