#include "batch_serial.hpp"

#include <algorithm>

namespace flexarm {

namespace {

using Index = Eigen::Index;

bool differs(const BatchTable& t) { return t.scenario != 0; }
bool changes(const BatchTable& t) { return t.time != 0; }

}  // namespace

Serial::Serial(const BatchProblem& problem, const BatchOutput& out, std::function<bool(long)> tell)
    : p_(problem), out_(out), tell_(std::move(tell)) {
  for (const BatchForce& f : p_.forces) {
    own_laws_ = own_laws_ || differs(f.column);
    varies_ = varies_ || changes(f.value);
  }
  for (const BatchLoad& l : p_.loads) {
    own_laws_ = own_laws_ || l.places.size() > 1;
    varies_ = varies_ || changes(l.wrench);
  }
  for (const BatchMotion& m : p_.motions) varies_ = varies_ || changes(m.value);
  for (const BatchFeedback& f : p_.feedback) {
    own_laws_ = own_laws_ || differs(f.column) || differs(f.by_q) || differs(f.by_v) || differs(f.limit);
    varies_ = varies_ || changes(f.reference);
  }
}

void Serial::run(Index scenario, BatchStats& stats) {
  b_ = scenario;
  prepare();
  const BatchStatus status = run_scenario(stats);
  if (out_.status) out_.status[b_] = static_cast<int>(status);
  if (out_.reached) out_.reached[b_] = p_.times[static_cast<std::size_t>(step_)];
  fill_rows(p_, out_, b_, row_done_);
}

/// The system and the method, made anew where the arm or the laws are others than before.
void Serial::prepare() {
  const Arm* arm = p_.arms[p_.arms.size() == 1 ? 0 : static_cast<std::size_t>(b_)];
  if (arm == arm_ && !own_laws_) return;
  const int nq = arm->nq(), nv = arm->nv();
  const auto vector = [this](const BatchTable& t, int n) {
    return Eigen::VectorXd(Eigen::Map<const Eigen::VectorXd>(t.at(b_), n));
  };
  system_.reset();
  tau_ = Eigen::VectorXd::Zero(nv);
  std::vector<Feedback> laws;
  for (const BatchFeedback& f : p_.feedback) {
    Feedback law{vector(f.column, nv), vector(f.by_q, nq), vector(f.by_v, nv)};
    law.reference = [this, &f](double) { return *f.reference.at(b_, half_); };
    law.limit = *f.limit.at(b_);
    laws.push_back(std::move(law));
  }
  drives_.clear();
  for (const BatchMotion& m : p_.motions) {
    Drive d{m.coordinate, {}, {}};
    d.motion = [this, &m](double) {
      const double* value = m.value.at(b_, half_);
      return MotionValue{value[0], value[1], value[2]};
    };
    drives_.push_back(std::move(d));
  }
  for (const BatchForce& f : p_.forces) {
    Drive d{0, {}, [this, &f](double) { return *f.value.at(b_, half_); }};
    d.column = vector(f.column, nv);
    drives_.push_back(std::move(d));
  }
  loads_.clear();
  for (const BatchLoad& l : p_.loads)
    loads_.push_back({l.places[l.places.size() == 1 ? 0 : static_cast<std::size_t>(b_)],
                      [this, &l](double) { return Vec6<double>(l.wrench.at(b_, half_)); }});
  control_ = std::make_unique<Control>(std::move(laws), std::vector<Sampler>{}, nv);
  system_ = std::make_unique<System>(*arm, drives_, loads_, tau_, control_.get());
  if (arm != arm_) {
    method_ =
        std::make_unique<OneStep>(p_.integrator, *arm, p_.lengths[0], ImplicitOptions{p_.spectral_radius, p_.rtol});
    row_.q.resize(1, nq);
    for (Trajectory::Rows* x : {&row_.v, &row_.a, &row_.tau, &row_.friction}) x->resize(1, nv);
    q_ = Eigen::VectorXd(nq);
    arm_ = arm;
  }
  system_->rubbing = method_->rubbing();
}

/// Holds a row of tau. @return whether the forces have changed
bool Serial::hold(Index row) {
  const Eigen::Map<const Eigen::VectorXd> tau(p_.tau.at(b_, row), arm_->nv());
  if (tau_ == tau) return false;
  tau_ = tau;
  system_->drive(0.0);
  return true;
}

BatchStatus Serial::run_scenario(BatchStats& stats) {
  System& s = *system_;
  const auto steps = static_cast<Index>(p_.lengths.size());
  const Step::Counts before = method_->counts();
  const Step::Given given = varies_ ? Step::Given([this](double c) {
    half_ = 2 * step_ + static_cast<Index>(2.0 * c);
    system_->drive(0.0);
  })
                                    : Step::Given();
  step_ = row_done_ = half_ = 0;
  s.q = Eigen::Map<const Eigen::VectorXd>(p_.q0.at(b_), arm_->nq());
  s.v = Eigen::Map<const Eigen::VectorXd>(p_.v0.at(b_), arm_->nv());
  tau_ = Eigen::Map<const Eigen::VectorXd>(p_.tau.at(b_, p_.hold[0]), arm_->nv());
  s.a.setZero();
  s.ws.a.setZero();
  s.drive(0.0);
  Status status = method_->start(s.ws, s.q, s.v, s.tau);
  long since = 0;
  bool stopped = false;
  while (status == Status::ok && write_row() && step_ < steps && !stopped) {
    const auto k = static_cast<std::size_t>(step_);
    status = method_->advance(p_.lengths[k], s.ws, s.q, s.v, s.tau, given);
    if (status != Status::ok) break;
    ++step_;
    half_ = 2 * step_;
    if (step_ < steps && p_.hold[k + 1] != p_.hold[k] && hold(p_.hold[k + 1]))
      status = method_->jump(s.ws, s.q, s.v, s.tau);
    ++since;
    if (pace_.due() || step_ == steps) {
      stopped = !tell_(since) && step_ < steps;
      since = 0;
    }
  }
  const Step::Counts& after = method_->counts();
  stats.steps += step_;
  stats.evaluations += after.evaluations - before.evaluations;
  stats.factorisations += after.factorisations - before.factorisations;
  stats.iterations += after.iterations - before.iterations;
  if (stopped) return BatchStatus::not_done;
  if (status == Status::ok && row_done_ < static_cast<Index>(p_.rows.size())) status = Status::not_finite;
  return static_cast<BatchStatus>(status);
}

/// Writes the state, if a row is due. @return whether it is finite
bool Serial::write_row() {
  if (row_done_ == static_cast<Index>(p_.rows.size()) || p_.rows[static_cast<std::size_t>(row_done_)] != step_)
    return true;
  System& s = *system_;
  q_ = s.q;
  if (out_.a || out_.tau) {
    row_.done = 0;
    const bool good = s.record(row_, false);
    s.q = q_;
    if (!good) return false;
  }
  for (std::size_t n = 0; n < arm_->size(); ++n) arm_->link(n).joint().normalise(q_.data() + arm_->first_q(n));
  put(out_.q, q_.data(), arm_->nq());
  put(out_.v, s.v.data(), arm_->nv());
  put(out_.a, row_.a.data(), arm_->nv());
  put(out_.tau, row_.tau.data(), arm_->nv());
  ++row_done_;
  return true;
}

void Serial::put(double* block, const double* x, int n) const {
  if (block) std::copy(x, x + n, block + (b_ * static_cast<Index>(p_.rows.size()) + row_done_) * n);
}

}  // namespace flexarm
