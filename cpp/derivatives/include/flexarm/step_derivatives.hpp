// Exact derivatives of a step in time: what filters, optimal control and learning ask for.
#pragma once

#include <Eigen/LU>
#include <array>
#include <string>

#include "flexarm/derivatives.hpp"
#include "flexarm/step.hpp"

namespace flexarm {

/// A step by "implicit" or "rk4" from any state, under forces that are held over it, and what small changes of that
/// state and these forces change of its end: exact derivatives of the method's own equations at their solution. Nothing
/// is remembered from one step to the next, as in a rollout whose forces change at every step.
class StepDerivatives {
 public:
  /// @param h  step (s)
  /// @throws std::invalid_argument naming the field and the value; for ball joints, and for joints with dry friction
  StepDerivatives(const std::string& method, const Arm& arm, double h, const ImplicitOptions& options = {},
                  const std::vector<Load>& loads = {});
  StepDerivatives(const std::string& method, const Arm&& arm, double h, const ImplicitOptions& options = {},
                  const std::vector<Load>& loads = {}) = delete;  ///< the arm must outlive it

  /// Takes q and v (nv) to the step's end under tau (nv), about which the following are.
  /// @param ws  of this arm, with the same loads, whose wrenches act over the step; nothing prescribed, no feedback
  /// @return when not ok, q and v are those of the step's beginning, and the following of no use
  Status operator()(Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau);

  /// Derivatives of [q; v] at the end by that at the beginning, A (2 nv x 2 nv), and by tau, B (2 nv x nv). O(nv^3).
  void matrices(Eigen::MatrixXd& A, Eigen::MatrixXd& B);

 private:
  struct Stage {
    Eigen::MatrixXd by_q, by_v, by_tau;  ///< of accelerations
  };
  void keep(std::size_t stage);
  /// Of a number, by q, v at the beginning and tau (nv each), from those by q and v at the end: A^T, B^T times these.
  void pull_back(Eigen::VectorXd& by_q, Eigen::VectorXd& by_v, Eigen::VectorXd& by_tau);
  Status implicit(Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau);
  Status classical(Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau);

  const Arm* arm_;
  double h_;
  bool iterates_;
  ImplicitEnd alpha_;  ///< of "implicit"
  OneStep step_;
  ForwardDerivatives forward_;
  InverseDerivatives inverse_;
  std::vector<Stage> stages_;         ///< of "implicit" the beginning alone
  std::vector<AppliedLimit> limits_;  ///< of the arm, as in the last step
  Eigen::VectorXd q_, v_, q0_, v0_, by_a_, sum_q_, sum_v_, sum_tau_, stage_q_, stage_v_, tau_;
  Eigen::PartialPivLU<Eigen::MatrixXd> factor_;  ///< of "implicit": residual at the end by the accelerations there
};

}  // namespace flexarm
