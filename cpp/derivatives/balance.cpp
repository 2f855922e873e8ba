// The forces of problems at the places of a tape.
#include <algorithm>
#include <array>

#include "places.hpp"
#include "setup/single.hpp"

namespace flexarm {

using namespace taped;

namespace {

/// Problems of one structure at the places of a tape, their inverse dynamics side by side in the lanes of a pack.
class SideBySide {
 public:
  /// As many of those from `first` on as are alike and fit.
  SideBySide(const std::vector<const Problem*>& all, std::size_t first, const Tape& tape)
      : kernels_(lanes::best_kernels()) {
    std::vector<std::unique_ptr<lanes::KernelArm>> arms;
    std::vector<const lanes::KernelArm*> them;
    for (std::size_t k = first; k < all.size() && k < first + static_cast<std::size_t>(kernels_.width); ++k) {
      const Arm& arm = *all[k]->arm;
      arms.push_back(std::make_unique<lanes::KernelArm>(lanes::KernelArm::of(arm).loaded(arm, places(all[k]->loads))));
      if (!arms.back()->like(*arms.front())) break;
      them.push_back(arms.back().get());
      at_.push_back(std::make_unique<Places>(*all[k], tape));
    }
    n_ = at_.front()->n;
    nq_ = all[first]->arm->nq();
    loads_ = static_cast<Index>(all[first]->loads.size());
    if (at_.size() == 1) return;
    packed_ = std::make_unique<lanes::KernelArm>(
        lanes::KernelArm::side_by_side(them, kernels_.width, std::vector<bool>(static_cast<std::size_t>(n_), false)));
    memory_ = lanes::Memory(kernels_.side_memory(packed_->layout()));
    numbers_ = lanes::Memory(static_cast<std::size_t>((nq_ + 3 * n_ + 6 * loads_) * kernels_.width) * sizeof(double));
    tau_.resize(n_);
  }
  std::size_t size() const { return at_.size(); }
  /// take(k, needed, applied) of each problem; see Balance.
  template <class Take>
  void operator()(Index e, VectorXd& needed, VectorXd& applied, const Take& take) {
    if (at_.size() == 1) {
      at_.front()->balance(e, needed, applied);
      take(0, needed, applied);
      return;
    }
    const Index w = kernels_.width;
    double *q = static_cast<double*>(numbers_.get()), *v = q + nq_ * w, *a = v + n_ * w, *tau = a + n_ * w,
           *wrenches = tau + n_ * w;
    for (Index l = 0; l < w; ++l) {  // lanes beyond the last repeat it
      const System& s = at_[std::min(static_cast<std::size_t>(l), at_.size() - 1)]->move(e);
      for (Index i = 0; i < nq_; ++i) q[i * w + l] = s.q[i];
      for (Index i = 0; i < n_; ++i) {
        v[i * w + l] = s.v[i];
        a[i * w + l] = s.a[i];
      }
      for (Index i = 0; i < 6 * loads_; ++i)
        wrenches[i * w + l] = s.ws.loads[static_cast<std::size_t>(i / 6)].wrench[i % 6];
    }
    kernels_.inverse_side_by_side(packed_->layout(), packed_->numbers().data(), memory_.get(), wrenches, q, v, a, tau);
    for (std::size_t k = 0; k < at_.size(); ++k) {
      for (Index i = 0; i < n_; ++i) tau_[i] = tau[i * w + static_cast<Index>(k)];
      at_[k]->balance(e, tau_, needed, applied);
      take(k, needed, applied);
    }
  }

