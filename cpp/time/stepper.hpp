// Fixed steps of a problem from one stop to the next: what runs and real-time loops share.
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "system.hpp"

namespace flexarm {

constexpr double kSameTime = 1e-6;  // parts of a step by which two times are still one

/// A system, the method that moves it, and the time that it has reached. Steps end at stops: samples of drives, loads
/// and controllers, and the times that the caller asks for; between two stops they are equal, as few as `step` allows.
class Stepper {
 public:
  System s;
  double reached;  ///< time (s)
  long steps = 0, halved = 0;

  /// @param looks  some times of the run: how fast a prescribed motion is there is a measure of what a step may miss
  Stepper(const Problem& problem, Control& control, Step& method, double step, const Eigen::VectorXd& looks);
  /// Drives, and samples controllers, at the start. The method itself is started by `start`.
  void begin();
  Status start() { return method.start(s.ws, s.q, s.v, s.tau); }

  /// The time that steps must end at next, at most `until`.
  double next_stop(double until) const;
  /// Advances to a stop, none being before it.
  /// @param seen  called (from, h) behind each step, where the state is that of its end. @return its status; or
  ///              `enough` ends the way to the stop
  /// @param each  called behind each step, and not behind its parts; false ends the way to the stop
  template <class Seen, class Each>
  Status advance(double stop, const Seen& seen, const Each& each) {
    const double start = reached, whole = stop - start;
    const long count = std::max(1L, static_cast<long>(std::ceil(whole / step - kSameTime)));
    const double h = whole / static_cast<double>(count);
    enough = false;
    for (long k = 0; k < count && !enough; ++k) {
      const Status status = part(start + static_cast<double>(k) * h, h, k + 1 == count ? stop : std::nan(""), 0, seen);
      if (status != Status::ok) return status;
      if (!each()) return Status::ok;
    }
    return Status::ok;
  }
  bool enough = false;  ///< set by `seen`: the run ends here
  /// Lets sampled controllers do what is due at the time reached.
  Status sample();
  /// Other forces act from here on.
  Status jump() { return method.jump(s.ws, s.q, s.v, s.tau); }
  /// Why a status is not ok, for people.
  std::string reason(Status status) const;
  void record(Tape* tape) { tape_ = tape; }

 private:
  static constexpr int kSplits = 8;  // halvings of a step whose equations cannot be solved
  static constexpr int kLooks = 5;   // halvings of a step that does not see a motion; then it is taken to jump

  /// One step, or, where its equations cannot be solved, two of half its length, and so on. (Not of the implicit
  /// method: an iteration that fails on modes too fast for the step, and loud, may find a solution that is none.)
  template <class Seen>
  Status part(double from, double h, double last, int level, const Seen& seen) {
    const Status found = try_step(from, h, last, level);
    if (found == Status::ok) {
      reached = std::isnan(last) ? from + h : last;
      ++steps;
      return seen(from, h);
    }
    if (found != Status::not_converged || level == kSplits || !method.interpolates()) return found;
    ++halved;
    s.drive(from);
    const Status half = part(from, 0.5 * h, std::nan(""), level + 1, seen);
    return half == Status::ok && !enough ? part(from + 0.5 * h, 0.5 * h, last, level + 1, seen) : half;
  }
  Status try_step(double from, double h, double last, int level);
  /// @return whether the forces have changed
  bool look();

  Step& method;
  const double step;
  std::vector<double> speeds_;  // of prescribed motions
  Step::Given given_;
  struct {
    double from, h, last;  // of the step; `last`: the stop when it ends there, so that it is met exactly
  } now_;
  Tape* tape_ = nullptr;
};

}  // namespace flexarm
