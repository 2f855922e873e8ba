// The data of a group of scenarios: their steps, and their numbers side by side.
#include "batch_lanes.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "flexarm/check.hpp"
#include "flexarm/control.hpp"
#include "flexarm/dry_friction.hpp"
#include "stepper.hpp"

namespace flexarm {

namespace {

using Index = Eigen::Index;

/// Up to so many scenarios, in parts of a pack's lanes, are run one by one, as one is in any case: a pack costs 1.2 to
/// 3 times as much as an arm by itself (bench/many/few.py).
constexpr double kFew = 0.25;
constexpr double kTooLong = 1e8;

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
  if (const double most = (t[last] - t[0]) / step; !(most <= kTooLong))
    bad_value("step", step, "asks for " + std::to_string(most) + " steps; must ask for at most 1e+08");
  const Control control = problem.control();
  double reached = t[0];
  ends.push_back(reached);
  output.push_back(0);
  for (Index k = 1; k <= last; ++k)
    while (reached < t[k]) {
      const double next = next_stop(problem.drives, problem.loads, control, reached, t[k], step, true);
      const double whole = next - reached;
      const long count = steps_to(whole, step);
      const double h = whole / static_cast<double>(count);
      for (long i = 1; i <= count; ++i) {
        lengths.push_back(h);
        ends.push_back(i == count ? next : reached + static_cast<double>(i) * h);
        output.push_back(i == count && next == t[k] ? k : -1);
      }
      reached = next;
    }
}

Index LaneGroup::width(const BatchProblem& p) {
  const int width = lanes::best_lanes().width;
  const bool few = static_cast<double>(std::max(p.whole, p.scenarios)) <= std::max(1.0, kFew * width);
  return p.lanes && !few ? width : 1;
}

LaneGroup::LaneGroup(const BatchProblem& problem, const BatchSteps& steps, const BatchOutput& out,
                     std::function<bool(long)> tell)
    : p_(problem),
      first_steps_(steps),
      out_(out),
      tell_(std::move(tell)),
      kernels_(lanes::best_lanes()),
      width_(width(problem)) {
  const Problem& one = *p_.problems[0];
  for (const auto& p : p_.problems) {
    one_for_all_ = one_for_all_ && (p_.problems.size() == 1 || (p->arm == one.arm && p->loads.empty()));
    for (const Drive& d : p->drives) forced_ = forced_ || bool(d.force);
    for (const Feedback& f : p->feedback) varies_ = varies_ || bool(f.reference);
  }
  const std::size_t w = static_cast<std::size_t>(width_), nq = static_cast<std::size_t>(one.arm->nq()),
                    nv = static_cast<std::size_t>(one.arm->nv());
  weight_.resize(w);
  status_.resize(w);
  reached_.resize(w);
  divided_.resize(w);
  doubt_.resize(w);
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
  varies_ = varies_ || forced_ || !moved_.empty() || !one.loads.empty();
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

}  // namespace flexarm
