// Events of methods that know the state at the ends of their steps alone.
#pragma once

#include "system.hpp"

namespace flexarm {

/// Whether a value that goes from one to the other passes zero in a direction that counts.
inline bool crosses(double from, double to, int direction) {
  return (from < 0.0 && to >= 0.0 && direction >= 0) || (from > 0.0 && to <= 0.0 && direction <= 0);
}

/// Finds sign changes of events over a step, and where in it, on the cubic Hermite interpolants of q and v.
class StepEvents {
 public:
  StepEvents(System& system, const std::vector<Event>& events, Trajectory& out);
  /// Begins at the system's state at time t. A value that is zero there is no event.
  void start(double t);
  /// Looks at the step from the last time to t, where the system's state is now; logs what occurred, in order.
  /// @return whether a terminal event did: `out` then says so, and out.reached is its time
  bool look(double t);

 private:
  void prepare(double t);
  void place(double t);
  double locate(std::size_t k);

  System& s_;
  const std::vector<Event>& events_;
  Trajectory& out_;
  double t0_ = 0.0, t1_ = 0.0;
  Eigen::VectorXd values0_, values1_, values_;
  Eigen::VectorXd q0_, q1_, dq0_, dq1_, v0_, v1_, a0_, a1_;
  std::vector<std::pair<double, std::size_t>> found_;
};

}  // namespace flexarm
