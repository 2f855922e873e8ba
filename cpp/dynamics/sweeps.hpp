// What the methods share.
#pragma once

#include "flexarm/workspace.hpp"
#include "lanes/kernels.hpp"

namespace flexarm {

Status status_of(lanes::Outcome outcome);

/// Of move_arm, what factor_shifted and composite_mass_matrix go on from.
void move_chain(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v);

/// Whether every number is finite, without a branch: what is not gives no zero times zero.
template <class V>
bool all_finite(const Eigen::DenseBase<V>& x) {
  return (x.derived().array() * 0.0).sum() == 0.0;
}

/// Adds sign times the generalised forces of feedback at q and v.
inline void add_feedback(const std::vector<AppliedFeedback>& feedback, const Eigen::VectorXd& q,
                         const Eigen::VectorXd& v, double sign, Eigen::VectorXd& tau) {
  for (const AppliedFeedback& f : feedback) tau += sign * (*f.law)(f.offset, q, v) * f.law->column;
}

}  // namespace flexarm
