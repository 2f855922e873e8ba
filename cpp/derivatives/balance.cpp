// The forces of problems at the places of a tape.
#include <algorithm>

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

}  // namespace

void keep_sides(const Problem& of, Tape& tape) {
  Places at(of, tape);
  tape.sides.resize(static_cast<std::size_t>(tape.points() * at.limits()));
  for (Index e = 0; at.limits() > 0 && e < tape.points(); ++e) at.find_sides(e, tape.sides.data() + e * at.limits());
}

Balance balance(const Problem& of, const Tape& tape) {
  Places at(of, tape);
  Balance out{Rows(tape.points(), at.n), Rows(tape.points(), at.n)};
  VectorXd needed(at.n), applied(at.n);
  for (Index e = 0; e < tape.points(); ++e) {
    at.balance(e, needed, applied);
    out.needed.row(e) = needed;
    out.applied.row(e) = applied;
  }
  return out;
}

VectorXd weigh(const std::vector<const Problem*>& problems, const Tape& tape, const Rows& needed, const Rows& applied,
               int threads) {
  VectorXd out = VectorXd::Zero(static_cast<Index>(problems.size()));
  std::exception_ptr wrong;
  std::mutex lock;
  std::size_t next = 0;
  const auto group = [&]() -> std::pair<std::size_t, std::unique_ptr<SideBySide>> {
    const std::lock_guard<std::mutex> mine(lock);
    const std::size_t first = next;
    if (first == problems.size()) return {first, nullptr};
    auto found = std::make_unique<SideBySide>(problems, first, tape);
    next += found->size();
    return {first, std::move(found)};
  };
  const auto work = [&] {
    try {
      for (;;) {
        const auto [first, side] = group();
        if (!side) return;
        const auto from = static_cast<Index>(first);
        VectorXd need(needed.cols()), apply(needed.cols());
        for (Index e = 0; e < tape.points(); ++e) {
          if (needed.row(e).isZero(0.0) && applied.row(e).isZero(0.0)) continue;  // of a row that is not asked for
          (*side)(e, need, apply, [&, at = from](std::size_t k, const VectorXd& x, const VectorXd& y) {
            out[at + static_cast<Index>(k)] += needed.row(e).dot(x) + applied.row(e).dot(y);
          });
        }
      }
    } catch (...) {
      const std::lock_guard<std::mutex> mine(lock);
      wrong = std::current_exception();
      next = problems.size();
    }
  };
  const std::size_t groups = problems.size() / static_cast<std::size_t>(lanes::best_kernels().width) + 1;
  std::vector<std::thread> others;
  for (std::size_t k = 1; k < std::min(static_cast<std::size_t>(threads), groups); ++k) others.emplace_back(work);
  work();
  for (std::thread& t : others) t.join();
  if (wrong) std::rethrow_exception(wrong);
  return out;
}

}  // namespace flexarm
