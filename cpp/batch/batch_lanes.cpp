#include "batch_lanes.hpp"

#include <algorithm>

#include "flexarm/control.hpp"
#include "step/methods.hpp"
#include "stepper.hpp"

namespace flexarm {

using Index = Eigen::Index;

LaneGroup::Alone::Watch::Watch(const Problem& problem, Control& control, const Method& by, double step)
    : system(problem, control), method(by.on(*problem.arm, step)), seen(system, problem.events, out) {
  system.rubbing = method->rubbing();
  out.events.resize(problem.events.size());
}

void LaneGroup::begin_alone() {
  alone_.clear();
  const Problem& one = problem(first_);
  if (one.samplers.empty() && one.events.empty()) return;
  for (Index l = 0; l < count_; ++l) {
    const Problem& p = problem(first_ + l);
    alone_.push_back({p.control(), {}});
  }
  for (Index l = 0; l < count_ && !one.events.empty(); ++l)  // now that they stay where they are
    alone(l).watch = std::make_unique<Alone::Watch>(problem(first_ + l), alone(l).control, p_.method, p_.step);
}

template <class F>
void LaneGroup::guarded(const F& f) {
  if (broken_) return;
  try {
    f();
  } catch (const Interrupted&) {
    broken_ = true;
  } catch (...) {
    broken_ = true;
    try {
      throw_again(p_, asked_);
    } catch (...) {
      error_ = std::current_exception();
    }
  }
}

bool LaneGroup::goes_on(Index lane) const {
  const auto& watch = alone_[static_cast<std::size_t>(lane)].watch;
  return status_[static_cast<std::size_t>(lane)] == 0 && !(watch && watch->out.terminated);
}

void LaneGroup::act(const Problem& problem, double t) {
  now_.tau = problem.tau;
  std::fill(now_.offsets.begin(), now_.offsets.end(), 0.0);
  ask_laws(
      problem.drives, problem.loads, problem.feedback, t,
      [&](std::size_t k, const MotionValue& m) {
        now_.motions[static_cast<std::size_t>(problem.drives[k].coordinate)] = m;
      },
      [&](std::size_t k, double force) {
        const Drive& d = problem.drives[k];
        if (d.column.size() > 0)
          now_.tau += force * d.column;
        else
          now_.tau[d.coordinate] += force;
      },
      [&](std::size_t k, const Vec6<double>& wrench) { now_.wrenches[k] = wrench; },
      [&](std::size_t k, double offset) { now_.offsets[k] = offset; });
}

void LaneGroup::set(long half, double* q, double* v, double* a, double* tau, double* offset, double* wrenches) {
  guarded([&] {
    const double t = steps_->at(half);
    const bool forces = forced_ || fresh_;
    for (Index l = 0; l < width_; ++l) {
      const Index b = asked_ = scenario(l);
      if (p_.problems.size() == 1 ? l == 0 && (varies_ || half == 0) : l == 0 || b != scenario(l - 1))
        act(problem(b), t);
      if (forces) {
        const Index nv = now_.tau.size(), rows = p_.tau.data ? p_.row_v() : 0;
        const double* row = held(b);
        for (Index i = 0; i < rows; ++i) tau[i * width_ + l] = now_.tau[i] + row[i];
        for (Index i = rows; i < nv; ++i) tau[i * width_ + l] = now_.tau[i];
        for (Index i = 0; i < nv && !alone_.empty(); ++i) tau[i * width_ + l] += alone(l).control.held()[i];
      }
      for (int i : moved_) {
        const MotionValue& m = now_.motions[static_cast<std::size_t>(i)];
        q[coordinate_[static_cast<std::size_t>(i)] * width_ + l] = m.q;
        v[i * width_ + l] = m.v;
        a[i * width_ + l] = m.a;
      }
      for (std::size_t k = 0; k < now_.offsets.size(); ++k)
        offset[static_cast<Index>(k) * width_ + l] = now_.offsets[k];
      for (std::size_t k = 0; k < now_.wrenches.size(); ++k)
        for (Index i = 0; i < 6; ++i) wrenches[(6 * static_cast<Index>(k) + i) * width_ + l] = now_.wrenches[k][i];
    }
    fresh_ = false;
  });
}

int LaneGroup::due(long step) {
  const double t = time(step) + kSameTime * p_.step;
  for (const Alone& one : alone_)
    if (one.control.due(t)) return 2;
  const Index k = steps_->output[static_cast<std::size_t>(step)];
  return k > 0 && k + 1 < p_.t.size() && p_.tau.time != 0 ? 1 : 0;
}

bool LaneGroup::change(long step, const double* q, const double* v, const double* a, double* changed) {
  bool any = false;
  guarded([&] {
    const Index before = interval_, k = steps_->output[static_cast<std::size_t>(step)];
    if (k >= 0) interval_ = std::min(k, p_.t.size() - 2);
    for (Index l = 0; l < width_; ++l) {
      const Index b = asked_ = scenario(l);
      changed[l] = l > 0 && l >= count_ ? changed[count_ - 1] : 0.0;
      if (l >= count_) continue;
      if (p_.tau.data && interval_ != before) {
        const double *x = p_.tau.at(b, before), *y = held(b);
        if (!std::equal(x, x + p_.row_v(), y)) changed[l] = 1.0;
      }
      if (!alone_.empty() && goes_on(l)) {
        const auto one = [&](const double* from, Eigen::VectorXd& to) {
          for (Index i = 0; i < to.size(); ++i) to[i] = from[i * width_ + l];
        };
        one(q, q_one_);
        one(v, v_one_);
        one(a, a_one_);
        if (alone(l).control.run(time(step) + kSameTime * p_.step, q_one_, v_one_, a_one_)) changed[l] = 1.0;
      }
      any = any || changed[l] != 0.0;
    }
    fresh_ = fresh_ || any;
  });
  return any;
}

bool LaneGroup::look(long step, const double* q, const double* v, double* ended) {
  bool any = false;
  guarded([&] {
    for (Index l = 0; l < width_; ++l) {
      ended[l] = l >= count_ ? ended[count_ - 1] : 0.0;
      if (l >= count_ || !goes_on(l)) continue;
      asked_ = scenario(l);
      Alone::Watch& w = *alone(l).watch;
      for (Index i = 0; i < w.system.q.size(); ++i) w.system.q[i] = q[i * width_ + l];
      for (Index i = 0; i < w.system.v.size(); ++i) w.system.v[i] = v[i * width_ + l];
      w.system.constant_tau = problem(asked_).tau;
      for (Index i = 0; i < p_.row_v() && p_.tau.data; ++i) w.system.constant_tau[i] += held(asked_)[i];
      if (step == 0)
        w.seen.start(time(0));
      else if (w.seen.look(time(step)))
        ended[l] = 1.0;
      any = any || ended[l] != 0.0;
    }
  });
  return any;
}

int LaneGroup::wanted(long step) {
  const Index k = steps_->output[static_cast<std::size_t>(step)];
  if (k < 0 || k % p_.every != 0) return 0;
  return out_.a || out_.tau || out_.contacts || out_.loops ? 2 : 1;
}

bool LaneGroup::alive(long step) {
  if (broken_) return false;
  if (!pace_.due()) return true;
  const long news = step - told_;
  told_ = step;
  return tell_(news * static_cast<long>(count_));
}

void LaneGroup::row(const double* q, const double* v, const double* a, const double* tau, const double* reactions,
                    const int* status) {
  const Index rows = p_.rows(), k = row_ * p_.every;
  for (Index l = 0; l < count_; ++l) {
    const bool over =
        !alone_.empty() && alone(l).watch && alone(l).watch->out.terminated && alone(l).watch->out.reached < p_.t[k];
    if (status[l] != 0 || over) continue;
    const auto put = [&](double* block, const double* x, Index n) {
      if (!block) return;
      double* to = block + ((first_ + l) * rows + row_) * n;
      for (Index i = 0; i < n; ++i) to[i] = x[i * width_ + l];
    };
    put(out_.q, q, p_.row_q());
    put(out_.v, v, p_.row_v());
    put(out_.a, a, p_.row_v());
    put(out_.tau, tau, p_.row_v());
    put(out_.contacts, reactions, p_.row_contacts());
    put(out_.loops, reactions + p_.row_contacts() * width_, p_.row_loops());
    rows_done_[static_cast<std::size_t>(l)] = row_ + 1;
  }
  ++row_;
}

void LaneGroup::run(Index first, Index count, BatchStats& stats) {
  first_ = first;
  count_ = count;
  pack_numbers();
  pack_laws();
  pack_start();
  begin_alone();
  const Problem& one = problem(first);
  const Index nq = q_one_.size(), nv = v_one_.size(), laws = static_cast<Index>(one.feedback.size());
  std::fill(status_.begin(), status_.end(), 0);
  std::fill(rows_done_.begin(), rows_done_.end(), 0);
  row_ = interval_ = 0;
  told_ = 0;
  fresh_ = true;

  lanes::Roll job{};
  job.width = static_cast<int>(width_);
  job.layout = &packed_->layout();
  job.numbers = packed_->numbers().data();
  job.length = steps_->lengths.data();
  job.steps = steps_->count();
  job.method = Methods::number(p_.method.name.c_str());
  job.options.spectral_radius = p_.method.spectral_radius;
  if (p_.method.rtol != 0.0) job.options.rtol = p_.method.rtol;
  job.weight = weight_.data();
  job.free = free_.data();
  job.coordinate = coordinate_.data();
  job.free_count = static_cast<int>(free_.size());
  job.farthest = farthest_.data();
  job.fastest = fastest_.data();
  job.laws = static_cast<int>(laws);
  job.column = laws_.data();
  job.by_q = job.column + laws * nv * width_;
  job.by_v = job.by_q + laws * nq * width_;
  job.limit = job.by_v + laws * nv * width_;
  job.limits = static_cast<int>(limited_.size());
  job.limited = limited_.data();
  job.most = most_.data();
  job.rubs = static_cast<int>(rubbing_.size()) - rubbing_given_;
  job.rubs_given = rubbing_given_;
  job.rubbing = rubbing_.data();
  job.coulomb = coulomb_.data();
  job.stiction = stiction_.data();
  job.varies = varies_;
  job.watched = !one.events.empty();
  job.scenarios = this;
  job.status = status_.data();
  job.reached = reached_.data();
  job.divided = divided_.data();
  job.doubt = doubt_.data();
  const std::size_t need = kernels_.roll_memory(job);
  if (need > memory_.size()) memory_ = lanes::Memory(need);
  kernels_.roll(job, memory_.get(), q_.data(), v_.data());
  if (error_) std::rethrow_exception(error_);
  tell_((job.steps - told_) * static_cast<long>(count_));
  for (Index l = 0; l < count_; ++l) {
    const std::size_t k = static_cast<std::size_t>(l);
    end_alone(l);
    fill_rows(p_, out_, first + l, rows_done_[k]);
    stats.steps += reached_[k];
    stats.evaluations += job.work.evaluations;
    stats.factorisations += job.work.factorisations;
    stats.iterations += job.work.solves;
  }
}

/// Tells how the scenario of a lane has ended.
void LaneGroup::end_alone(Index lane) {
  const auto k = static_cast<std::size_t>(lane);
  const Index b = first_ + lane;
  Alone::Watch* watch = alone_.empty() ? nullptr : alone(lane).watch.get();
  const bool over = watch && watch->out.terminated;
  if (out_.status) out_.status[b] = broken_ ? static_cast<int>(BatchStatus::not_done) : status_[k];
  if (out_.reached) out_.reached[b] = over ? watch->out.reached : time(reached_[k]);
  if (out_.stats) {
    out_.stats[b].steps = reached_[k];
    out_.stats[b].failed_steps = static_cast<long>(divided_[k]);
    out_.stats[b].doubt = doubt_[k];
  }
  if (out_.events && watch) out_.events[b] = std::move(watch->out.events);
}

}  // namespace flexarm