 private:
  const lanes::Kernels& kernels_;
  std::vector<std::unique_ptr<Places>> at_;
  std::unique_ptr<lanes::KernelArm> packed_;
  lanes::Memory memory_, numbers_;
  Index n_ = 0, nq_ = 0, loads_ = 0;
  VectorXd tau_;
};

/// take(p, weight, e, needed, applied) for each neighbour of parameter p, at the places that are asked for: of those
/// parameters that change forces. All of one parameter are by one thread.
template <class Asked, class Take>
void for_neighbours(const std::vector<Parameter>& parameters, const Tape& tape, int threads, const Asked& asked,
                    const Take& take) {
  struct Near {
    std::size_t parameter;
    double weight;
  };
  std::exception_ptr wrong;
  std::mutex lock;
  std::size_t next = 0;
  const auto width = static_cast<std::size_t>(lanes::best_kernels().width);
  /// The next parameters whose neighbours fill the lanes.
  const auto group = [&](std::vector<Near>& near, std::vector<const Problem*>& problems) {
    const std::lock_guard<std::mutex> mine(lock);
    near.clear();
    problems.clear();
    for (; next < parameters.size(); ++next) {
      const Parameter& p = parameters[next];
      if (p.start_only) continue;
      if (!near.empty() && near.size() + p.neighbours.size() > width) return;
      for (const Neighbour& n : p.neighbours) {
        near.push_back({next, n.weight});
        problems.push_back(&n.problem);
      }
    }
  };
  const auto work = [&] {
    try {
      std::vector<Near> near;
      std::vector<const Problem*> problems;
      for (;;) {
        group(near, problems);
        if (near.empty()) return;
        for (std::size_t first = 0; first < near.size();) {
          SideBySide side(problems, first, tape);
          VectorXd needed(problems[first]->arm->nv()), applied(needed.size());
          for (Index e = 0; e < tape.points(); ++e)
            if (asked(e))
              side(e, needed, applied, [&](std::size_t k, const VectorXd& x, const VectorXd& y) {
                take(near[first + k].parameter, near[first + k].weight, e, x, y);
              });
          first += side.size();
        }
      }
    } catch (...) {
      const std::lock_guard<std::mutex> mine(lock);
      wrong = std::current_exception();
      next = parameters.size();
    }
  };
  std::vector<std::thread> others;
  const std::size_t most = std::min(static_cast<std::size_t>(threads), parameters.size());
  for (std::size_t k = 1; k < most; ++k) others.emplace_back(work);
  work();
  for (std::thread& t : others) t.join();
  if (wrong) std::rethrow_exception(wrong);
}

}  // namespace

void keep_sides(const Problem& of, Tape& tape) {
  Places at(of, tape);
  tape.sides.resize(static_cast<std::size_t>(tape.points() * at.limits()));
  for (Index e = 0; at.limits() > 0 && e < tape.points(); ++e) at.find_sides(e, tape.sides.data() + e * at.limits());
}

std::vector<Balance> balance_slopes(const std::vector<Parameter>& parameters, const Tape& tape, int threads) {
  constexpr double kRounding = 1e-13;  // of the neighbours' forces: a smaller derivative is zero
  std::vector<Balance> out;
  std::vector<std::array<double, 2>> most(parameters.size(), {0.0, 0.0});
  for (const Parameter& p : parameters) {
    const Index n = p.neighbours.front().problem.arm->nv();
    out.push_back({Rows::Zero(tape.points(), n), Rows::Zero(tape.points(), n)});
  }
  const std::vector<Index> shared = shared_places(tape);
  for_neighbours(
      parameters, tape, threads, [&](Index e) { return shared[static_cast<std::size_t>(e)] == e; },
      [&](std::size_t p, double weight, Index e, const VectorXd& needed, const VectorXd& applied) {
        out[p].needed.row(e) += weight * needed.transpose();
        out[p].applied.row(e) += weight * applied.transpose();
        most[p][0] = std::max(most[p][0], needed.lpNorm<Eigen::Infinity>());
        most[p][1] = std::max(most[p][1], applied.lpNorm<Eigen::Infinity>());
      });
  for (std::size_t p = 0; p < out.size(); ++p) {
    double weights = 0.0;
    for (const Neighbour& n : parameters[p].neighbours) weights += std::abs(n.weight);
    Rows* both[] = {&out[p].needed, &out[p].applied};
    for (int k = 0; k < 2; ++k) {
      for (Index e = 0; e < tape.points(); ++e)
        if (const Index of = shared[static_cast<std::size_t>(e)]; of != e) both[k]->row(e) = both[k]->row(of);
      if (both[k]->size() > 0 && both[k]->lpNorm<Eigen::Infinity>() < kRounding * weights * most[p][k])
        both[k]->setZero();
    }
  }
  return out;
}

VectorXd weigh(const std::vector<Parameter>& parameters, const Tape& tape, const Rows& by_needed,
               const Rows& by_applied, int threads) {
  Rows needed = by_needed, applied = by_applied;
  const std::vector<Index> shared = shared_places(tape);
  for (Index e = 0; e < tape.points(); ++e) {
    const Index of = shared[static_cast<std::size_t>(e)];
    if (of == e) continue;
    for (Rows* x : {&needed, &applied}) {
      x->row(of) += x->row(e);
      x->row(e).setZero();
    }
  }
  VectorXd out = VectorXd::Zero(static_cast<Index>(parameters.size()));
  for_neighbours(
      parameters, tape, threads, [&](Index e) { return !needed.row(e).isZero(0.0) || !applied.row(e).isZero(0.0); },
      [&](std::size_t p, double weight, Index e, const VectorXd& x, const VectorXd& y) {
        out[static_cast<Index>(p)] += weight * (needed.row(e).dot(x) + applied.row(e).dot(y));
      });
  return out;
}

}  // namespace flexarm
