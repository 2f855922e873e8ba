// Scenarios of a batch: in the lanes of a pack, or one by one.
#pragma once

#include <algorithm>
#include <chrono>
#include <exception>
#include <functional>
#include <vector>

#include "events.hpp"
#include "flexarm/batch.hpp"
#include "setup/single.hpp"

namespace flexarm {

/// Nan into the rows of a scenario from `row` on.
void fill_rows(const BatchProblem& problem, const BatchOutput& out, Eigen::Index scenario, Eigen::Index row);
/// Rethrows the exception of a scenario's function, within a ScenarioError where problems differ.
[[noreturn]] void throw_again(const BatchProblem& problem, Eigen::Index scenario);

/// The steps of a scenario.
struct BatchSteps {
  std::vector<double> lengths, ends;  ///< (s); ends: with the start before them
  std::vector<Eigen::Index> output;   ///< which of the times t each of these ends is, or -1

  /// @throws std::invalid_argument where there are too many
  BatchSteps(const Problem& problem, const Eigen::VectorXd& t, double step);
  long count() const { return static_cast<long>(lengths.size()); }
  double at(long half) const {
    const auto k = static_cast<std::size_t>(half / 2);
    return half % 2 == 0 ? ends[k] : ends[k] + 0.5 * lengths[k];
  }
};

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

  /// @param steps  of the first problem
  /// @param tell   told about the steps done (of all lanes together); answers false to end the batch
  LaneGroup(const BatchProblem& problem, const BatchSteps& steps, const BatchOutput& out,
            std::function<bool(long)> tell);
  /// Runs scenarios first .. first + count - 1, at most `width`. Lanes without one repeat the last: a scenario's
  /// results are the same whoever shares the pack with it.
  void run(Eigen::Index first, Eigen::Index count, BatchStats& stats);
  /// How many of these scenarios, from the first on, have arms of one structure and the same steps. To be asked before
  /// `run`.
  Eigen::Index alike(Eigen::Index first, Eigen::Index count);
  /// Whether a function of a problem has asked to end the batch.
  bool broken() const { return broken_; }

 private:
  /// A scenario's controllers, and the search for its events.
  struct Alone {
    Control control;
    struct Watch {
      System system;
      std::unique_ptr<Step> method;
      Trajectory out;
      StepEvents seen;
      Watch(const Problem& problem, Control& control, const Method& by, double step);
    };
    std::unique_ptr<Watch> watch;
  };
  /// The forces and motions of a scenario at a time.
  struct Acting {
    Eigen::VectorXd tau;
    std::vector<MotionValue> motions;
    std::vector<double> offsets;
    std::vector<Vec6<double>> wrenches;
  };

  const Problem& problem(Eigen::Index b) const { return p_.of(b); }
  const Arm& arm(Eigen::Index b) const { return *problem(b).arm; }
  Eigen::Index scenario(Eigen::Index lane) const { return first_ + std::min(lane, count_ - 1); }
  Alone& alone(Eigen::Index lane) { return alone_[static_cast<std::size_t>(std::min(lane, count_ - 1))]; }
  bool goes_on(Eigen::Index lane) const;
  const double* held(Eigen::Index b) const { return p_.tau.at(b, interval_); }
  void find_rates();
  void pack_numbers();
  void pack_joints();
  void pack_laws();
  void pack_start();
  void begin_alone();
  void act(const Problem& problem, double t);
  void end_alone(Eigen::Index lane);
  /// f(), whose errors end the run of this group.
  template <class F>
  void guarded(const F& f);
  void set(long half, double* q, double* v, double* a, double* tau, double* offset, double* wrenches) override;
  int due(long step) override;
  bool change(long step, const double* q, const double* v, const double* a, double* changed) override;
  bool look(long step, const double* q, const double* v, double* ended) override;
  int wanted(long step) override;
  void row(const double* q, const double* v, const double* a, const double* tau, const double* reactions,
           const int* status) override;
  bool alive(long step) override;
  const lanes::KernelArm* load(Eigen::Index b);  ///< the arm of a scenario with its loads
  double time(long step) const { return steps_->ends[static_cast<std::size_t>(step)]; }

  const BatchProblem& p_;
  const BatchSteps& first_steps_;
  const BatchOutput& out_;
  std::function<bool(long)> tell_;
  const lanes::LaneKernels& kernels_;
  Eigen::Index width_, first_ = 0, count_ = 1;
  std::optional<lanes::KernelArm> packed_;
  bool one_for_all_ = true;                                ///< one arm, with loads at the same places
  std::vector<std::unique_ptr<lanes::KernelArm>> loaded_;  ///< with loads: that one, or of each scenario
  lanes::Memory memory_;
  std::vector<double> weight_, laws_, coulomb_, stiction_, most_, q_, v_, farthest_, fastest_;
  std::vector<int> rubbing_;  // rates with dry friction in any scenario; first those that are not prescribed
  int rubbing_given_ = 0;
  std::vector<int> limited_;  // rates whose motor has a limit in any scenario, and that are not prescribed
  std::vector<int> free_, coordinate_, status_, moved_;  // moved: rates that are prescribed
  std::vector<long> reached_;
  std::vector<double> divided_, doubt_;
  std::vector<Eigen::Index> rows_done_;
  std::optional<BatchSteps> own_steps_;  // of a problem whose are not the first's; of which
  Eigen::Index own_of_ = -1;
  const BatchSteps* steps_ = nullptr;
  std::vector<Alone> alone_;
  bool varies_ = false, forced_ = false;  // whether anything is a function of time; whether forces are
  bool fresh_ = true;                     // whether tau is to be written anyway
  Acting now_;
  Eigen::VectorXd q_one_, v_one_, a_one_;
  Eigen::Index interval_ = 0, row_ = 0, asked_ = -1;  // asked: the scenario whose own functions are being called
  long told_ = 0;
  std::exception_ptr error_;
  bool broken_ = false;
  Pace pace_;
};

}  // namespace flexarm
