#include "flexarm/computed_torque.hpp"

#include <algorithm>
#include <cmath>

#include "flexarm/check.hpp"
#include "flexarm/dry_friction.hpp"

namespace flexarm {

namespace {

constexpr int kMostSteps = 50, kHalvings = 10;
constexpr double kContracts = 0.1;  // of a step by the one before: else the stiffness is factored anew
constexpr double kClose = 1e-11;    // parts of the sag that the last step may be
constexpr double kNothing = 1e-14;
constexpr double kLeastShare = 1e-3;  // of the load that a step puts on

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
      kept_(q_),
      sags_(sags) {
  refuse_loops(arm, "computed torque");
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
  left_ = step_ = next_ = base_ = first_ = Eigen::VectorXd::Zero(n);
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

void ComputedTorque::look(double share) {
  inverse_dynamics(*arm_, ws_, q_, none_, none_);
  for (Eigen::Index k = 0; k < left_.size(); ++k) left_[k] = ws_.tau[elastic_[static_cast<std::size_t>(k)]];
  if (share < 1.0) left_ -= (1.0 - share) * first_;
}

void ComputedTorque::factor() {
  slopes_(*arm_, q_, none_, none_, false);
  for (Eigen::Index i = 0; i < K_.rows(); ++i)
    for (Eigen::Index j = 0; j < K_.cols(); ++j) K_(i, j) = slopes_.dq(elastic_[static_cast<std::size_t>(i)], place(j));
  factored_ = K_.allFinite();
  if (factored_) factor_.compute(K_);
}

/// Newton's steps, with the stiffness of an earlier place while they contract, shortened until the next one is smaller
/// (P. Deuflhard, Newton Methods for Nonlinear Problems, 2004, ch. 3.3).
Status ComputedTorque::settle(double share) {
  look(share);
  if (!factored_) factor();
  bool fresh = false;
  for (int steps = 0; steps < kMostSteps; ++steps) {
    if (!factored_ || !left_.allFinite()) return Status::not_finite;
    step_.noalias() = factor_.solve(left_);
    const double size = step_.cwiseAbs().maxCoeff();
    double sag = 0.0, length = 1.0;
    for (Eigen::Index k = 0; k < base_.size(); ++k) {
      base_[k] = q_[place(k)];
      sag = std::max(sag, std::abs(base_[k]));
    }
    const bool last = size <= kClose * sag + kNothing;
    double after = 0.0;
    bool shorter = false;
    for (int halving = 0; halving <= kHalvings && !shorter; ++halving, length *= 0.5) {
      for (Eigen::Index k = 0; k < base_.size(); ++k) q_[place(k)] = base_[k] - length * step_[k];
      if (last) return Status::ok;
      look(share);
      next_.noalias() = factor_.solve(left_);
      after = next_.cwiseAbs().maxCoeff();
      shorter = next_.allFinite() && after <= (1.0 - 0.25 * length) * size;
      if (!shorter && !fresh) break;
    }
    if (!shorter) {
      for (Eigen::Index k = 0; k < base_.size(); ++k) q_[place(k)] = base_[k];
      if (fresh) return Status::not_converged;
      look(share);
    }
    fresh = !shorter || after > kContracts * size;
    if (fresh) factor();
  }
  return Status::not_converged;
}

/// Static balance from where the elastic coordinates are, else from straight, with the load put on in steps.
Status ComputedTorque::balance() {
  if (settle(1.0) == Status::ok) return Status::ok;
  for (int i : elastic_) q_[arm_->coordinate_of(i)] = 0.0;
  factored_ = false;
  look(1.0);
  if (!left_.allFinite()) return Status::not_finite;
  first_ = left_;
  kept_ = q_;
  double share = 0.0, step = 0.25;
  while (share < 1.0 && step >= kLeastShare) {
    const double to = std::min(1.0, share + step);
    factored_ = false;
    if (settle(to) == Status::ok) {
      share = to;
      step *= 2.0;
      kept_ = q_;
    } else {
      step *= 0.5;
      q_ = kept_;
    }
  }
  factored_ = factored_ && share >= 1.0;
  return share >= 1.0 ? Status::ok : Status::not_converged;
}

Status ComputedTorque::forces() {
  if (sags_ && !elastic_.empty()) {
    const Status found = balance();
    if (found != Status::ok) {  // begin anew the next time
      for (int i : elastic_) q_[arm_->coordinate_of(i)] = 0.0;
      factored_ = false;
      return found;
    }
  }
  inverse_dynamics(*arm_, ws_, q_, v_, a_);
  for (const Axis& x : axes_) tau[x.rate] = std::min(std::max(ws_.tau[x.rate], -x.limit), x.limit);
  return tau.allFinite() ? Status::ok : Status::not_finite;
}

TorqueLaw::TorqueLaw(std::shared_ptr<const Arm> own, std::vector<ComputedTorque::Axis> axes, bool sags,
                     std::vector<Place> at, int count)
    : arm(std::move(own)),
      of(*arm, std::move(axes), sags),
      places(std::move(at)),
      rates(count),
      own_q(arm->zero()),
      own_v(Eigen::VectorXd::Zero(arm->nv())) {
  if (places.size() != of.axes().size()) bad_value("places", places.size(), "must be one for each axis");
  for (const Place& x : places)
    if (x.q < 0 || x.v < 0 || x.v >= rates) bad_value("place of an axis", x.v, "must be a rate of the arm");
}

void TorqueLaw::check(Status status, double t) {
  if (status == Status::ok) return;
  const std::string where = "computed torque at t = " + std::to_string(t);
  if (status == Status::not_converged)
    bad_value(where, "no static balance", "the elastic coordinates find none there; take elastic=\"zero\"");
  bad_value(where, "nan or inf", "q, v and the reference must be finite");
}

void TorqueLaw::operator()(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd&,
                           Eigen::VectorXd& force) {
  for (std::size_t k = 0; k < places.size(); ++k) {
    const int rate = of.axes()[k].rate;
    own_q[arm->coordinate_of(rate)] = q[places[k].q];
    own_v[rate] = v[places[k].v];
  }
  check(of(t, own_q, own_v), t);
  force.setZero(rates);
  for (std::size_t k = 0; k < places.size(); ++k) force[places[k].v] = of.tau[of.axes()[k].rate];
}

}  // namespace flexarm
