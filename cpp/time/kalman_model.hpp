// The model of the Kalman filter: an implicit step of an arm with parameters, and its tangent.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>

#include "flexarm/derivatives.hpp"
#include "flexarm/kalman.hpp"
#include "flexarm/step.hpp"
#include "system.hpp"

namespace flexarm {

/// The step of ImplicitStep, begun anew, under all that acts in a problem, whose residual has the forces of parameters
/// as well:  r(q, v, a; p) = inverse dynamics + friction(v) - tau.  Changes of q are displacements (nv).
/// Inverse dynamics is linear in a payload's mass m: (1 - m) times that of the arm + m times that of the arm with 1 kg
/// more. So are its derivatives, which makes those by the mass, and by all else with it, exact.
class KalmanModel {
 public:
  /// @param problem  which must outlive it
  KalmanModel(const Problem& problem, double h, const std::vector<KalmanParameter>& parameters,
              const KalmanOptions& options);

  /// q and v from time t to the step's end, under forces tau beside those of the problem.
  /// @param slack  error in v, in the norm of kinetic energy, that does not matter
  /// @return when not ok, q and v are of no use
  Status step(double t, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& p, const Eigen::VectorXd& tau,
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
  Workspace& workspace() { return s_.ws; }

 private:
  /// An instant of the step: derivatives of the residual.
  struct Instant {
    Eigen::MatrixXd by_q, by_v, by_a, by_p;
  };
  /// A problem in motion.
  struct Moving {
    explicit Moving(const Problem& of);
    Control control;
    System s;
    InverseDerivatives inverse;
    void differentiate(const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a);
  };
  /// That of the arm with 1 kg at its end.
  struct Loaded {
    explicit Loaded(const Problem& bare);
    Problem problem;
    Moving moving;
  };
  void drive(double t);
  void hold_given(Eigen::VectorXd& x) const;
  void hold_given(Eigen::MatrixXd& S, bool columns) const;
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
  std::vector<std::pair<Eigen::Index, Eigen::Index>> given_;  ///< prescribed rates, and their coordinates
  std::vector<KalmanParameter> parameters_;
  double speed_;
  int max_iterations_, payload_ = -1;  ///< which parameter
  double h_;
  ImplicitEnd alpha_;
  Moving moving_;
  System& s_;
  std::optional<Loaded> loaded_;
  const bool balls_;
  double mass_ = 0.0;
  Eigen::VectorXd said_, p_, tau_, r_, a0_, a_, turn_, q0_, v0_, coulomb_, damping_, inertia_, r0_, u_;
  Eigen::VectorXd rub_, rubbing_, slope_;  ///< of Coulomb friction: force, slope in the iteration, true slope by v
  Instant first_, last_;
  Eigen::MatrixXd S_, E_, E_by_q_, back_, turned_;  ///< the last two of `displace`
  Eigen::MatrixXd kilogram_by_q_, kilogram_by_v_;   ///< of a kilogram of payload
  Eigen::LLT<Eigen::MatrixXd> begin_;
  Eigen::PartialPivLU<Eigen::MatrixXd> end_;
};

}  // namespace flexarm
