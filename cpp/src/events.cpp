#include "events.hpp"

#include <algorithm>

#include "flexarm/ab.hpp"

namespace flexarm {

namespace {

constexpr int kParts = 8;  // places looked at in a step with an interpolant: such steps are long

}  // namespace

StepEvents::StepEvents(System& system, const std::vector<Event>& events, Trajectory& out)
    : s_(system),
      events_(events),
      out_(out),
      values0_(static_cast<Eigen::Index>(events.size())),
      values1_(values0_),
      values_(values0_),
      q0_(s_.q),
      q1_(q0_),
      dq0_(q0_),
      dq1_(q0_),
      v0_(s_.v),
      v1_(v0_),
      a0_(v0_),
      a1_(v0_) {
  found_.reserve(events.size());
}

void StepEvents::start(double t) {
  if (events_.empty()) return;
  s_.evaluate(events_, t, values0_.data());
  t0_ = t;
  q0_ = s_.q;
  v0_ = s_.v;
}

bool StepEvents::look(double t, const Inside* inside) {
  if (events_.empty()) return false;
  inside_ = inside;
  prepared_ = false;
  t1_ = t;
  q1_ = s_.q;
  v1_ = s_.v;
  bool ended = false, moved = false;
  double from = t0_;
  for (int part = 1, parts = inside ? kParts : 1; part <= parts && !ended; ++part) {
    const double to = part == parts ? t : t0_ + (t - t0_) * part / parts;
    if (parts > 1 || moved) place(to);
    s_.evaluate(events_, to, values1_.data());
    found_.clear();
    for (std::size_t k = 0; k < events_.size(); ++k) {
      const double before = values0_[static_cast<Eigen::Index>(k)], after = values1_[static_cast<Eigen::Index>(k)];
      const bool up = before < 0.0 && after >= 0.0, down = before > 0.0 && after <= 0.0;
      if ((up && events_[k].direction >= 0) || (down && events_[k].direction <= 0)) found_.emplace_back(to, k);
    }
    for (auto& [time, k] : found_) time = locate(k, from, to);
    std::sort(found_.begin(), found_.end());
    for (const auto& [time, k] : found_) {
      if (ended && time > out_.reached) break;
      place(time);
      ended = s_.log(events_, k, time, out_) || ended;
    }
    moved = moved || parts > 1 || !found_.empty();
    values0_.swap(values1_);
    from = to;
  }
  if (moved) place(t);
  t0_ = t;
  q0_ = s_.q;
  v0_ = s_.v;
  return ended;
}

/// Rates and accelerations at both ends of the step.
void StepEvents::prepare() {
  prepared_ = true;
  const auto slopes = [&](double time, const Eigen::VectorXd& q, const Eigen::VectorXd& v, Eigen::VectorXd& dq,
                          Eigen::VectorXd& a) {
    s_.q = q;
    s_.v = v;
    s_.drive(time);
    coordinate_rates(s_.arm, s_.q, s_.v, dq);
    forward_dynamics_ab(s_.arm, s_.ws, s_.q, s_.v, s_.tau);
    a = s_.ws.a;
  };
  slopes(t0_, q0_, v0_, dq0_, a0_);
  slopes(t1_, q1_, v1_, dq1_, a1_);
}

/// The system's state at a time within the step.
void StepEvents::place(double t) {
  const double h = t1_ - t0_, x = (t - t0_) / h, y = 1.0 - x;
  if (t < t1_ && inside_) {
    (*inside_)(x, s_.q, s_.v);
  } else if (t < t1_) {
    if (!prepared_) prepare();
    s_.q = y * y * ((1.0 + 2.0 * x) * q0_ + x * h * dq0_) + x * x * ((1.0 + 2.0 * y) * q1_ - y * h * dq1_);
    s_.v = y * y * ((1.0 + 2.0 * x) * v0_ + x * h * a0_) + x * x * ((1.0 + 2.0 * y) * v1_ - y * h * a1_);
  } else {
    s_.q = q1_;
    s_.v = v1_;
  }
  s_.drive(t);
  for (std::size_t n = 0; n < s_.arm.size(); ++n) s_.arm.link(n).joint().normalise(s_.q.data() + s_.arm.first_q(n));
}

/// By bisection, to the last digit: the end after the zero.
double StepEvents::locate(std::size_t k, double low, double high) {
  const Eigen::Index i = static_cast<Eigen::Index>(k);
  const bool rising = values0_[i] < 0.0;
  for (;;) {
    const double middle = 0.5 * (low + high);
    if (!(middle > low && middle < high)) return high;
    place(middle);
    s_.evaluate(events_, middle, values_.data());
    ((rising ? values_[i] >= 0.0 : values_[i] <= 0.0) ? high : low) = middle;
  }
}

}  // namespace flexarm
