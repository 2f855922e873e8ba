// Exact derivatives of a step in time: for filters, optimal control and learning.
#pragma once

#include <string>
#include <vector>

#include "flexarm/problem.hpp"
#include "flexarm/step.hpp"

namespace flexarm {

/// A step by "implicit" or "rk4" from any state, under forces that are held over it, and the derivatives of its end by
/// that state and these forces: exact ones of the method's own equations at their solution. Nothing
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
  void matrices(Eigen::MatrixXd& A, Eigen::MatrixXd& B) const;

 private:
  Problem problem_;
  double h_;
  ImplicitOptions options_;
  OneStep step_;
  Tape tape_;  // of the step
};

}  // namespace flexarm
