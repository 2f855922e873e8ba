// The forces of problems at the places of a tape.
#include <algorithm>
#include <array>
#include <tuple>

#include "places.hpp"
#include "setup/single.hpp"

namespace flexarm {

using namespace taped;

namespace {

/// A neighbour of one or more parameters, with its weight in each; and which elastic bodies of its arm are not those
/// of the run's.
struct NearArm {
  std::vector<std::pair<std::size_t, double>> of;
  const Problem* problem;
  lanes::KernelArm arm;
  std::vector<bool> own;  ///< of each node
};

lanes::KernelArm near_arm(const Problem& of) { return lanes::KernelArm::of(*of.arm).loaded(*of.arm, places(of.loads)); }

NearArm near_of(const Problem& problem, const lanes::KernelArm& run,
                std::vector<std::pair<std::size_t, double>> weights) {
  NearArm out{std::move(weights), &problem, near_arm(problem), {}};
  for (int i = 0; i < out.arm.layout().nodes; ++i) {
    const lanes::Node& node = out.arm.layout().node[i];
    const bool moved = std::any_of(problem.drives.begin(), problem.drives.end(), [&](const Drive& d) {
      return d.motion && d.coordinate >= node.ve && d.coordinate < node.ve + node.ne;
    });
    out.own.push_back(node.ne > 0 &&  // whose forces have those of loads, or gravity, among them, too
                      (moved || node.loads > 0 || node.slices > 0 || node.tied || node.body == lanes::Node::cut ||
                       !out.arm.same_body(i, run)));
  }
  return out;
}

/// Neighbours of one structure at the places of a tape, one in each lane of a pack: their inverse dynamics.
class SideBySide {
 public:
  /// Of as many from `first` on as are alike and fit.
  SideBySide(const std::vector<NearArm>& all, std::size_t first, const Tape& tape) : kernels_(lanes::best_lanes()) {
    std::vector<const lanes::KernelArm*> arms;
    const std::size_t nodes = all[first].own.size();
    own_ = std::make_unique<bool[]>(nodes);
    for (std::size_t k = first; k < all.size() && k < first + static_cast<std::size_t>(kernels_.width); ++k) {
      if (!all[k].arm.like(all[first].arm)) break;
      arms.push_back(&all[k].arm);
      near_.push_back(&all[k]);
      at_.push_back(std::make_unique<Places>(*all[k].problem, tape));
      for (std::size_t i = 0; i < nodes; ++i) own_[i] = own_[i] || all[k].own[i];
    }
    n_ = at_.front()->n;
    nq_ = all[first].problem->arm->nq();
    loads_ = static_cast<Index>(all[first].problem->loads.size());
    packed_ = std::make_unique<lanes::KernelArm>(
        lanes::KernelArm::side_by_side(arms, kernels_.width, std::vector<bool>(static_cast<std::size_t>(n_), false)));
    numbers_ = lanes::Memory(static_cast<std::size_t>((nq_ + 3 * n_ + 6 * loads_) * kernels_.width) * sizeof(double));
    inverse_.resize(n_);
    needed_.resize(n_);
    applied_.resize(n_);
  }
  std::size_t size() const { return at_.size(); }
  /// Whether some elastic body is the run's.
  bool shares() const {
    const lanes::Layout& layout = packed_->layout();
    for (int i = 0; i < layout.nodes; ++i)
      if (layout.node[i].ne > 0 && !own_[static_cast<std::size_t>(i)]) return true;
    return false;
  }
  /// Memory to work in, where the run's bodies are shared by those whose arms have bodies of the same sizes.
  struct Shared {
    lanes::Memory memory;
    std::unique_ptr<bool[]> known;
    std::vector<int> sizes;
    void forget() { std::fill_n(known.get(), sizes.size(), false); }
  };
  Shared& shared(std::vector<std::unique_ptr<Shared>>& all) const {
    const lanes::Layout& layout = packed_->layout();
    std::vector<int> sizes;
    for (int i = 0; i < layout.nodes; ++i) sizes.push_back(layout.node[i].ne);
    const std::size_t bytes = kernels_.side_memory(layout);
    for (const std::unique_ptr<Shared>& s : all)
      if (s->sizes == sizes && s->memory.size() == bytes) return *s;
    auto known = std::make_unique<bool[]>(sizes.size());
    all.push_back(std::make_unique<Shared>(Shared{lanes::Memory(bytes), std::move(known), std::move(sizes)}));
    return *all.back();
  }
  /// take(parameter, weight, e, needed, applied) of each; see Balance.
  template <class Take>
  void operator()(Index e, Shared& shared, const Take& take) {
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
    kernels_.inverse_side_by_side(packed_->layout(), packed_->numbers().data(), own_.get(), shared.memory.get(),
                                  shared.known.get(), wrenches, q, v, a, tau);
    for (std::size_t k = 0; k < at_.size(); ++k) {
      for (Index i = 0; i < n_; ++i) inverse_[i] = tau[i * w + static_cast<Index>(k)];
      at_[k]->balance(e, inverse_, needed_, applied_);
      for (const auto& [parameter, weight] : near_[k]->of) take(parameter, weight, e, needed_, applied_);
    }
  }

