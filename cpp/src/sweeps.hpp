// What the AB and CI methods share.
#pragma once

#include "flexarm/workspace.hpp"

namespace flexarm {

/// Adds Phi_rfr^T Ma Phi_rfr, the inertia Ma of everything from the link above outward, to the M of the link
/// below (Eq. 96), with Phi_rfr = [Phi, Phi_e; 0, 0] (Eq. 85).
inline void carry_inertia(const LinkState<double>& above, const Mat6<double>& Ma, LinkState<double>& below) {
  below.M.topLeftCorner<6, 6>() += above.phi.inward_inertia(Ma);
  const Eigen::Index ne = above.phi_e.cols();
  for (Eigen::Index k = 0; k < ne; ++k) {
    const Vec6<double> Mk = Ma * above.phi_e.col(k), Fk = above.phi.inward(Mk);
    below.M.block<6, 1>(0, 6 + k) += Fk;
    below.M.block<1, 6>(6 + k, 0) += Fk.transpose();
    for (Eigen::Index i = k; i < ne; ++i) {
      below.M(6 + i, 6 + k) += above.phi_e.col(i).dot(Mk);
      below.M(6 + k, 6 + i) = below.M(6 + i, 6 + k);
    }
  }
}

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
