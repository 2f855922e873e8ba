#include "flexarm/step_derivatives.hpp"

#include "flexarm/check.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/dry_friction.hpp"
#include "system.hpp"

namespace flexarm {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {
constexpr double kTimes[] = {0.0, 0.5, 0.5, 1.0}, kWeights[] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};
}

StepDerivatives::StepDerivatives(const std::string& method, const Arm& arm, double h, const ImplicitOptions& options,
                                 const std::vector<Load>& loads)
    : arm_(&arm),
      h_(h),
      iterates_(method == "implicit"),
      alpha_(options.spectral_radius, h),
      step_(method, arm, h, options),
      forward_(arm, loads),
      inverse_(arm, loads),
      stages_(iterates_ ? 1 : 4),
      limits_(torque_limits(arm)),
      q_(arm.zero()),
      v_(VectorXd::Zero(arm.nv())) {
  refuse_friction(arm, "step_derivatives");
  if (!iterates_ && method != "rk4") bad_value("method", method, "must be \"implicit\" or \"rk4\"");
  refuse_balls(arm, "derivatives of steps");
  q0_ = v0_ = by_a_ = sum_q_ = sum_v_ = sum_tau_ = stage_q_ = stage_v_ = tau_ = v_;
  factor_ = Eigen::PartialPivLU<MatrixXd>(arm.nv());
}

Status StepDerivatives::operator()(Workspace& ws, VectorXd& q, VectorXd& v, const VectorXd& asked) {
  tau_ = asked;
  for (AppliedLimit& l : limits_) {
    l.asked = asked[l.rate];
    tau_[l.rate] = l.force();
  }
  for (std::size_t k = 0; k < ws.loads.size(); ++k) {
    forward_.set_wrench(k, ws.loads[k].wrench);
    inverse_.set_wrench(k, ws.loads[k].wrench);
  }
  q0_ = q;
  v0_ = v;
  const Status status = iterates_ ? implicit(ws, q, v, tau_) : classical(q, v, tau_);
  if (status != Status::ok) {
    q = q0_;
    v = v0_;
  }
  return status;
}

void StepDerivatives::keep(std::size_t stage) {
  stages_[stage].by_q = forward_.dq;
  stages_[stage].by_v = forward_.dv;
  stages_[stage].by_tau = forward_.dtau;
}

/// The equations of GeneralisedAlpha::place and iterate: alpha0 = a0 is that of forward dynamics at the beginning, and
/// with the residual of inverse dynamics at the end, M da + K dq + C dv = dtau; dq and dv as those of ImplicitEnd.
Status StepDerivatives::implicit(Workspace& ws, VectorXd& q, VectorXd& v, const VectorXd& tau) {
  if (const Status status = forward_(*arm_, q, v, tau); status != Status::ok) return status;
  keep(0);
  if (const Status status = step_.start(ws, q, v, tau); status != Status::ok) return status;
  if (const Status status = step_(ws, q, v, tau); status != Status::ok) return status;
  by_a_ = ws.a;
  inverse_(*arm_, q, v, by_a_);
  composite_mass_matrix(*arm_, ws, q);
  ws.M += alpha_.v_by_a * inverse_.dv + alpha_.q_by_a * inverse_.dq;
  if (!ws.M.allFinite()) return Status::not_finite;
  factor_.compute(ws.M);
  return Status::ok;
}

Status StepDerivatives::classical(VectorXd& q, VectorXd& v, const VectorXd& tau) {
  for (std::size_t s = 0; s < stages_.size(); ++s) {
    const double ahead = kTimes[s] * h_;  // of the stage before, which v_ and the accelerations are of
    q_ = q0_ + ahead * v_;
    v_ = v0_ + ahead * forward_.a;
    if (const Status status = forward_(*arm_, q_, v_, tau); status != Status::ok) return status;
    keep(s);
    q += kWeights[s] * h_ * v_;
    v += kWeights[s] * h_ * forward_.a;
  }
  return q.allFinite() && v.allFinite() ? Status::ok : Status::not_finite;
}

void StepDerivatives::matrices(MatrixXd& A, MatrixXd& B) {
  const Eigen::Index n = arm_->nv();
  A.resize(2 * n, 2 * n);
  B.resize(2 * n, n);
  VectorXd by_q(n), by_v(n), by_tau(n);
  for (Eigen::Index row = 0; row < 2 * n; ++row) {
    by_q.setZero();
    by_v.setZero();
    (row < n ? by_q[row] : by_v[row - n]) = 1.0;
    pull_back(by_q, by_v, by_tau);
    for (const AppliedLimit& l : limits_)
      if (l.cut() != 0.0) by_tau[l.rate] = 0.0;
    A.row(row) << by_q.transpose(), by_v.transpose();
    B.row(row) = by_tau.transpose();
  }
}

void StepDerivatives::pull_back(VectorXd& by_q, VectorXd& by_v, VectorXd& by_tau) {
  if (iterates_) {
    const Stage& start = stages_[0];
    by_a_ = alpha_.q_by_a * by_q + alpha_.v_by_a * by_v;
    by_tau = factor_.transpose().solve(by_a_);
    by_q.noalias() -= inverse_.dq.transpose() * by_tau;
    by_v.noalias() -= inverse_.dv.transpose() * by_tau;
    by_a_ = alpha_.q_by_a0 * by_q + alpha_.v_by_a0 * by_v;
    by_v += h_ * by_q;
    by_q.noalias() += start.by_q.transpose() * by_a_;
    by_v.noalias() += start.by_v.transpose() * by_a_;
    by_tau.noalias() += start.by_tau.transpose() * by_a_;
    return;
  }
  sum_q_ = by_q;
  sum_v_ = by_v;
  by_tau.setZero();
  stage_q_.setZero();  // by the stage behind, which begins where this one leads
  stage_v_.setZero();
  double ahead = 0.0;
  for (std::size_t s = stages_.size(); s-- > 0;) {
    by_a_ = kWeights[s] * h_ * by_v + ahead * stage_v_;
    stage_v_ = kWeights[s] * h_ * by_q + ahead * stage_q_;
    stage_v_.noalias() += stages_[s].by_v.transpose() * by_a_;
    stage_q_.noalias() = stages_[s].by_q.transpose() * by_a_;
    by_tau.noalias() += stages_[s].by_tau.transpose() * by_a_;
    sum_q_ += stage_q_;
    sum_v_ += stage_v_;
    ahead = kTimes[s] * h_;
  }
  by_q = sum_q_;
  by_v = sum_v_;
}

}  // namespace flexarm
