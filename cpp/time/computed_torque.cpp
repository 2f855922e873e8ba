#include "flexarm/computed_torque.hpp"

#include <algorithm>
#include <cmath>

#include "flexarm/check.hpp"

namespace flexarm {

namespace {

constexpr int kMostSteps = 50;
constexpr double kContracts = 0.1;  // of a step by the one before: else the stiffness is factored anew
constexpr double kClose = 1e-11;    // parts of the sag that the last step may be
constexpr double kNothing = 1e-14;

}  // namespace

ComputedTorque::ComputedTorque(const Arm& arm, std::vector<Axis> axes, bool sags)
    : tau(Eigen::VectorXd::Zero(arm.nv())),
      arm_(&arm),
      axes_(std::move(axes)),
      ws_(arm),
      slopes_(arm),
      q_(arm.zero()),
      v_(tau),
      a_(tau),
      none_(tau),
      sags_(sags) {
  std::vector<int> count(static_cast<std::size_t>(arm.nv()), 0);
  for (const Axis& x : axes_) {
    if (x.rate < 0 || x.rate >= arm.nv()) bad_value("rate of an axis", x.rate, "must be one of the arm's");
    if (arm.coordinate_of(x.rate) < 0) bad_value("rate of an axis", x.rate, "is a ball's, which has no angle");
    if (!x.reference) bad_value("reference of an axis", "none", "must be a function of time");
    if (!std::isfinite(x.kp) || !std::isfinite(x.kv)) bad_value("kp, kv", "nan or inf", "must be finite");
    if (!(x.limit > 0.0)) bad_value("limit", x.limit, "must be positive");
    ++count[static_cast<std::size_t>(x.rate)];
  }
  for (std::size_t n = 0; n < arm.size(); ++n)
    for (int i = arm.first(n); i < (n + 1 < arm.size() ? arm.first(n + 1) : arm.nv()); ++i) {
      const bool joint = i < arm.first(n) + arm.link(n).joint().nv();
      if (!joint) elastic_.push_back(i);
      if (count[static_cast<std::size_t>(i)] != (joint ? 1 : 0))
        bad_value("axes of rate " + std::to_string(i), count[static_cast<std::size_t>(i)],
                  joint ? "must be one for each freedom of each joint" : "is no joint's");
    }
  const auto n = static_cast<Eigen::Index>(elastic_.size());
  left_ = step_ = Eigen::VectorXd::Zero(n);
  K_ = Eigen::MatrixXd::Zero(n, n);
  factor_ = Eigen::PartialPivLU<Eigen::MatrixXd>(n);
}

Status ComputedTorque::operator()(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  for (const Axis& x : axes_) {
    const MotionValue r = x.reference(t);
    const int at = arm_->coordinate_of(x.rate);
    q_[at] = q[at];
    v_[x.rate] = v[x.rate];
    a_[x.rate] = r.a + x.kv * (r.v - v[x.rate]) + x.kp * (r.q - q[at]);
  }
  return forces();
}

Status ComputedTorque::feed_forward(double t, bool inertia) {
  for (const Axis& x : axes_) {
    const MotionValue r = x.reference(t);
    q_[arm_->coordinate_of(x.rate)] = r.q;
    v_[x.rate] = inertia ? r.v : 0.0;
    a_[x.rate] = inertia ? r.a : 0.0;
  }
  return forces();
}

Status ComputedTorque::forces() {
  double before = 0.0;
  int steps = sags_ && !elastic_.empty() ? 0 : -1;
  while (steps >= 0) {
    inverse_dynamics(*arm_, ws_, q_, none_, none_);
    for (Eigen::Index k = 0; k < left_.size(); ++k) left_[k] = ws_.tau[elastic_[static_cast<std::size_t>(k)]];
    if (!factored_ || (steps > 1 && step_.cwiseAbs().maxCoeff() > kContracts * before)) {
      slopes_(*arm_, q_, none_, none_, false);
      for (Eigen::Index i = 0; i < K_.rows(); ++i)
        for (Eigen::Index j = 0; j < K_.cols(); ++j)
          K_(i, j) = slopes_.dq(elastic_[static_cast<std::size_t>(i)],
                                arm_->coordinate_of(elastic_[static_cast<std::size_t>(j)]));
      factored_ = K_.allFinite();
      if (factored_) factor_.compute(K_);
    }
    before = step_.cwiseAbs().maxCoeff();
    if (factored_) step_.noalias() = factor_.solve(left_);
    double sag = 0.0;
    for (Eigen::Index k = 0; k < left_.size(); ++k) {
      double& e = q_[arm_->coordinate_of(elastic_[static_cast<std::size_t>(k)])];
      e -= step_[k];
      if (!std::isnan(sag) && !(std::abs(e) <= sag)) sag = std::abs(e);  // nan stays
    }
    if (!factored_ || !std::isfinite(sag) || ++steps > kMostSteps) {  // begin anew the next time
      const Status found = std::isfinite(sag) && factored_ ? Status::not_converged : Status::not_finite;
      for (int i : elastic_) q_[arm_->coordinate_of(i)] = 0.0;
      step_.setZero();
      factored_ = false;
      return found;
    }
    if (step_.cwiseAbs().maxCoeff() <= kClose * sag + kNothing) break;
  }
  inverse_dynamics(*arm_, ws_, q_, v_, a_);
  for (const Axis& x : axes_) tau[x.rate] = std::min(std::max(ws_.tau[x.rate], -x.limit), x.limit);
  return tau.allFinite() ? Status::ok : Status::not_finite;
}

}  // namespace flexarm
