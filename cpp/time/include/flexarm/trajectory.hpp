// The result of a simulation, of any integrator.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

#include "flexarm/event.hpp"
#include "flexarm/workspace.hpp"

namespace flexarm {

struct SimulationStats {
  long steps = 0;
  long residuals = 0;          ///< evaluations of inverse dynamics, or of forward dynamics (rk4)
  long jacobians = 0;          ///< factorised iteration matrices
  long newton_iterations = 0;  ///< linear solves
  long linear_iterations = 0;  ///< of the Krylov solver
  long failed_steps = 0;       ///< whose equations were not solved, or whose error was too large: taken in parts
  double doubt = 0.0;          ///< the largest error that one of "implicit" may have, in parts of the arm's speed
  long switches = 0;           ///< of joints between sticking and sliding
  long hasty = 0;              ///< of these, within a fixed step (three of rk4) behind one of the same joint
  double wall_time = 0.0;      ///< s
};

/// Trajectory::failure when `alive` asked to stop.
constexpr const char* kInterrupted = "interrupted";

/// A drive, a load or an event may throw this to stop the integration as `alive` does.
struct Interrupted {};

/// Called now and then with the time reached; when it answers false, the integration stops, and its rows are kept.
using Alive = std::function<bool(double)>;

/// One row per output time. Rows from `done` on are not written when the integration stopped early.
struct Trajectory {
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  Rows q, v, a, tau;  ///< tau: applied forces, and the reactions of prescribed motions
  Rows friction;      ///< forces of dry friction
  bool rubs = false;  ///< whether there is any
  Rows contacts;      ///< forces of the contacts on the arm, in the world: three numbers each
  Rows loops;         ///< force and moment of each loop on its side b, in the world: six numbers
  Eigen::Index done = 0;
  double reached = 0.0;          ///< time reached (s)
  std::string failure;           ///< empty when all is done
  Status status = Status::ok;    ///< of the last step
  bool terminated = false;       ///< by a terminal event, at `reached`
  std::vector<EventLog> events;  ///< one per event
  SimulationStats stats;
  struct Tangent {
    Rows q, v, a, tau, friction;
  };
  std::vector<Tangent> tangents;  ///< derivatives of the rows, one for each parameter
  std::vector<Tangent> ends;      ///< of one row each, at `reached`, where the last event has occurred
};

}  // namespace flexarm
