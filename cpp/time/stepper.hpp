// Fixed steps of a problem from one stop to the next, for runs and real-time loops.
#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "events.hpp"
#include "flexarm/dry_friction.hpp"
#include "kinks.hpp"

namespace flexarm {

constexpr double kSameTime = 1e-6;  // parts of a step by which two times are still one

/// The time that steps from `reached` must end at next, at most `until`: a sample of drives, loads or controllers.
/// @param motions  whether they end at samples of prescribed motions
double next_stop(const std::vector<Drive>& drives, const std::vector<LoadDrive>& loads, const Control& control,
                 double reached, double until, double step, bool motions);
/// The number of equal steps to a stop that is so far away.
inline long steps_to(double stop, double step) {
  return std::max(1L, static_cast<long>(std::ceil(stop / step - kSameTime)));
}

/// A system, the method that moves it, and the time that it has reached. Steps end at stops: samples of drives, loads
/// and controllers, and the times that the caller asks for; between two stops they are equal, as few as `step` allows.
/// Of joints with dry friction, each sticks or slides (as a hybrid system: Karnopp 1985, Pfeiffer & Glocker 1996). A
/// method that has no switches within its steps holds a joint that sticks exactly still, and pushes with a constant
/// force on one that slides: between two switches the motion is smooth. A step that passes over one is taken again, up
/// to there. A step that is chosen ends where a force has a kink, too.
class Stepper {
 public:
  System s;
  double reached;              ///< time (s)
  long steps = 0, halved = 0;  ///< halved: whose equations were not solved, or whose error was too large
  long switches = 0;           ///< of joints between sticking and sliding, at which steps ended
  long hasty = 0;              ///< of these, within a step (three of rk4) behind one of the same joint

  /// @param looks  some times of the run: a prescribed motion's speed there is a measure of the error that a step may
  /// make
  Stepper(const Problem& problem, Control& control, Step& method, double step, const Eigen::VectorXd& looks);
  /// Drives, and samples controllers, at the start. The method itself is started by `start`.
  void begin();
  Status start() { return look_at_joints(method.start(s.ws, s.q, s.v, s.tau)); }

