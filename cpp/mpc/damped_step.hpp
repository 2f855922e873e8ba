// The step of predictions: implicit, of second order, and quiet where it does not resolve.
#pragma once

#include <Eigen/LU>
#include <vector>

#include "flexarm/derivatives.hpp"

namespace flexarm {

/// Steps of many lengths from any state, under forces held over each, by the two implicit stages of Alexander (1977,
/// SDIRK of order 2, L-stable): whatever vibrates faster than the step is at rest behind it. (The generalised-alpha
/// step, begun anew, takes accelerations from its beginning; where a step is long for a vibration these are loud.) Each
/// stage,
///   v = v~ + g h a,  q = q~ + g h v,  inverse dynamics(q, v, a) + friction(v) = tau,
/// is solved by Newton's iteration, begun with the accelerations and the matrix of that step when it was taken last.
/// Coulomb friction c of a joint is c v / sqrt(v^2 + friction_speed^2).
class DampedStep {
 public:
  /// @param count    how many steps are told apart
  /// @param columns  forces per unit of inputs (nv, nu)
  DampedStep(const Arm& arm, const Eigen::MatrixXd& columns, std::size_t count, double friction_speed);

  /// Takes q and v to the end of a step of h seconds. @return when not ok, they are of no use
  Status operator()(std::size_t which, double h, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau);
  /// Of the last step: derivatives of [q; v] at its end by that at its beginning, A (2 nv x 2 nv), and by the inputs, B
  /// (2 nv x nu). Exact.
  void derivatives(Eigen::MatrixXd& A, Eigen::MatrixXd& B);
  Workspace& workspace() { return ws_; }

 private:
  struct Stage {
    Eigen::MatrixXd by_q, by_v;  ///< of the forces
    Eigen::VectorXd a;
    Eigen::PartialPivLU<Eigen::MatrixXd> factor;
    bool known = false;
  };
  Status solve(Stage& stage, double h, const Eigen::VectorXd& tau);
  void residual(const Eigen::VectorXd& a, double h, const Eigen::VectorXd& tau);
  Status factor(Stage& stage, double h, bool near);

  const Arm& arm_;
  Eigen::MatrixXd columns_;
  double speed_;
  Workspace ws_;
  InverseDerivatives inverse_;
  std::vector<Stage> stages_;  ///< two for each step
  std::size_t last_ = 0;
  double h_ = 0.0;  ///< of the last step
  Eigen::VectorXd coulomb_, inertia_, from_q_, from_v_, q_, v_, r_, d_;
  Eigen::MatrixXd S_, by_, first_, dq_, dv_;
};

}  // namespace flexarm
