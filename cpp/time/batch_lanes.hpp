// Scenarios of a batch: in the lanes of a pack, or one by one.
#pragma once

#include <algorithm>
#include <chrono>
#include <functional>
#include <vector>

#include "flexarm/batch.hpp"
#include "lanes/single.hpp"

namespace flexarm {

/// Nan into the rows of a scenario from `row` on.
void fill_rows(const BatchProblem& problem, const BatchOutput& out, Eigen::Index scenario, Eigen::Index row);

/// When to look at more than the steps at hand: about every millisecond or two, however short or long a step is.
class Pace {
 public:
  /// After each step.
  bool due() {
    if (++since_ < every_) return false;
    const auto now = std::chrono::steady_clock::now();
    every_ = now - last_ > std::chrono::milliseconds(1) ? std::max(1, every_ / 2) : std::min(64, 2 * every_);
    last_ = now;
    since_ = 0;
    return true;
  }

 private:
  int since_ = 0, every_ = 1;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

/// One thread's arms: a pack, or one.
class LaneGroup final : lanes::Scenarios {
 public:
  /// Scenarios taken at once: those of a pack, or 1 where they are too few for it or lanes are not wanted.
  static Eigen::Index width(const BatchProblem& problem);

  /// @param tell  told about the steps done (of all lanes together); answers false to end the batch
  LaneGroup(const BatchProblem& problem, const BatchOutput& out, std::function<bool(long)> tell);
  /// Runs scenarios first .. first + count - 1, at most `width`. Lanes without one repeat the last: a scenario's
  /// results are the same whoever shares the pack with it.
  void run(Eigen::Index first, Eigen::Index count, BatchStats& stats);
  /// How many of these scenarios, from the first on, have arms of one structure. To be asked before `run`.
  Eigen::Index alike(Eigen::Index first, Eigen::Index count);

 private:
  void pack_numbers();
  void pack_friction();
  void pack_limits();
  const Arm& arm(Eigen::Index b) const { return *p_.arms[p_.arms.size() == 1 ? 0 : static_cast<std::size_t>(b)]; }
  Eigen::Index scenario(Eigen::Index lane) const { return first_ + std::min(lane, count_ - 1); }
  void set(long step, long half, double* q, double* v, double* a, double* tau, double* offset,
           double* wrenches) override;
  bool jumps(long step, double* changed) override;
  int wanted(long step) override;
  void row(const double* q, const double* v, const double* a, const double* tau, const int* status) override;
  bool alive(long step) override;
  const lanes::KernelArm* load(Eigen::Index b);  ///< the arm of a scenario with its loads
  void pack(const BatchTable& table, Eigen::Index n, double* out) const;

  const BatchProblem& p_;
  const BatchOutput& out_;
  std::function<bool(long)> tell_;
  const lanes::Kernels& kernels_;
  Eigen::Index width_, first_ = 0, count_ = 1;
  std::optional<lanes::KernelArm> packed_;
  bool one_for_all_ = true;                                ///< one arm, with loads at the same places
  std::vector<std::unique_ptr<lanes::KernelArm>> loaded_;  ///< with loads: that one, or of each scenario
  lanes::Memory memory_;
  std::vector<double> weight_, laws_, coulomb_, stiction_, most_, q_, v_, farthest_, fastest_;
  std::vector<int> rubbing_;  // rates with dry friction in any scenario; first those that are not prescribed
  int rubbing_given_ = 0;
  std::vector<int> limited_;  // rates whose motor has a limit in any scenario, and that are not prescribed
  std::vector<int> free_, coordinate_, status_;
  std::vector<long> reached_;
  std::vector<Eigen::Index> rows_done_;
  Eigen::Index row_ = 0;
  long told_ = 0;
  Pace pace_;
};

}  // namespace flexarm
