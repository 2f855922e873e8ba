#include "flexarm/step_derivatives.hpp"

#include "flexarm/check.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/dry_friction.hpp"
#include "lanes/alpha.hpp"

namespace flexarm {

using Eigen::MatrixXd;
using Eigen::VectorXd;

StepDerivatives::StepDerivatives(const std::string& method, const Arm& arm, double h, const ImplicitOptions& options,
                                 const std::vector<Load>& loads)
    : arm_(&arm),
      h_(h),
      radius_(options.spectral_radius),
      iterates_(method == "implicit"),
      step_(method, arm, h, options),
      forward_(arm, loads),
      inverse_(arm, loads),
      q_(arm.zero()),
      v_(VectorXd::Zero(arm.nv())),
      q0_(q_),
      v0_(v_) {
  refuse_friction(arm, "step_derivatives");
  if (!iterates_ && method != "rk4") bad_value("method", method, "must be \"implicit\" or \"rk4\"");
  for (std::size_t n = 0; n < arm.size(); ++n)
    if (arm.link(n).joint().has_ball())
      bad_value("link[" + std::to_string(n) + "].joint", "a ball", "derivatives of steps know no quaternions");
  const Eigen::Index n = arm.nv();
  A.resize(2 * n, 2 * n);
  B.resize(2 * n, n);
  S_.resize(n, n);
  for (MatrixXd* m : {&by_q_, &by_v_, &by_a_, &sum_q_, &sum_v_}) m->resize(n, 3 * n);
  factor_ = Eigen::PartialPivLU<MatrixXd>(n);
}

void StepDerivatives::set_wrenches(const Workspace& ws) {
  for (std::size_t k = 0; k < ws.loads.size(); ++k) {
    forward_.set_wrench(k, ws.loads[k].wrench);
    inverse_.set_wrench(k, ws.loads[k].wrench);
  }
}

Status StepDerivatives::operator()(Workspace& ws, VectorXd& q, VectorXd& v, const VectorXd& tau) {
  set_wrenches(ws);
  q0_ = q;
  v0_ = v;
  const Status status = iterates_ ? implicit(ws, q, v, tau) : classical(ws, q, v, tau);
  const Eigen::Index n = arm_->nv();
  if (status == Status::ok) {
    A << by_q_.leftCols(2 * n), by_v_.leftCols(2 * n);
    B << by_q_.rightCols(n), by_v_.rightCols(n);
  } else {
    q = q0_;
    v = v0_;
  }
  return status;
}

/// The equations of GeneralisedAlpha::place and iterate, with alpha0 = a0 = forward dynamics, at the beginning, and a
/// that of inverse dynamics at the end.
Status StepDerivatives::implicit(Workspace& ws, VectorXd& q, VectorXd& v, const VectorXd& tau) {
  if (const Status status = forward_(*arm_, q, v, tau); status != Status::ok) return status;
  if (const Status status = step_.start(ws, q, v, tau); status != Status::ok) return status;
  if (const Status status = step_(ws, q, v, tau); status != Status::ok) return status;
  v_ = ws.a;
  inverse_(*arm_, q, v, v_);
  composite_mass_matrix(*arm_, ws, q);
  const AlphaNumbers alpha(radius_);
  const Eigen::Index n = arm_->nv();
  const double by_a = alpha.by_a(), rest = 1.0 - by_a;  // of the auxiliary acceleration, by a and a0
  const double at_q = h_ * h_ * (0.5 - alpha.beta + alpha.beta * rest), at_v = h_ * (1.0 - alpha.gamma * by_a);
  by_a_ << forward_.dq, forward_.dv, forward_.dtau;  // of a0
  by_q_ = at_q * by_a_;
  by_v_ = at_v * by_a_;
  by_q_.leftCols(n).diagonal().array() += 1.0;
  by_q_.middleCols(n, n).diagonal().array() += h_;
  by_v_.middleCols(n, n).diagonal().array() += 1.0;
  const double shift_q = h_ * h_ * alpha.beta * by_a, shift_v = h_ * alpha.gamma * by_a;
  S_ = ws.M + shift_v * inverse_.dv + shift_q * inverse_.dq;
  by_a_.noalias() = -inverse_.dq * by_q_;
  by_a_.noalias() -= inverse_.dv * by_v_;
  by_a_.rightCols(n).diagonal().array() += 1.0;
  factor_.compute(S_);
  by_a_ = factor_.solve(by_a_);
  by_q_ += shift_q * by_a_;
  by_v_ += shift_v * by_a_;
  return by_a_.allFinite() ? Status::ok : Status::singular;
}

/// Stage by stage: the method's text with derivatives.
Status StepDerivatives::classical(Workspace&, VectorXd& q, VectorXd& v, const VectorXd& tau) {
  constexpr double times[] = {0.0, 0.5, 0.5, 1.0}, weights[] = {1.0, 2.0, 2.0, 1.0};
  const Eigen::Index n = arm_->nv();
  sum_q_.setZero();
  sum_v_.setZero();
  VectorXd& a = forward_.a;
  for (int stage = 0; stage < 4; ++stage) {
    const double ahead = times[stage] * h_;
    // of the rates and coordinates at this stage, by those of the stage before (v_, a) and their derivatives
    if (stage == 0) {
      by_q_.setZero();
      by_v_.setZero();
      q_ = q0_;
      v_ = v0_;
    } else {
      q_ = q0_ + ahead * v_;
      v_ = v0_ + ahead * a;
      by_q_ = ahead * by_v_;
      by_v_ = ahead * by_a_;
    }
    by_q_.leftCols(n).diagonal().array() += 1.0;
    by_v_.middleCols(n, n).diagonal().array() += 1.0;
    if (const Status status = forward_(*arm_, q_, v_, tau); status != Status::ok) return status;
    by_a_.noalias() = forward_.dq * by_q_;
    by_a_.noalias() += forward_.dv * by_v_;
    by_a_.rightCols(n) += forward_.dtau;
    sum_q_ += weights[stage] / 6.0 * h_ * by_v_;
    sum_v_ += weights[stage] / 6.0 * h_ * by_a_;
    q += weights[stage] / 6.0 * h_ * v_;
    v += weights[stage] / 6.0 * h_ * a;
  }
  by_q_ = sum_q_;
  by_v_ = sum_v_;
  by_q_.leftCols(n).diagonal().array() += 1.0;
  by_v_.middleCols(n, n).diagonal().array() += 1.0;
  return q.allFinite() && v.allFinite() ? Status::ok : Status::not_finite;
}

}  // namespace flexarm
