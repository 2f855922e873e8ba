// The step of predictions: implicit, of second order, and quiet where it does not resolve.
#pragma once

#include <Eigen/LU>
#include <vector>

#include "flexarm/derivatives.hpp"
#include "system.hpp"

namespace flexarm {

/// Steps of many lengths from any state of a problem, under forces held over each beside what else acts, by the two
/// implicit stages of Alexander (1977, SDIRK of order 2, L-stable): whatever vibrates faster than the step is at rest
/// behind it. (The generalised-alpha step, begun anew, takes accelerations from its beginning; where a step is long for
/// a vibration these are loud.) Each stage,
///   v = v~ + g h a,  q = q0 displaced by u~ + g h v,  inverse dynamics(q, v, a) + friction(v) = tau,
/// is solved by Newton's iteration, begun with the accelerations and the matrix of that step when it was taken last.
/// What a motion prescribes is that of the stage's time. Coulomb friction c of a joint is
/// c v / sqrt(v^2 + friction_speed^2).
class DampedStep {
 public:
  /// @param problem  whose sampled laws are not asked: their forces are among the inputs
  /// @param columns  forces per unit of inputs (nv, nu)
  /// @param count    how many steps are told apart
  DampedStep(const Problem& problem, const Eigen::MatrixXd& columns, std::size_t count, double friction_speed);

  /// Takes q and v from time t to the end of a step of h seconds, under inputs u (nu). @return when not ok, they are of
  /// no use
  Status operator()(std::size_t which, double t, double h, Eigen::VectorXd& q, Eigen::VectorXd& v,
                    const Eigen::VectorXd& u);
  /// Of the last step: derivatives of [q; v] at its end by that at its beginning, A (2 nv x 2 nv), and by the inputs, B
  /// (2 nv x nu). Exact. Changes of q are displacements.
  void derivatives(Eigen::MatrixXd& A, Eigen::MatrixXd& B);
  System& system() { return s_; }

 private:
  struct Stage {
    Eigen::MatrixXd by_q, by_v;  ///< of the forces
    Eigen::MatrixXd back, turn;  ///< of `displace`, where there are balls
    Eigen::VectorXd a;
    std::vector<char> cut;  ///< of each motor with a limit, whether it is beyond that
    Eigen::PartialPivLU<Eigen::MatrixXd> factor;
    double h = 0.0;  ///< of the factor; 0: there is none
  };
  Status solve(Stage& stage, double t, double h);
  void residual(const Eigen::VectorXd& a, double h);
  Status factor(Stage& stage, double h, bool near);
  void keep_given(Eigen::MatrixXd& rows) const;

  const Arm& arm_;
  Eigen::MatrixXd columns_;
  double speed_;
  Control control_;
  System s_;  ///< its q and v are those of the stage
  InverseDerivatives inverse_;
  std::vector<Stage> stages_;                                 ///< two for each step
  std::vector<std::pair<Eigen::Index, Eigen::Index>> given_;  ///< prescribed rates, and their coordinates
  std::size_t last_ = 0;
  double h_ = 0.0;  ///< of the last step
  const bool balls_;
  Eigen::VectorXd coulomb_, inertia_, from_q_, from_u_, from_v_, tau_, given_q_, given_v_, u_, r_, d_, input_;
  Eigen::MatrixXd S_, E_, E_by_q_, by_, first_, du_, dv_, dq_;
};

}  // namespace flexarm