 private:
  const lanes::LaneKernels& kernels_;
  std::vector<const NearArm*> near_;
  std::vector<std::unique_ptr<Places>> at_;
  std::unique_ptr<bool[]> own_;
  std::unique_ptr<lanes::KernelArm> packed_;
  lanes::Memory numbers_;
  Index n_ = 0, nq_ = 0, loads_ = 0;
  VectorXd inverse_, needed_, applied_;
};

/// The same of neighbours with loops, each alone.
template <class Asked, class Take>
void one_by_one(const std::vector<NearArm>& all, const Tape& tape, const Asked& asked, const Take& take) {
  for (const NearArm& near : all) {
    Places at(*near.problem, tape);
    VectorXd needed(at.n + loop_equations(at.n, at.m)), applied(at.n);
    for (Index e = 0; e < tape.points(); ++e) {
      if (!asked(e)) continue;
      at.balance(e, needed, applied);
      for (const auto& [parameter, weight] : near.of) take(parameter, weight, e, needed, applied);
    }
  }
}

/// take(p, weight, e, needed, applied) for each neighbour of parameter p, at the places that are asked for: of those
/// parameters that change forces. All of one parameter are by one thread.
template <class Asked, class Take>
void for_neighbours(const Problem& of, const std::vector<Parameter>& parameters, const Tape& tape, int threads,
                    const Asked& asked, const Take& take) {
  struct Group {
    std::size_t parameter, alike;    ///< the first one of such arms
    double at_run = 0.0;             ///< weight of the run itself, which then is one of the neighbours
    std::vector<NearArm> near = {};  ///< the others
  };
  std::vector<Group> all;
  const lanes::KernelArm run = near_arm(of);
  for (std::size_t p = 0; p < parameters.size(); ++p) {
    if (parameters[p].start_only) continue;
    Group mine{p, all.size()};
    for (const Neighbour& n : parameters[p].neighbours) {
      if (n.offset == 0.0)
        mine.at_run += n.weight;
      else
        mine.near.push_back(near_of(n.problem, run, {{p, n.weight}}));
    }
    if (mine.near.empty())
      bad_value("neighbours of parameter " + std::to_string(p), 0, "must be one or more beside it");
    const auto like = [&](const Group& g) { return g.near.front().arm.like(mine.near.front().arm); };
    const auto first = std::find_if(all.begin(), all.end(), like);
    if (first != all.end()) mine.alike = first->alike;
    all.push_back(std::move(mine));
  }
  std::stable_sort(all.begin(), all.end(), [](const Group& x, const Group& y) {  // of the same bodies side by side
    return std::tie(y.near.front().own, x.alike) < std::tie(x.near.front().own, y.alike);
  });
  const std::size_t most = std::max<std::size_t>(1, std::min(static_cast<std::size_t>(threads), all.size()));
  std::exception_ptr wrong;
  std::mutex lock;
  const auto work = [&](std::size_t thread) {
    try {
      std::vector<NearArm> near;
      NearArm itself = near_of(of, run, {});
      for (std::size_t k = all.size() * thread / most; k < all.size() * (thread + 1) / most; ++k) {
        for (NearArm& n : all[k].near) near.push_back(std::move(n));
        if (all[k].at_run != 0.0) itself.of.emplace_back(all[k].parameter, all[k].at_run);
      }
      if (!itself.of.empty()) near.push_back(std::move(itself));
      if (!of.arm->loops().empty()) {
        one_by_one(near, tape, asked, take);
        return;
      }
      std::vector<std::unique_ptr<SideBySide>> sides;
      std::vector<std::unique_ptr<SideBySide::Shared>> shared;
      Index at_a_time = tape.points();
      for (std::size_t first = 0; first < near.size(); first += sides.back()->size()) {
        sides.push_back(std::make_unique<SideBySide>(near, first, tape));
        if (sides.back()->shares()) at_a_time = 1;
      }
      for (Index from = 0; from < tape.points(); from += at_a_time) {
        for (const std::unique_ptr<SideBySide::Shared>& s : shared) s->forget();
        for (const std::unique_ptr<SideBySide>& side : sides) {
          SideBySide::Shared& own = side->shared(shared);  // nothing is known in a new one
          for (Index e = from; e < from + at_a_time; ++e)
            if (asked(e)) (*side)(e, own, take);
        }
      }
    } catch (...) {
      const std::lock_guard<std::mutex> mine(lock);
      wrong = std::current_exception();
    }
  };
  std::vector<std::thread> others;
  for (std::size_t k = 1; k < most; ++k) others.emplace_back(work, k);
  work(0);
  for (std::thread& t : others) t.join();
  if (wrong) std::rethrow_exception(wrong);
}

}  // namespace

void complete(const Problem& of, Tape& tape) {
  Places at(of, tape);
  tape.sides.resize(static_cast<std::size_t>(tape.points() * at.limits()));
  for (Index e = 0; at.limits() > 0 && e < tape.points(); ++e) at.find_sides(e, tape.sides.data() + e * at.limits());
  tape.loops.clear();
  Rows loops(tape.points(), at.m);
  for (Index e = 0; at.m > 0 && e < tape.points(); ++e) loops.row(e) = at.find_loops(e);
  tape.loops.assign(loops.data(), loops.data() + loops.size());
  for (Tape::Closing& closing : tape.closings) at.find_closing(closing);
}

std::vector<Balance> balance_slopes(const Problem& of, const std::vector<Parameter>& parameters, const Tape& tape,
                                    int threads) {
  constexpr double kRounding = 1e-13;  // of the neighbours' forces: a smaller derivative is zero
  std::vector<Balance> out;
  std::vector<std::array<double, 2>> most(parameters.size(), {0.0, 0.0});
  for (const Parameter& p : parameters) {
    const Index n = p.neighbours.front().problem.arm->nv();
    const Index all = n + loop_equations(n, loop_rows(*p.neighbours.front().problem.arm));
    out.push_back({Rows::Zero(tape.points(), all), Rows::Zero(tape.points(), n)});
  }
  const std::vector<Index> shared = shared_places(tape);
  for_neighbours(
      of, parameters, tape, threads, [&](Index e) { return shared[static_cast<std::size_t>(e)] == e; },
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
        if (const Index same = shared[static_cast<std::size_t>(e)]; same != e) both[k]->row(e) = both[k]->row(same);
      if (both[k]->size() > 0 && both[k]->lpNorm<Eigen::Infinity>() < kRounding * weights * most[p][k])
        both[k]->setZero();
    }
  }
  return out;
}

VectorXd weigh(const Problem& of, const std::vector<Parameter>& parameters, const Tape& tape, const Rows& by_needed,
               const Rows& by_applied, int threads) {
  Rows needed = by_needed, applied = by_applied;
  const std::vector<Index> shared = shared_places(tape);
  for (Index e = 0; e < tape.points(); ++e) {
    const Index same = shared[static_cast<std::size_t>(e)];
    if (same == e) continue;
    for (Rows* x : {&needed, &applied}) {
      x->row(same) += x->row(e);
      x->row(e).setZero();
    }
  }
  VectorXd out = VectorXd::Zero(static_cast<Index>(parameters.size()));
  for_neighbours(
      of, parameters, tape, threads, [&](Index e) { return !needed.row(e).isZero(0.0) || !applied.row(e).isZero(0.0); },
      [&](std::size_t p, double weight, Index e, const VectorXd& x, const VectorXd& y) {
        out[static_cast<Index>(p)] += weight * (needed.row(e).dot(x) + applied.row(e).dot(y));
      });
  return out;
}

}  // namespace flexarm
