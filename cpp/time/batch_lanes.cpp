#include "batch_lanes.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "flexarm/control.hpp"
#include "flexarm/dry_friction.hpp"
#include "lanes/methods.hpp"

namespace flexarm {

namespace {

using Index = Eigen::Index;

/// Up to so many scenarios, in parts of a pack's lanes, are run one by one, as one is in any case: a pack costs 1.2 to
/// 3 times what an arm by itself costs (bench/batch/few.py).
constexpr double kFew = 0.25;

}  // namespace

Index LaneGroup::width(const BatchProblem& p) {
  const int width = lanes::best_kernels().width;
  const bool few = static_cast<double>(std::max(p.whole, p.scenarios)) <= std::max(1.0, kFew * width);
  return p.lanes && !few ? width : 1;
}

LaneGroup::LaneGroup(const BatchProblem& problem, const BatchOutput& out, std::function<bool(long)> tell)
    : p_(problem), out_(out), tell_(std::move(tell)), kernels_(lanes::best_kernels()), width_(width(problem)) {
  one_for_all_ = p_.arms.size() == 1;
  for (const BatchLoad& l : p_.loads) one_for_all_ = one_for_all_ && l.places.size() == 1;
  const Arm& one = *p_.arms[0];
  std::vector<bool> given(static_cast<std::size_t>(one.nv()), false);
  for (const BatchMotion& m : p_.motions) given[static_cast<std::size_t>(m.coordinate)] = true;
  for (int i = 0; i < one.nv(); ++i) {
    if (!given[static_cast<std::size_t>(i)]) free_.push_back(i);
    coordinate_.push_back(one.coordinate_of(i));
  }
  const std::size_t w = static_cast<std::size_t>(width_);
  weight_.resize(w);
  status_.resize(w);
  reached_.resize(w);
  rows_done_.resize(w);
  q_.resize(w * static_cast<std::size_t>(one.nq()));
  v_.resize(w * static_cast<std::size_t>(one.nv()));
  farthest_.resize(q_.size());
  fastest_.resize(v_.size());
  std::vector<bool> rubs_anywhere(given.size(), false);
  for (const Arm* a : p_.arms)
    for (const Rub& r : rubs(*a)) rubs_anywhere[static_cast<std::size_t>(r.rate)] = true;
  for (const bool prescribed : {false, true})
    for (int i = 0; i < one.nv(); ++i)
      if (rubs_anywhere[static_cast<std::size_t>(i)] && given[static_cast<std::size_t>(i)] == prescribed) {
        rubbing_.push_back(i);
        rubbing_given_ += prescribed ? 1 : 0;
      }
  coulomb_.resize(w * rubbing_.size());
  stiction_.resize(w * rubbing_.size());
  std::vector<bool> limited(given.size(), false);
  for (const Arm* a : p_.arms)
    for (const AppliedLimit& l : torque_limits(*a)) limited[static_cast<std::size_t>(l.rate)] = true;
  for (int i = 0; i < one.nv(); ++i)
    if (limited[static_cast<std::size_t>(i)] && !given[static_cast<std::size_t>(i)]) limited_.push_back(i);
  most_.resize(w * limited_.size());
  laws_.resize(w * p_.feedback.size() * static_cast<std::size_t>(2 * one.nv() + one.nq() + 1));
}

Index LaneGroup::alike(Index first, Index count) {
  if (one_for_all_) {
    if (!p_.loads.empty() && loaded_.empty()) load(first);
    return count;
  }
  loaded_.clear();
  const lanes::KernelArm* one = load(first);
  Index n = 1;
  for (; n < count; ++n) {
    const lanes::KernelArm* other = load(first + n);
    if (!other->like(*one)) break;
  }
  return n;
}

const lanes::KernelArm* LaneGroup::load(Index b) {
  const lanes::KernelArm& bare = lanes::KernelArm::of(arm(b));
  if (p_.loads.empty()) return &bare;
  std::vector<Load> loads;
  for (const BatchLoad& l : p_.loads) loads.push_back(l.places[l.places.size() == 1 ? 0 : static_cast<std::size_t>(b)]);
  loaded_.push_back(std::make_unique<lanes::KernelArm>(bare.loaded(arm(b), loads)));
  return loaded_.back().get();
}

void LaneGroup::pack_numbers() {
  if (packed_ && one_for_all_) return;
  std::vector<const lanes::KernelArm*> arms;
  for (Index l = 0; l < width_; ++l) {
    const Arm& a = arm(scenario(l));
    if (p_.loads.empty())
      arms.push_back(&lanes::KernelArm::of(a));
    else
      arms.push_back(loaded_[one_for_all_ ? 0 : static_cast<std::size_t>(std::min(l, count_ - 1))].get());
    double mass = 0.0;
    for (const Link& link : a.links()) mass += link.mass();
    weight_[static_cast<std::size_t>(l)] = mass * a.gravity().squaredNorm();
  }
  std::vector<bool> given(coordinate_.size(), true);
  for (int i : free_) given[static_cast<std::size_t>(i)] = false;
  for (Index l = 0; l < width_; ++l) {
    const Arm& a = arm(scenario(l));
    for (Index i = 0; i < a.nq(); ++i) farthest_[static_cast<std::size_t>(i * width_ + l)] = a.farthest()[i];
    for (Index i = 0; i < a.nv(); ++i) fastest_[static_cast<std::size_t>(i * width_ + l)] = a.fastest()[i];
  }
  packed_ = width_ == 1 ? arms[0]->grouped(kernels_.width, given)
                        : lanes::KernelArm::side_by_side(arms, static_cast<int>(width_), given);
  pack_friction();
  pack_limits();
}

void LaneGroup::pack_friction() {
  std::fill(coulomb_.begin(), coulomb_.end(), 0.0);
  std::fill(stiction_.begin(), stiction_.end(), 0.0);
  if (rubbing_.empty()) return;
  for (Index l = 0; l < width_; ++l)
    for (const Rub& r : rubs(arm(scenario(l)))) {
      const auto c = std::find(rubbing_.begin(), rubbing_.end(), r.rate) - rubbing_.begin();
      coulomb_[static_cast<std::size_t>(c * width_ + l)] = r.coulomb;
      stiction_[static_cast<std::size_t>(c * width_ + l)] = r.stiction;
    }
}

void LaneGroup::pack_limits() {
  std::fill(most_.begin(), most_.end(), std::numeric_limits<double>::infinity());
  if (limited_.empty()) return;
  for (Index l = 0; l < width_; ++l)
    for (const AppliedLimit& limit : torque_limits(arm(scenario(l)))) {
      const auto at = std::find(limited_.begin(), limited_.end(), limit.rate);
      if (at != limited_.end()) most_[static_cast<std::size_t>((at - limited_.begin()) * width_ + l)] = limit.most;
    }
}

void LaneGroup::pack(const BatchTable& table, Index n, double* out) const {
  for (Index l = 0; l < width_; ++l) {
    const double* from = table.at(scenario(l));
    for (Index i = 0; i < n; ++i) out[i * width_ + l] = from[i];
  }
}

void LaneGroup::set(long step, long half, double* q, double* v, double* a, double* tau, double* offset,
                    double* wrenches) {
  const Index nv = static_cast<Index>(coordinate_.size());
  const Index held = p_.hold[static_cast<std::size_t>(step)];
  for (Index l = 0; l < width_; ++l) {
    const Index b = scenario(l);
    const double* t = p_.tau.at(b, held);
    for (Index i = 0; i < nv; ++i) tau[i * width_ + l] = t[i];
    for (const BatchForce& f : p_.forces) {
      const double u = *f.value.at(b, half);
      const double* column = f.column.at(b);
      for (Index i = 0; i < nv; ++i) tau[i * width_ + l] += u * column[i];
    }
    for (const BatchMotion& m : p_.motions) {
      const double* value = m.value.at(b, half);
      q[coordinate_[static_cast<std::size_t>(m.coordinate)] * width_ + l] = value[0];
      v[m.coordinate * width_ + l] = value[1];
      a[m.coordinate * width_ + l] = value[2];
    }
    for (std::size_t k = 0; k < p_.feedback.size(); ++k)
      offset[static_cast<Index>(k) * width_ + l] = *p_.feedback[k].reference.at(b, half);
    for (std::size_t k = 0; k < p_.loads.size(); ++k)
      for (Index i = 0; i < 6; ++i)
        wrenches[(6 * static_cast<Index>(k) + i) * width_ + l] = p_.loads[k].wrench.at(b, half)[i];
  }
}

bool LaneGroup::jumps(long step, double* changed) {
  const Index before = p_.hold[static_cast<std::size_t>(step - 1)], now = p_.hold[static_cast<std::size_t>(step)];
  if (before == now) return false;
  bool any = false;
  for (Index l = 0; l < width_; ++l) {
    const double *a = p_.tau.at(scenario(l), before), *b = p_.tau.at(scenario(l), now);
    const bool differ = !std::equal(a, a + coordinate_.size(), b);
    changed[l] = differ ? 1.0 : 0.0;
    any = any || differ;
  }
  return any;
}

int LaneGroup::wanted(long step) {
  if (row_ == static_cast<Index>(p_.rows.size()) || p_.rows[static_cast<std::size_t>(row_)] != step) return 0;
  return out_.a || out_.tau ? 2 : 1;
}

bool LaneGroup::alive(long step) {
  if (!pace_.due()) return true;
  const long news = step - told_;
  told_ = step;
  return tell_(news * static_cast<long>(count_));
}

void LaneGroup::row(const double* q, const double* v, const double* a, const double* tau, const int* status) {
  const auto rows = static_cast<Index>(p_.rows.size());
  for (Index l = 0; l < count_; ++l) {
    if (status[l] != 0) continue;
    const auto put = [&](double* block, const double* x, Index n) {
      if (!block) return;
      double* to = block + ((first_ + l) * rows + row_) * n;
      for (Index i = 0; i < n; ++i) to[i] = x[i * width_ + l];
    };
    put(out_.q, q, arm(0).nq());
    put(out_.v, v, arm(0).nv());
    put(out_.a, a, arm(0).nv());
    put(out_.tau, tau, arm(0).nv());
    rows_done_[static_cast<std::size_t>(l)] = row_ + 1;
  }
  ++row_;
}

void LaneGroup::run(Index first, Index count, BatchStats& stats) {
  first_ = first;
  count_ = count;
  pack_numbers();
  const Arm& one = arm(first);
  const Index nq = one.nq(), nv = one.nv(), laws = static_cast<Index>(p_.feedback.size());
  pack(p_.q0, nq, q_.data());
  pack(p_.v0, nv, v_.data());
  double* column = laws_.data();
  double *by_q = column + laws * nv * width_, *by_v = by_q + laws * nq * width_, *limit = by_v + laws * nv * width_;
  for (Index k = 0; k < laws; ++k) {
    const BatchFeedback& f = p_.feedback[static_cast<std::size_t>(k)];
    pack(f.column, nv, column + k * nv * width_);
    pack(f.by_q, nq, by_q + k * nq * width_);
    pack(f.by_v, nv, by_v + k * nv * width_);
    pack(f.limit, 1, limit + k * width_);
  }
  bool varies = false;
  for (const BatchForce& f : p_.forces) varies = varies || f.value.time != 0;
  for (const BatchLoad& l : p_.loads) varies = varies || l.wrench.time != 0;
  for (const BatchMotion& m : p_.motions) varies = varies || m.value.time != 0;
  for (const BatchFeedback& f : p_.feedback) varies = varies || f.reference.time != 0;
  std::fill(status_.begin(), status_.end(), 0);
  std::fill(rows_done_.begin(), rows_done_.end(), 0);
  row_ = 0;
  told_ = 0;

  lanes::Roll job{};
  job.width = static_cast<int>(width_);
  job.layout = &packed_->layout();
  job.numbers = packed_->numbers().data();
  job.length = p_.lengths.data();
  job.steps = static_cast<long>(p_.lengths.size());
  job.method = Methods::number(p_.integrator.c_str());
  job.options.spectral_radius = p_.spectral_radius;
  job.options.rtol = p_.rtol;
  job.weight = weight_.data();
  job.free = free_.data();
  job.coordinate = coordinate_.data();
  job.free_count = static_cast<int>(free_.size());
  job.farthest = farthest_.data();
  job.fastest = fastest_.data();
  job.laws = static_cast<int>(laws);
  job.column = column;
  job.by_q = by_q;
  job.by_v = by_v;
  job.limit = limit;
  job.limits = static_cast<int>(limited_.size());
  job.limited = limited_.data();
  job.most = most_.data();
  job.rubs = static_cast<int>(rubbing_.size()) - rubbing_given_;
  job.rubs_given = rubbing_given_;
  job.rubbing = rubbing_.data();
  job.coulomb = coulomb_.data();
  job.stiction = stiction_.data();
  job.varies = varies;
  job.scenarios = this;
  job.status = status_.data();
  job.reached = reached_.data();
  const std::size_t need = kernels_.roll_memory(job);
  if (need > memory_.size()) memory_ = lanes::Memory(need);
  kernels_.roll(job, memory_.get(), q_.data(), v_.data());
  tell_((job.steps - told_) * static_cast<long>(count_));
  for (Index l = 0; l < count_; ++l) {
    const std::size_t k = static_cast<std::size_t>(l);
    if (out_.status) out_.status[first + l] = status_[k];
    if (out_.reached) out_.reached[first + l] = p_.times[static_cast<std::size_t>(reached_[k])];
    fill_rows(p_, out_, first + l, rows_done_[k]);
    stats.steps += reached_[k];
    stats.evaluations += job.work.evaluations;
    stats.factorisations += job.work.factorisations;
    stats.iterations += job.work.solves;
  }
}

}  // namespace flexarm
