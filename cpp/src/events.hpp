// Events of methods that know the state at the ends of their steps alone.
#pragma once

#include "system.hpp"

namespace flexarm {

/// Finds sign changes of events over a step, and where in it: on the method's own interpolant, looked at in several
/// places, or on the cubic Hermite interpolants of q and v.
class StepEvents {
 public:
  /// State at a part x (0 to 1) of the last step.
  using Inside = std::function<void(double x, Eigen::VectorXd& q, Eigen::VectorXd& v)>;

  StepEvents(System& system, const std::vector<Event>& events, Trajectory& out);
  /// Begins at the system's state at time t. A value that is zero there is no event.
  void start(double t);
  /// Looks at the step from the last time to t, where the system's state is now; logs what occurred, in order.
  /// @param inside  the method's interpolant, if it has one
  /// @return whether a terminal event did: `out` then says so, and out.reached is its time
  bool look(double t, const Inside* inside = nullptr);

 private:
  void prepare();
  void place(double t);
  double locate(std::size_t k, double low, double high);

  System& s_;
  const std::vector<Event>& events_;
  Trajectory& out_;
  const Inside* inside_ = nullptr;
  bool prepared_ = false;  ///< slopes of the present step
  double t0_ = 0.0, t1_ = 0.0;
  Eigen::VectorXd values0_, values1_, values_;
  Eigen::VectorXd q0_, q1_, dq0_, dq1_, v0_, v1_, a0_, a1_;
  std::vector<std::pair<double, std::size_t>> found_;
};

}  // namespace flexarm
