#include "flexarm/step.hpp"

#include <cmath>

#include "flexarm/check.hpp"

namespace flexarm {

namespace {

constexpr double kSlow = 0.3;        // contraction above which the matrix is made anew within a step
constexpr double kBest = 1e-4;       // contraction that is believed without having been measured in the same step
constexpr double kRounding = 1e-14;  // parts of the applied forces: a residual below is noise
constexpr double kFloor = 1e-7;      // parts of the motion: an iteration that stalls below is at the end of its digits
constexpr double kGrown = 1.5;       // ratio of a step to the one before, above which nothing is extrapolated
constexpr double kSame = 1e-9;       // of that ratio to 1
constexpr double kForget = 0.99;     // per step, of the motion's scale

}  // namespace

ImplicitStep::ImplicitStep(const Arm& arm, double h, const ImplicitOptions& options)
    : arm_(&arm),
      h_(positive("step", h)),
      options_(options),
      q0_(arm.zero()),
      v0_(Eigen::VectorXd::Zero(arm.nv())),
      a0_(v0_),
      a_before_(v0_),
      alpha0_(v0_),
      alpha_(v0_),
      a_(v0_),
      u_(v0_),
      r_(v0_),
      turn_(v0_) {
  const double rho = options.spectral_radius;
  if (!(rho >= 0.0 && rho <= 1.0)) bad_value("spectral_radius", rho, "must be from 0 to 1");
  positive("rtol", options.rtol);
  if (options.max_iterations < 1) bad_value("max_iterations", options.max_iterations, "must be at least 1");
  alpha_m_ = (2.0 * rho - 1.0) / (rho + 1.0);
  alpha_f_ = rho / (rho + 1.0);
  gamma_ = 0.5 - alpha_m_ + alpha_f_;
  beta_ = 0.25 * (gamma_ + 0.5) * (gamma_ + 0.5);
  for (const Link& link : arm.links()) mass_ += link.mass();
}

Status ImplicitStep::start(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                           const Eigen::VectorXd& tau) {
  const Status status = jump(ws, q, v, tau);
  if (status != Status::ok) return status;
  contraction_ = 1.0;
  scale_ = 0.0;
  started_ = true;
  return Status::ok;
}

Status ImplicitStep::jump(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                          const Eigen::VectorXd& tau) {
  const Status status = forward_dynamics_ab(*arm_, ws, q, v, tau);
  if (status != Status::ok) return status;
  if (!ws.a.allFinite()) return Status::not_finite;
  a0_ = a_before_ = alpha0_ = ws.a;
  h_before_ = 0.0;
  return Status::ok;
}

/// Accelerations extrapolated, and the auxiliary ones that follow:
///   (1 - alpha_m) alpha + alpha_m alpha0 = (1 - alpha_f) a + alpha_f a0
/// The auxiliary ones lag the true ones by (alpha_f - alpha_m) h: where h changes, so does the lag. Where it grows
/// much, as behind a short pulse, they begin anew.
void ImplicitStep::predict(double h, const Workspace& ws) {
  const double ratio = h_before_ > 0.0 ? h / h_before_ : 0.0, ahead = ratio > kGrown ? 0.0 : ratio;
  if (std::abs(ratio - 1.0) > kSame)
    for (int i : ws.free) alpha0_[i] = a0_[i] + ahead * (alpha0_[i] - a0_[i]);
  a_ = ws.a;  // where prescribed
  u_.setZero();
  for (int i : ws.free) {
    a_[i] = a0_[i] + ahead * (a0_[i] - a_before_[i]);
    alpha_[i] = ((1.0 - alpha_f_) * a_[i] + alpha_f_ * a0_[i] - alpha_m_ * alpha0_[i]) / (1.0 - alpha_m_);
  }
}

/// q and v at the step's end from the auxiliary accelerations.
void ImplicitStep::place(double h, const Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v) {
  for (int i : ws.free) {
    u_[i] = h * v0_[i] + h * h * ((0.5 - beta_) * alpha0_[i] + beta_ * alpha_[i]);
    v[i] = v0_[i] + h * ((1.0 - gamma_) * alpha0_[i] + gamma_ * alpha_[i]);
  }
  for (std::size_t n = 0; n < arm_->size(); ++n) {
    const Link& link = arm_->link(n);
    const int i = arm_->first_q(n), j = arm_->first(n), nq = link.joint().nq(), nj = link.nj(), ne = link.ne();
    link.joint().displace(q0_.data() + i, u_.data() + j, q.data() + i);
    q.segment(i + nq, ne) = q0_.segment(i + nq, ne) + u_.segment(j + nj, ne);
  }
}

Status ImplicitStep::iterate(double h, Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v,
                             const Eigen::VectorXd& tau) {
  const double by_a = (1.0 - alpha_f_) / (1.0 - alpha_m_);  // d alpha / d a
  const Shift shift{h * gamma_ * by_a, h * h * beta_ * by_a};
  const double fall = h * arm_->gravity().norm();
  contraction_ = std::max(kBest, std::pow(contraction_, 0.8));  // old knowledge, doubted more with every step
  double last = 0.0, scale = 0.0;
  bool anew = true;
  for (iterations_ = 1; iterations_ <= options_.max_iterations; ++iterations_) {
    place(h, ws, q, v);
    inverse_dynamics<double>(*arm_, ws, q, v, a_, anew);
    ++counts_.evaluations;
    if (anew) {
      const Status status = factor_shifted(*arm_, ws, q, v, shift, true);
      ++counts_.factorisations;
      if (status != Status::ok) return Status::not_converged;  // the iteration has gone where no arm can be
      scale_ = std::max(ws.twice_kinetic, kForget * scale_);
      scale = std::sqrt(scale_ + mass_ * fall * fall);
    }
    double work = 0.0, residual = 0.0, force = 0.0;
    for (int i : ws.free) {
      r_[i] = tau[i] - ws.tau[i];
      residual = std::max(residual, std::abs(r_[i]));
      force = std::max(force, std::abs(tau[i]));
    }
    solve_shifted(*arm_, ws, r_, turn_);
    ++counts_.iterations;
    for (int i : ws.free) {
      work += r_[i] * turn_[i];  // turn^T S turn
      a_[i] += turn_[i];
      alpha_[i] += by_a * turn_[i];
    }
    if (!std::isfinite(work) || !std::isfinite(scale))
      return tau.allFinite() ? Status::not_converged : Status::not_finite;
    const double moved = shift.damping * std::sqrt(std::abs(work));  // of the velocities, in the norm of energy
    if (iterations_ > 1) contraction_ = moved < last ? moved / last : 1.0;
    const bool stalled = contraction_ > 0.5 && moved <= kFloor * scale;
    last = moved;
    const double left = std::min(1.0, contraction_ / std::max(1.0 - contraction_, 1e-3)) * moved;
    if (left <= options_.rtol * scale || residual <= kRounding * force || (iterations_ > 2 && stalled)) {
      place(h, ws, q, v);
      return Status::ok;
    }
    anew = iterations_ > 1 && contraction_ > kSlow;
  }
  iterations_ = options_.max_iterations;
  return Status::not_converged;
}

Status ImplicitStep::advance(double h, Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v,
                             const Eigen::VectorXd& tau, const Given& given) {
  if (!started_) {
    const Status status = start(ws, q, v, tau);
    if (status != Status::ok) return status;
  }
  v0_ = v;
  q0_ = q;
  if (given) given(1.0);
  for (std::size_t i = 0; i < ws.prescribed.size(); ++i)
    if (ws.prescribed[i]) q0_[arm_->coordinate_of(static_cast<int>(i))] = q[arm_->coordinate_of(static_cast<int>(i))];
  predict(h, ws);
  const Status status = iterate(h, ws, q, v, tau);
  if (status != Status::ok) {
    q = q0_;
    v = v0_;
    return status;
  }
  a_before_ = a0_;
  a0_ = a_;
  alpha0_ = alpha_;
  h_before_ = h;
  ws.a = a_;
  return Status::ok;
}

Rk4Step::Rk4Step(const Arm& arm, double h)
    : arm_(&arm),
      h_(positive("step", h)),
      q0_(arm.zero()),
      v0_(Eigen::VectorXd::Zero(arm.nv())),
      dq_(q0_),
      q_sum_(q0_),
      v_sum_(v0_) {}

Status Rk4Step::advance(double h, Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau,
                        const Given& given) {
  constexpr double times[] = {0.0, 0.5, 0.5, 1.0}, weights[] = {1.0, 2.0, 2.0, 1.0};
  q0_ = q;
  v0_ = v;
  q_sum_.setZero();
  v_sum_.setZero();
  Status status = Status::ok;
  for (int stage = 0; stage < 4 && status == Status::ok; ++stage) {
    if (stage > 0) {
      q = q0_ + times[stage] * h * dq_;
      v = v0_ + times[stage] * h * ws.a;
    }
    if (given) given(times[stage]);
    status = forward_dynamics_ab(*arm_, ws, q, v, tau);
    ++counts_.evaluations;
    coordinate_rates(*arm_, q, v, dq_);
    q_sum_ += weights[stage] * dq_;
    v_sum_ += weights[stage] * ws.a;
  }
  if (status == Status::singular) status = Status::not_finite;  // no arm is; the motion has run away
  q = q0_ + h / 6.0 * q_sum_;
  v = v0_ + h / 6.0 * v_sum_;
  if (given) given(1.0);
  for (std::size_t n = 0; n < arm_->size(); ++n) arm_->link(n).joint().normalise(q.data() + arm_->first_q(n));
  if (!q.allFinite() || !v.allFinite()) status = Status::not_finite;
  if (status != Status::ok) {
    q = q0_;
    v = v0_;
  }
  return status;
}

}  // namespace flexarm
