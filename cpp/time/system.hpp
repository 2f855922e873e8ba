// A problem in motion: its arm, and the forces and motions that act on it now. Every integrator has one.
#pragma once

#include <string>
#include <vector>

#include "flexarm/problem.hpp"
#include "flexarm/step.hpp"
#include "flexarm/trajectory.hpp"
#include "flexarm/workspace.hpp"

namespace flexarm {

struct System {
  const Arm& arm;
  const std::vector<Drive>& drives;
  const std::vector<LoadDrive>& loads;
  Control& control;
  Eigen::VectorXd constant_tau;
  Workspace ws;
  std::vector<int> free_q;         // coordinates that are not prescribed
  Eigen::VectorXd q, v, a, tau;    // of all coordinates
  OneStep* rubbing = nullptr;      // the method that knows dry friction (Step::rubbing)
  Eigen::VectorXd friction;        // of that
  Eigen::VectorXd held_before;     // forces of sampled controllers, before these sample
  Eigen::RowVectorXd loop_forces;  // found by `react`, see Trajectory

  /// @param control  of the problem, with its samples. Both must outlive this
  System(const Problem& problem, Control& control);
  int n_q() const { return static_cast<int>(free_q.size()); }
  int n_v() const { return static_cast<int>(ws.free.size()); }

  /// Prescribed coordinates and applied forces at time t.
  void drive(double t);
  /// The same at a state.
  void drive(double t, const Eigen::VectorXd& at_q, const Eigen::VectorXd& at_v) {
    q = at_q;
    v = at_v;
    drive(t);
  }
  /// Moves the current state, of a step of h, onto the loops: the nearest, fast vibrations aside.
  void close_loops(double h);
  /// Contacts go on from the current state.
  void remember();
  /// Accelerations at the current state, into ws.a; `between` two switches of dry friction, see OneStep::accelerate.
  Status accelerate(bool between = false);
  /// Runs the sampled controllers that are due up to time t, at the current state.
  /// @return whether the forces have changed: then tau is the new one
  bool sample(double t);
  /// Accelerations at the current state into a, applied forces and the reactions of prescribed motions into ws.total,
  /// dry friction into friction. @return null, or why there are none
  const char* react();
  /// Adds a row of them to the trajectory.
  bool record(Trajectory& out);
  /// Values of events at the current state, whose quaternions it scales to unit length.
  /// @throws std::invalid_argument for nan or inf
  void evaluate(const std::vector<Event>& events, double t, double* values);
  /// Adds the current state to the occurrences of event k.
  /// @return whether that ends the run: `out` then says so, and out.reached is t
  bool log(const std::vector<Event>& events, std::size_t k, double t, Trajectory& out) const;
};

/// Calls all functions of time at t, and tells their values: of drives motion(k, value) and force(k, value), of loads
/// wrench(k, value), and of continuous laws with a reference offset(k, value).
template <class Motion, class Force, class Wrench, class Offset>
void ask_laws(const std::vector<Drive>& drives, const std::vector<LoadDrive>& loads,
              const std::vector<Feedback>& feedback, double t, const Motion& motion, const Force& force,
              const Wrench& wrench, const Offset& offset) {
  for (std::size_t k = 0; k < feedback.size(); ++k)
    if (feedback[k].reference) offset(k, feedback[k].reference(t));
  for (std::size_t k = 0; k < loads.size(); ++k) wrench(k, loads[k].wrench(t));
  for (std::size_t k = 0; k < drives.size(); ++k)
    drives[k].motion ? motion(k, drives[k].motion(t)) : force(k, drives[k].force(t));
}

/// The force law's places, without their values.
std::vector<Load> places(const std::vector<LoadDrive>& loads);

/// @throws std::invalid_argument naming the first ball joint, with which `what` cannot go on
void refuse_balls(const Arm& arm, const std::string& what);

/// A trajectory of no rows yet, for the times t.
Trajectory empty_trajectory(const Arm& arm, const Eigen::VectorXd& t, const std::vector<Event>& events,
                            std::size_t parameters = 0);

/// The first sample of drives, loads and controllers from a time on, no earlier; infinite: there is none.
/// @param motions  whether those of prescribed motions count
double next_sample(const std::vector<Drive>& drives, const std::vector<LoadDrive>& loads, const Control& control,
                   double from, bool motions = true);

}  // namespace flexarm
