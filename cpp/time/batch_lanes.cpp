#include "batch_lanes.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "flexarm/check.hpp"
#include "flexarm/control.hpp"
#include "flexarm/dry_friction.hpp"
#include "lanes/methods.hpp"
#include "stepper.hpp"

namespace flexarm {

namespace {

using Index = Eigen::Index;

/// Up to so many scenarios, in parts of a pack's lanes, are run one by one, as one is in any case: a pack costs 1.2 to
/// 3 times what an arm by itself costs (bench/batch/few.py).
constexpr double kFew = 0.25;
constexpr double kMostSteps = 1e8;

bool same(const Eigen::VectorXd& a, const Eigen::VectorXd& b) { return a.size() == b.size() && a == b; }

/// Whether steps of the two must end at the same times.
bool same_clock(const Problem& a, const Problem& b) {
  const auto breaks = [](const auto& x, const auto& y) { return same(x.breaks, y.breaks); };
  const auto clocks = [](const Sampler& x, const Sampler& y) {
    return x.first == y.first && x.period == y.period && x.delay == y.delay;
  };
  const auto all = [](const auto& x, const auto& y, const auto& f) {
    return std::equal(x.begin(), x.end(), y.begin(), y.end(), f);
  };
  return &a == &b || (all(a.drives, b.drives, breaks) && all(a.loads, b.loads, breaks) &&
                      all(a.feedback, b.feedback, breaks) && all(a.samplers, b.samplers, clocks));
}

}  // namespace

BatchSteps::BatchSteps(const Problem& problem, const Eigen::VectorXd& t, double step) {
  const Index last = t.size() - 1;
  if (const double most = (t[last] - t[0]) / step; !(most <= kMostSteps))
    bad_value("step", step, "asks for " + std::to_string(most) + " steps; must ask for at most 1e+08");
  bool functions = false;
  std::vector<double> stops = sample_times(problem.drives, problem.loads, problem.control(), t, functions);
  auto stop = stops.begin();
  double reached = t[0];
  ends.push_back(reached);
  output.push_back(0);
  for (Index k = 1; k <= last; ++k)
    while (reached < t[k]) {  // as Stepper::next_stop and Stepper::advance have it
      stop = std::find_if(stop, stops.end(), [&](double x) { return x >= reached + kSameTime * step; });
      const bool output_next = stop == stops.end() || *stop > t[k] - kSameTime * step;
      const double next = output_next ? t[k] : *stop, whole = next - reached;
      const long count = std::max(1L, static_cast<long>(std::ceil(whole / step - kSameTime)));
      const double h = whole / static_cast<double>(count);
      for (long i = 1; i <= count; ++i) {
        lengths.push_back(h);
        ends.push_back(i == count ? next : reached + static_cast<double>(i) * h);
        output.push_back(i == count && output_next ? k : -1);
      }
      reached = next;
    }
}

LaneGroup::Alone::Watch::Watch(const Problem& problem, Control& control, const Method& by, double step)
    : system(problem, control), method(by.on(*problem.arm, step)), seen(system, problem.events, out) {
  system.rubbing = method->rubbing();
  out.events.resize(problem.events.size());
}

Index LaneGroup::width(const BatchProblem& p) {
  const int width = lanes::best_kernels().width;
  const bool few = static_cast<double>(std::max(p.whole, p.scenarios)) <= std::max(1.0, kFew * width);
  return p.lanes && !few ? width : 1;
}

LaneGroup::LaneGroup(const BatchProblem& problem, const BatchSteps& steps, const BatchOutput& out,
                     std::function<bool(long)> tell)
    : p_(problem),
      first_steps_(steps),
      out_(out),
      tell_(std::move(tell)),
      kernels_(lanes::best_kernels()),
      width_(width(problem)) {
  const Problem& one = *p_.problems[0];
  for (const auto& p : p_.problems) {
    one_for_all_ = one_for_all_ && (p_.problems.size() == 1 || (p->arm == one.arm && p->loads.empty()));
    for (const Drive& d : p->drives) forced_ = forced_ || d.force;
  }
  const std::size_t w = static_cast<std::size_t>(width_), nq = static_cast<std::size_t>(one.arm->nq()),
                    nv = static_cast<std::size_t>(one.arm->nv());
  weight_.resize(w);
  status_.resize(w);
  reached_.resize(w);
  rows_done_.resize(w);
  q_.resize(w * nq);
  v_.resize(w * nv);
  farthest_.resize(q_.size());
  fastest_.resize(v_.size());
  laws_.resize(w * one.feedback.size() * (2 * nv + nq + 1));
  q_one_.resize(one.arm->nq());
  v_one_.resize(one.arm->nv());
  a_one_ = v_one_;
  now_.motions.resize(nv);
  now_.offsets.resize(one.feedback.size());
  now_.wrenches.resize(one.loads.size());
  find_rates();
}

/// Which rates are prescribed, rub, and have limits.
void LaneGroup::find_rates() {
  const Problem& one = *p_.problems[0];
  const auto nv = static_cast<std::size_t>(one.arm->nv());
  std::vector<bool> given(nv, false), rubs_anywhere(nv, false), limited(nv, false);
  for (const Drive& d : one.drives)
    if (d.motion) given[static_cast<std::size_t>(d.coordinate)] = true;
  const Arm* before = nullptr;
  for (const auto& p : p_.problems) {
    if (p->arm.get() == before) continue;
    before = p->arm.get();
    for (const Rub& r : rubs(*before)) rubs_anywhere[static_cast<std::size_t>(r.rate)] = true;
    for (const AppliedLimit& l : torque_limits(*before)) limited[static_cast<std::size_t>(l.rate)] = true;
  }
  for (const bool prescribed : {false, true})
    for (int i = 0; i < one.arm->nv(); ++i) {
      const auto k = static_cast<std::size_t>(i);
      if (given[k] != prescribed) continue;
      (prescribed ? moved_ : free_).push_back(i);
      if (!prescribed && limited[k]) limited_.push_back(i);
      if (!rubs_anywhere[k]) continue;
      rubbing_.push_back(i);
      rubbing_given_ += prescribed ? 1 : 0;
    }
  for (int i = 0; i < one.arm->nv(); ++i) coordinate_.push_back(one.arm->coordinate_of(i));
  const std::size_t w = static_cast<std::size_t>(width_);
  coulomb_.resize(w * rubbing_.size());
  stiction_.resize(w * rubbing_.size());
  most_.resize(w * limited_.size());
}

Index LaneGroup::alike(Index first, Index count) {
  const Problem& one = problem(first);
  if (p_.problems.size() == 1 || same_clock(one, *p_.problems[0])) {
    steps_ = &first_steps_;
  } else {
    if (!own_steps_ || !same_clock(one, problem(own_of_))) own_steps_.emplace(one, p_.t, p_.step);
    own_of_ = first;
    steps_ = &*own_steps_;
  }
  if (p_.problems.size() == 1) {
    if (!one.loads.empty() && loaded_.empty()) load(first);
    return count;
  }
  loaded_.clear();
  const lanes::KernelArm* arm = load(first);
  Index n = 1;
  for (; n < count && same_clock(one, problem(first + n)); ++n)
    if (!one_for_all_ && !load(first + n)->like(*arm)) break;
  return n;
}

const lanes::KernelArm* LaneGroup::load(Index b) {
  const lanes::KernelArm& bare = lanes::KernelArm::of(arm(b));
  if (problem(b).loads.empty()) return &bare;
  loaded_.push_back(std::make_unique<lanes::KernelArm>(bare.loaded(arm(b), places(problem(b).loads))));
  return loaded_.back().get();
}

void LaneGroup::pack_numbers() {
  if (packed_ && one_for_all_) return;
  std::vector<const lanes::KernelArm*> arms;
  for (Index l = 0; l < width_; ++l) {
    const Arm& a = arm(scenario(l));
    if (loaded_.empty())
      arms.push_back(&lanes::KernelArm::of(a));
    else
      arms.push_back(loaded_[one_for_all_ ? 0 : static_cast<std::size_t>(std::min(l, count_ - 1))].get());
    double mass = 0.0;
    for (const Link& link : a.links()) mass += link.mass();
    weight_[static_cast<std::size_t>(l)] = mass * a.gravity().squaredNorm();
    for (Index i = 0; i < a.nq(); ++i) farthest_[static_cast<std::size_t>(i * width_ + l)] = a.farthest()[i];
    for (Index i = 0; i < a.nv(); ++i) fastest_[static_cast<std::size_t>(i * width_ + l)] = a.fastest()[i];
  }
  std::vector<bool> given(coordinate_.size(), false);
  for (int i : moved_) given[static_cast<std::size_t>(i)] = true;
  packed_ = width_ == 1 ? arms[0]->grouped(kernels_.width, given)
                        : lanes::KernelArm::side_by_side(arms, static_cast<int>(width_), given);
  pack_joints();
}

/// Dry friction and limits.
void LaneGroup::pack_joints() {
  std::fill(coulomb_.begin(), coulomb_.end(), 0.0);
  std::fill(stiction_.begin(), stiction_.end(), 0.0);
  std::fill(most_.begin(), most_.end(), std::numeric_limits<double>::infinity());
  const auto place = [this](const std::vector<int>& all, int rate, Index lane) {
    const auto at = std::find(all.begin(), all.end(), rate);
    return at == all.end() ? -1 : (at - all.begin()) * width_ + lane;
  };
  for (Index l = 0; l < width_ && !(rubbing_.empty() && limited_.empty()); ++l) {
    for (const Rub& r : rubs(arm(scenario(l)))) {
      const auto c = static_cast<std::size_t>(place(rubbing_, r.rate, l));
      coulomb_[c] = r.coulomb;
      stiction_[c] = r.stiction;
    }
    for (const AppliedLimit& limit : torque_limits(arm(scenario(l))))
      if (const Index c = place(limited_, limit.rate, l); c >= 0) most_[static_cast<std::size_t>(c)] = limit.most;
  }
}

void LaneGroup::pack_laws() {
  const Index nq = q_one_.size(), nv = v_one_.size(), laws = static_cast<Index>(problem(first_).feedback.size());
  double *column = laws_.data(), *by_q = column + laws * nv * width_, *by_v = by_q + laws * nq * width_,
         *limit = by_v + laws * nv * width_;
  for (Index k = 0; k < laws; ++k)
    for (Index l = 0; l < width_; ++l) {
      const Feedback& f = problem(scenario(l)).feedback[static_cast<std::size_t>(k)];
      for (Index i = 0; i < nv; ++i) column[(k * nv + i) * width_ + l] = f.column[i];
      for (Index i = 0; i < nq; ++i) by_q[(k * nq + i) * width_ + l] = f.by_q[i];
      for (Index i = 0; i < nv; ++i) by_v[(k * nv + i) * width_ + l] = f.by_v[i];
      limit[k * width_ + l] = f.limit;
    }
}

void LaneGroup::pack_start() {
  const auto pack = [this](const BatchTable& table, Index known, const Eigen::VectorXd& own, Index l, double* out) {
    for (Index i = 0; i < own.size(); ++i)
      out[i * width_ + l] = table.data && i < known ? table.at(scenario(l))[i] : own[i];
  };
  for (Index l = 0; l < width_; ++l) {
    pack(p_.q0, p_.row_q(), problem(scenario(l)).q0, l, q_.data());
    pack(p_.v0, p_.row_v(), problem(scenario(l)).v0, l, v_.data());
  }
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
      if (p_.problems.size() == 1) throw;
      std::throw_with_nested(ScenarioError(asked_));
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
      if (l == 0 || (p_.problems.size() > 1 && b != scenario(l - 1))) act(problem(b), t);
      if (forces) {
        for (Index i = 0; i < now_.tau.size(); ++i) tau[i * width_ + l] = now_.tau[i];
        for (Index i = 0; i < p_.row_v() && p_.tau.data; ++i) tau[i * width_ + l] += held(b)[i];
        for (Index i = 0; i < now_.tau.size() && !alone_.empty(); ++i)
          tau[i * width_ + l] += alone(l).control.held()[i];
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
  return out_.a || out_.tau ? 2 : 1;
}

bool LaneGroup::alive(long step) {
  if (broken_) return false;
  if (!pace_.due()) return true;
  const long news = step - told_;
  told_ = step;
  return tell_(news * static_cast<long>(count_));
}

void LaneGroup::row(const double* q, const double* v, const double* a, const double* tau, const int* status) {
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
  job.varies =
      !one.drives.empty() || !one.loads.empty() ||
      std::any_of(one.feedback.begin(), one.feedback.end(), [](const Feedback& f) { return bool(f.reference); });
  job.watched = !one.events.empty();
  job.scenarios = this;
  job.status = status_.data();
  job.reached = reached_.data();
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
  if (out_.events && watch) out_.events[b] = std::move(watch->out.events);
}

}  // namespace flexarm