  /// The time that steps must end at next, at most `until`.
  double next_stop(double until) const;
  /// Advances to a stop, none being before it.
  /// @param seen  called (from, h) behind each step, where the state is that of its end. @return its status; or
  ///              `enough` ends the way to the stop
  /// @param each  called behind each step, and not behind its parts; false ends the way to the stop
  template <class Seen, class Each>
  Status advance(double stop, const Seen& seen, const Each& each) {
    if (method.chooses()) return choose(stop, seen, each);
    const double start = reached, whole = stop - start;
    const long count = steps_to(whole, step);
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
  /// Of a method that chooses its steps: how long the next step shall be (s), and the last one's error, in parts of the
  /// one allowed.
  double wanted = 0.0, error = 1.0;
  /// Runs sampled controllers that are due at the time reached.
  Status sample();
  /// Other forces act from here on.
  Status jump() { return look_at_joints(method.jump(s.ws, s.q, s.v, s.tau)); }
  /// To be called when the method and the system have been given another state.
  void recalled() { look_at_joints(Status::ok); }
  /// Why a status is not ok, for people.
  std::string reason(Status status) const;
  void record(Tape* tape) { tape_ = tape; }

 private:
  static constexpr double kShorter = 0.25;  // part of a step whose equations cannot be solved
  static constexpr int kSplits = 8;         // halvings of a step whose equations cannot be solved
  static constexpr int kLooks = 5;          // halvings of a step that does not see a motion; then it is taken to jump

  /// A joint with dry friction that is not prescribed.
  struct RubbingJoint {
    Rub of;
    double slack;     // parts of its stiction by which it may be held beyond it
    double switched;  // when, last (s)
  };

  /// One step, or, where its equations cannot be solved, two of half its length, and so on. (The implicit method
  /// divides its steps itself.)
  template <class Seen>
  Status part(double from, double h, double last, int level, const Seen& seen) {
    if (!joints_.empty()) {
      q0_ = s.q;
      v0_ = s.v;
    }
    double share = 1.0;  // of the step, up to a switch of dry friction
    Status found = try_step(from, h, last, level);
    if (found == Status::ok && !joints_.empty()) found = end_at_switch(from, h, last, level, share);
    if (found == Status::ok) {
      found = arrive(from, h, last, share, seen);
      if (share == 1.0 || found != Status::ok || enough) return found;
      return part(from + share * h, (1.0 - share) * h, last, level, seen);
    }
    if (found != Status::not_converged || level == kSplits || !method.interpolates()) return found;
    ++halved;
    s.drive(from);
    const Status half = part(from, 0.5 * h, std::nan(""), level + 1, seen);
    return half == Status::ok && !enough ? part(from + 0.5 * h, 0.5 * h, last, level + 1, seen) : half;
  }
  /// Behind a step of which a share was taken.
  template <class Seen>
  Status arrive(double from, double h, double last, double share, const Seen& seen) {
    reached = share < 1.0 ? from + share * h : std::isnan(last) ? from + h : last;
    Status found = Status::ok;
    if (share > 0.0) {
      ++steps;
      found = seen(from, share * h);
    }
    if (share > 0.0 && found == Status::ok && !enough) s.remember();
    return found == Status::ok && switched_ ? settle() : found;
  }
  /// `advance` by steps whose error is allowed.
  template <class Seen, class Each>
  Status choose(double stop, const Seen& seen, const Each& each) {
    enough = false;
    while (reached < stop && !enough) {
      const double from = reached;
      double h = 0.0, last = std::nan(""), share = 1.0;
      int tries = 0;
      for (Status found = Status::not_converged; found != Status::ok; ++tries) {
        h = length_to(stop, last);
        q0_ = s.q;
        v0_ = s.v;
        found = try_step(from, h, last, tries);
        if (found == Status::ok && kinks_.any()) found = end_at_kink(from, h, last, tries);
        const bool solved = found == Status::ok;
        if (solved && !good_enough(h, tries)) {
          ++halved;
          take_back(from);
          found = Status::not_converged;
          continue;
        }
        if (solved && !joints_.empty()) found = end_at_switch(from, h, last, tries, share);
        if (found == Status::ok) break;
        if (found != Status::not_converged || h <= shortest_) return found;
        ++halved;
        wanted = kShorter * h;
        share = 1.0;
        s.drive(from);
      }
      const Status found = arrive(from, h, last, share, seen);
      if (found != Status::ok || !each()) return found;
    }
    return Status::ok;
  }
  /// The length of the next step, and, in `last`, the stop if it ends there, else nan.
  double length_to(double stop, double& last) const;
  /// Whether the error of a step is allowed; how long the next one shall be.
  bool good_enough(double h, int tries);
  /// Takes the last step back.
  void take_back(double from) {
    method.undo(s.q, s.v);
    if (tape_) tape_->take_back();
    s.drive(from);
  }
  /// A step that has been taken over a kink of a force is taken again, up to there, and h is its length; the status is
  /// that of the last one.
  Status end_at_kink(double from, double& h, double& last, int level);
  /// The first switch of dry friction within the step that has been taken: takes the step again up to there.
  /// @param share  part of the step up to it
  Status end_at_switch(double from, double h, double last, int level, double& share);
  /// Begins anew behind a switch.
  Status settle();
  Saltation saltation(const RubbingJoint& now);
  Status look_at_joints(Status status);
  RubbingJoint* broken();
  Status try_step(double from, double h, double last, int level);
  /// @return whether the forces have changed
  bool look();

  Step& method;
  const double step;
  double same_;                 // times that are so near are one (s)
  double longest_, shortest_;   // steps that are chosen (s)
  std::vector<double> speeds_;  // of prescribed motions
  Step::Given given_;
  struct {
    double from, h, last;  // of the step; `last`: the stop when it ends there, so that it is met exactly
  } now_;
  Tape* tape_ = nullptr;
  Kinks kinks_;
  // Pieces of forces: where a step begins, and where it is looked at.
  std::vector<signed char> pieces_, pieces_now_;
  std::vector<RubbingJoint> joints_;  // of a method that has no switches within its steps
  std::vector<signed char> ways_;     // of all rates, their Tape::Way until the next switch
  RubbingJoint* switched_ = nullptr;  // in the step that has been taken
  signed char was_ = Tape::free;      // its way before
  bool forced_ = false;               // it did not last at the step's very beginning
  RubbingJoint* restless_ = nullptr;  // one that switches without end
  Eigen::VectorXd q0_, v0_;           // where the step began
  const Eigen::VectorXd start_;       // where the run began
  Eigen::VectorXd q1_, v1_;           // where it ended, before it was looked into
  StepCubic cubic_;                   // through it, of methods that do not interpolate
  std::vector<double> last_switches_;

  /// A step's length, or, where it is chosen, that of the next.
  double usual() const { return method.chooses() ? wanted : step; }
};

}  // namespace flexarm
