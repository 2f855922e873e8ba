// Events of methods that know the state at the ends of their steps alone.
#pragma once

#include <utility>

#include "system.hpp"

namespace flexarm {

/// Whether a value that goes from one to the other passes zero in a direction that counts.
inline bool crosses(double from, double to, int direction) {
  return (from < 0.0 && to >= 0.0 && direction >= 0) || (from > 0.0 && to <= 0.0 && direction <= 0);
}

/// Writes a row of the system's state and accelerations at time t: of the end of an entry's step, or, if `inside` is
/// given, of a place c within it.
/// @return its number
Eigen::Index write_row(const System& s, const Step* inside, Eigen::Index entry, double c, double t, Tape& tape);

/// The cubic Hermite interpolants of a system's q and v over a step.
class StepCubic {
 public:
  explicit StepCubic(const System& system);
  /// From a state at t0 to the system's own at t1.
  /// @param between  see System::accelerate
  /// @param each     called where the system is at the first end, and at the second
  template <class Each>
  void prepare(System& s, double t0, const Eigen::VectorXd& q0, const Eigen::VectorXd& v0, double t1, bool between,
               const Each& each) {
    q1_ = s.q;
    v1_ = s.v;
    t0_ = t0;
    t1_ = t1;
    q0_ = s.q = q0;
    v0_ = s.v = v0;
    look(s, t0, between, dq0_, a0_);
    each(t0);
    s.q = q1_;
    s.v = v1_;
    look(s, t1, between, dq1_, a1_);
    each(t1);
  }
  /// The system's state at a time within the step.
  void place(System& s, double t) const;

 private:
  static void look(System& s, double t, bool between, Eigen::VectorXd& dq, Eigen::VectorXd& a);

  double t0_ = 0.0, t1_ = 0.0;
  Eigen::VectorXd q0_, q1_, dq0_, dq1_, v0_, v1_, a0_, a1_;
};

/// Finds sign changes of events over a step, and where in it, on the cubic Hermite interpolants of q and v.
class StepEvents {
 public:
  /// @param tape    or null; where an event occurs, it gets the rows that the cubics go through
  /// @param inside  the method, if it interpolates
  StepEvents(System& system, const std::vector<Event>& events, Trajectory& out, Tape* tape = nullptr,
             const Step* inside = nullptr);
  /// Begins at the system's state at time t. A value that is zero there is no event.
  void start(double t);
  /// Looks at the step from the last time to t, where the system's state is now; logs occurrences in order.
  /// @return whether a terminal event did: `out` then says so, and out.reached is its time
  bool look(double t);
  /// `look` at the end of a step of h from `from`, and, of a method that interpolates, before at several places of it,
  /// as it may hold more than one zero; out.reached is its end.
  void look_through(double from, double h);

 private:
  Eigen::Index write(double t) const;
  double locate(std::size_t k);

  System& s_;
  const std::vector<Event>& events_;
  Trajectory& out_;
  Tape* tape_;
  const Step* inside_;
  Eigen::Index before_ = -1, after_ = -1;  // rows of the tape
  double t0_ = 0.0, t1_ = 0.0;
  Eigen::VectorXd values0_, values1_, values_;
  Eigen::VectorXd q0_, v0_, q1_, v1_;
  StepCubic cubic_;
  std::vector<std::pair<double, std::size_t>> found_;
};

}  // namespace flexarm
