// Exact derivatives of a step in time: what filters, optimal control and learning ask for.
#pragma once

#include <Eigen/LU>
#include <string>

#include "flexarm/derivatives.hpp"
#include "flexarm/step.hpp"

namespace flexarm {

/// A step by "implicit" or "rk4" from any state, under forces that are held over it, and what small changes of that
/// state and these forces change of its end: exact derivatives of the method's own equations at their solution. Nothing
/// is remembered from one step to the next: as in a rollout whose forces change at every step.
class StepDerivatives {
 public:
  /// @param h  step (s)
  /// @throws std::invalid_argument naming the field and the value; for ball joints, and for joints with dry friction
  StepDerivatives(const std::string& method, const Arm& arm, double h, const ImplicitOptions& options = {},
                  const std::vector<Load>& loads = {});
  StepDerivatives(const std::string& method, const Arm&& arm, double h, const ImplicitOptions& options = {},
                  const std::vector<Load>& loads = {}) = delete;  ///< the arm must outlive it

  /// Takes q and v (nv) to the step's end under tau (nv), and sets `A` and `B`.
  /// @param ws  of this arm, with the same loads, whose wrenches act over the step; nothing prescribed, no feedback
  /// @return when not ok, q and v are those of the step's beginning, and A and B of no use
  Status operator()(Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau);

  Eigen::MatrixXd A;  ///< of [q; v] at the end by that at the beginning, 2 nv x 2 nv
  Eigen::MatrixXd B;  ///< and by tau, 2 nv x nv

 private:
  Status implicit(Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau);
  Status classical(Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau);
  void set_wrenches(const Workspace& ws);

  const Arm* arm_;
  double h_, radius_;
  bool iterates_;
  OneStep step_;
  ForwardDerivatives forward_;
  InverseDerivatives inverse_;
  Eigen::VectorXd q_, v_, q0_, v0_;
  Eigen::MatrixXd by_q_, by_v_, by_a_;  ///< of coordinates, rates and accelerations by [q, v, tau] at the beginning
  Eigen::MatrixXd S_, sum_q_, sum_v_;
  Eigen::PartialPivLU<Eigen::MatrixXd> factor_;
};

}  // namespace flexarm
