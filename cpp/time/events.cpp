#include "events.hpp"

#include <algorithm>

#include "flexarm/ab.hpp"

namespace flexarm {

namespace {

constexpr int kLooksInside = 8;  // places of an interpolated step at which events are looked at

}  // namespace

Eigen::Index write_row(const System& s, const Step* inside, Eigen::Index entry, double c, double t, Tape& tape) {
  Tape::Row row{entry, c, {}, {}, tape.add(t, s.q, s.v, s.ws.a)};
  if (s.rubbing) s.rubbing->ways(s.v, true, tape.last_ways());
  if (inside) inside->weights(c, row.v_by_a, row.q_by_a);
  tape.rows.push_back(std::move(row));
  return static_cast<Eigen::Index>(tape.rows.size()) - 1;
}

StepCubic::StepCubic(const System& s)
    : q0_(s.q), q1_(q0_), dq0_(q0_), dq1_(q0_), v0_(s.v), v1_(v0_), a0_(v0_), a1_(v0_) {}

void StepCubic::look(System& s, double t, bool between, Eigen::VectorXd& dq, Eigen::VectorXd& a) {
  s.drive(t);
  coordinate_rates(s.arm, s.q, s.v, dq);
  s.accelerate(between);
  a = s.ws.a;
}

void StepCubic::place(System& s, double t) const {
  const double h = t1_ - t0_, x = (t - t0_) / h, y = 1.0 - x;
  if (t < t1_) {
    s.q = y * y * ((1.0 + 2.0 * x) * q0_ + x * h * dq0_) + x * x * ((1.0 + 2.0 * y) * q1_ - y * h * dq1_);
    s.v = y * y * ((1.0 + 2.0 * x) * v0_ + x * h * a0_) + x * x * ((1.0 + 2.0 * y) * v1_ - y * h * a1_);
  } else {
    s.q = q1_;
    s.v = v1_;
  }
  s.drive(t);
  normalise(s.arm, s.q);
}

StepEvents::StepEvents(System& system, const std::vector<Event>& events, Trajectory& out, Tape* tape,
                       const Step* inside)
    : s_(system),
      events_(events),
      out_(out),
      tape_(tape),
      inside_(inside),
      values0_(static_cast<Eigen::Index>(events.size())),
      values1_(values0_),
      values_(values0_),
      q0_(s_.q),
      v0_(s_.v),
      q1_(q0_),
      v1_(v0_),
      cubic_(s_) {
  found_.reserve(events.size());
}

void StepEvents::start(double t) {
  if (events_.empty()) return;
  s_.evaluate(events_, t, values0_.data());
  t0_ = t;
  q0_ = s_.q;
  v0_ = s_.v;
}

bool StepEvents::look(double t) {
  if (events_.empty()) return false;
  t1_ = t;
  s_.evaluate(events_, t, values1_.data());
  found_.clear();
  for (std::size_t k = 0; k < events_.size(); ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    if (crosses(values0_[i], values1_[i], events_[k].direction)) found_.emplace_back(t, k);
  }
  bool ended = false;
  if (!found_.empty()) {
    const auto write_end = [this](double end) { (end == t0_ ? before_ : after_) = write(end); };
    cubic_.prepare(s_, t0_, q0_, v0_, t, s_.rubbing && !s_.rubbing->switches_within(), write_end);
    for (auto& [time, k] : found_) time = locate(k);
    std::sort(found_.begin(), found_.end());
    for (const auto& [time, k] : found_) {
      if (ended && time > out_.reached) break;
      cubic_.place(s_, time);
      s_.close_loops(t - t0_);
      ended = s_.log(events_, k, time, out_) || ended;
      if (tape_) tape_->occurrences.push_back({k, time, before_, after_});
    }
    cubic_.place(s_, t);
  }
  values0_.swap(values1_);
  t0_ = t;
  q0_ = s_.q;
  v0_ = s_.v;
  return ended;
}

void StepEvents::look_through(double from, double h) {
  if (events_.empty()) return;
  const double end = out_.reached;
  if (inside_) {
    q1_ = s_.q;
    v1_ = s_.v;
    for (int k = 1; k < kLooksInside && !out_.terminated; ++k) {
      const double c = static_cast<double>(k) / kLooksInside;
      inside_->inside(c, s_.q, s_.v);
      s_.drive(from + c * h);
      look(from + c * h);
    }
    s_.drive(end, q1_, v1_);
  }
  if (!out_.terminated) look(end);
}

/// A row of the tape, of this state at time t. A method that interpolates may look in the middle of its last step.
Eigen::Index StepEvents::write(double t) const {
  if (!tape_) return -1;
  auto entry = static_cast<Eigen::Index>(tape_->entries.size()) - 1;
  while (tape_->entries[static_cast<std::size_t>(entry)].h == 0.0) --entry;  // which came behind the step
  if (!inside_) return write_row(s_, nullptr, t == t0_ ? entry - 1 : entry, 1.0, t, *tape_);
  return write_row(s_, inside_, entry, (t - tape_->now) / tape_->entries[static_cast<std::size_t>(entry)].h, t, *tape_);
}

/// By bisection, to the last digit: the end after the zero.
double StepEvents::locate(std::size_t k) {
  const Eigen::Index i = static_cast<Eigen::Index>(k);
  const bool rising = values0_[i] < 0.0;
  double low = t0_, high = t1_;
  for (;;) {
    const double middle = 0.5 * (low + high);
    if (!(middle > low && middle < high)) return high;
    cubic_.place(s_, middle);
    s_.evaluate(events_, middle, values_.data());
    ((rising ? values_[i] >= 0.0 : values_[i] <= 0.0) ? high : low) = middle;
  }
}

}  // namespace flexarm
