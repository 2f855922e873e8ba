// The step of predictions, of controllers and of filters: implicit, of second order, quiet where it does not resolve,
// with exact derivatives by the state, by commands and by parameters of the model.
#pragma once

#include <Eigen/LU>
#include <optional>
#include <utility>
#include <vector>

#include "flexarm/derivatives.hpp"
#include "flexarm/kalman.hpp"
#include "system.hpp"

namespace flexarm {

/// Stages of a diagonally implicit Runge-Kutta method (SDIRK), L-stable: weights of their slopes, whose diagonal is one
/// number, and whose last row ends the step.
struct ImplicitStages {
  Eigen::MatrixXd weights;
  /// Two, of order 2 (Alexander 1977). A vibration's frequency w is lower by 0.04 (w h)^2 of it.
  static ImplicitStages two();
  /// Five, of order 4 (Hairer & Wanner 1996, Solving Ordinary Differential Equations II, table IV.6.5): by
  /// 0.0008 (w h)^4.
  static ImplicitStages five();
};

/// Steps from any state of a problem, under forces held over each beside the problem's own, by implicit stages:
/// whatever vibrates faster than the step is at rest behind it. (The generalised-alpha step, begun anew, takes
/// accelerations from its beginning; where a step is long for a vibration these are loud.) Each stage,
///   v = v~ + g h a,  q = q0 displaced by u~ + g h v,  r(q, v, a; p) = inverse dynamics + friction(v) - tau = 0,
/// is solved by Newton's iteration, begun with the accelerations and the matrix of that step when it was taken last.
/// A prescribed motion is that of the stage's time. Turns of balls are of order 2 with all stages. Coulomb friction c
/// of a joint is c v / sqrt(v^2 + friction_speed^2).
///
/// Inverse dynamics is linear in a payload's mass m: (1 - m) times that of the arm + m times that of the arm with 1 kg
/// more. So are its derivatives, which makes those by the mass, and by all else with it, exact.
class PredictiveStep {
 public:
  /// @param problem     which must outlive it; its sampled laws are not asked
  /// @param columns     generalised forces per unit of commands (nv, nu), whose derivatives are asked for; no parameter
  ///                    is the gain of their joints then
  /// @param parameters  numbers of the model that a step is told
  /// @param count       how many steps are told apart
  PredictiveStep(const Problem& problem, Eigen::MatrixXd columns, const std::vector<KalmanParameter>& parameters,
                 double friction_speed, std::size_t count, ImplicitStages by = ImplicitStages::two());

  /// Takes q and v from time t to the end of a step of h seconds, under forces (nv), with parameters p.
  /// @param slack  error in v, in the norm of kinetic energy, that does not matter
  /// @return when not ok, they are of no use
  Status operator()(std::size_t which, double t, double h, Eigen::VectorXd& q, Eigen::VectorXd& v,
                    const Eigen::VectorXd& forces, const Eigen::VectorXd& p = {}, double slack = 0.0);
  /// Of the last step: derivatives of [q; v] at its end by that at its beginning, A (2 nv x 2 nv), and by commands and
  /// parameters, B (2 nv x nu + parameters). Exact. Changes of q are displacements.
  void derivatives(Eigen::MatrixXd& A, Eigen::MatrixXd& B);
  /// With a payload, second derivatives of the residual at the end of the step of `derivatives`: by the payload, and
  /// along a change of [q; v; commands; parameters] at its beginning (nv x all).
  const Eigen::MatrixXd& bend() const { return bend_; }
  /// The largest part of its inertia that a rate owes to a kilogram of payload, there (1/kg).
  double share() const { return (kilogram_.diagonal().array() / s_.ws.M.diagonal().array()).maxCoeff(); }

  const Eigen::MatrixXd& columns() const { return columns_; }
  /// Diagonal of the mass matrix in the arm's zero.
  const Eigen::VectorXd& inertia() const { return inertia_; }
  System& system() { return s_; }

  /// The memory of its steps; `recall` goes on from that of another of the same; forgotten, all begin anew.
  Eigen::VectorXd memory() const;
  void recall(const Eigen::VectorXd& memory);
  void forget();

 private:
  struct Stage {
    Eigen::MatrixXd by_q, by_v, by_p;  ///< of the residual
    Eigen::MatrixXd back, turn;        ///< of `displace`, where there are balls
    Eigen::MatrixXd S;                 ///< of the residual by a, without Coulomb friction
    Eigen::VectorXd v, a;              ///< at its end
    Eigen::VectorXd slopes;            ///< of Coulomb friction by v, in the factor
    std::vector<char> cut;             ///< of each motor with a limit, whether it is beyond that
    Eigen::PartialPivLU<Eigen::MatrixXd> factor;
    double h = 0.0;  ///< of S; 0: there is none
    double contraction = 1.0;
  };
  /// A problem in motion.
  struct Moving {
    explicit Moving(const Problem& of);
    void differentiate(const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a);
    Control control;
    System s;
    InverseDerivatives inverse;
  };
  void take(const Eigen::VectorXd& p);
  void drive(Stage& stage, double t);
  Status solve(Stage& stage, double t, double h, double slack);
  void residual(const Eigen::VectorXd& a, double h);
  Status differentiate(Stage& stage, double h);
  void factor(Stage& stage, double h, const Eigen::VectorXd& slopes);
  void keep_given(Eigen::MatrixXd& rows) const;
  /// Coulomb friction over c.
  double sliding(double v) const { return v / std::hypot(v, speed_); }

  const Arm& arm_;
  const Eigen::MatrixXd columns_;
  const std::vector<KalmanParameter> parameters_;
  const double speed_;
  const Eigen::MatrixXd weights_;
  Moving moving_;
  System& s_;                                                 ///< its q and v are those of the stage
  std::optional<Problem> heavier_;                            ///< of the arm with 1 kg at its end
  std::optional<Moving> more_;                                ///< and that in motion
  std::vector<Stage> stages_;                                 ///< those of each step, one after the other
  std::vector<std::pair<Eigen::Index, Eigen::Index>> given_;  ///< prescribed rates, and their coordinates
  std::size_t last_ = 0;
  double h_ = 0.0;  ///< of the last step
  const bool balls_;
  double mass_ = 0.0;  ///< of the payload
  Eigen::VectorXd p_, forces_, commanded_, own_, coulomb_, damping_, inertia_;
  Eigen::VectorXd rub_, rubbing_, slope_;  ///< of Coulomb friction: force, slope in the iteration, true slope by v
  Eigen::VectorXd from_q_, from_u_, from_v_, tau_, given_q_, given_v_, u_, r_, d_;
  Eigen::MatrixXd E_, E_by_q_, by_, S_, du_, dq_, bend_;
  std::vector<Eigen::MatrixXd> dv_of_, da_of_;                ///< of each stage
  Eigen::MatrixXd kilogram_, kilogram_by_q_, kilogram_by_v_;  ///< of inertia and residual, by the payload
};

}  // namespace flexarm
