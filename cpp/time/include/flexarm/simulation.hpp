// A problem in motion, step by step: for real-time loops, and for whoever sets inputs and reads outputs as it goes.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "flexarm/problem.hpp"
#include "flexarm/step.hpp"
#include "flexarm/trajectory.hpp"

namespace flexarm {

/// A one-step method by its name, and its options.
struct Method {
  std::string name = "implicit";  ///< or "gauss", "rk4": see CollocationStep, OneStep::methods
  double rtol = 0.0;              ///< how far the equations of a step are solved; 0: the method's own
  double spectral_radius = 1.0;   ///< of "implicit"
  int stages = 4;                 ///< of "gauss"
  double tolerance = 0.0;         ///< of "gauss", where it chooses its steps; see CollocationOptions

  /// @throws std::invalid_argument naming the field and the value
  std::unique_ptr<Step> on(const Arm& arm, double step) const;
};

/// After its construction it allocates, locks and throws nothing, as long as the problem's functions do not (an event
/// may occur a hundred times).
class Simulation {
 public:
  /// At the problem's start.
  /// @param step  longest step (s); not read where the method chooses its steps
  /// @throws std::invalid_argument naming the field and the value
  Simulation(const Problem& problem, const Method& method, double step, double t = 0.0);
  Simulation(Simulation&&) noexcept;
  ~Simulation();

  /// Advances by one step, given or chosen. Samples of drives, loads and controllers within it divide it.
  /// @return when not ok, the state is the last good one, and `failure` says why
  Status step();
  /// Advances to a time, which must not be before now, in equal steps.
  /// @param alive  asked now and then with the time reached; false stops where it is
  Status advance(double until, const Alive& alive = {});

  double t() const;                  ///< s
  const Eigen::VectorXd& q() const;  ///< (nq)
  const Eigen::VectorXd& v() const;  ///< (nv)
  // Now, for the forces that act now (nv each): made when asked for.
  const Eigen::VectorXd& a();
  const Eigen::VectorXd& tau();       ///< applied forces, and the reactions of prescribed motions
  const Eigen::VectorXd& friction();  ///< forces of dry friction
  std::string failure() const;        ///< why the last step was not ok
  const Step::Counts& counts() const;
  long steps() const;
  long failed_steps() const;  ///< whose equations were not solved, taken in parts
  /// Occurrences since the construction, of each event: these grow.
  const std::vector<EventLog>& events() const;
  /// Whether a terminal event has ended the last `step` or `advance`: the state is that of its time, and `step` goes on
  /// from there.
  bool terminated() const;

  // Inputs: from now on, until they are set again, in place of the problem's.
  void set_tau(const Eigen::VectorXd& tau);                     ///< constant generalised forces (nv)
  void set_force(std::size_t drive, double value);              ///< of a drive by force: N, N m, V
  void set_load(std::size_t load, const Vec6<double>& wrench);  ///< [f; m] (N, N m)
  void set_reference(std::size_t feedback, double value);       ///< of a continuous controller, gains included

  /// All that determines the rest of the run, except for the memory of the problem's own functions. A state restored,
  /// here or in a simulation of the same problem, goes on as the first did to the last bit.
  struct State {
    double t = 0.0;
    std::vector<double> numbers;
    Control control = Control({}, {}, 0);
  };
  State state() const;
  /// @throws std::invalid_argument for a state of another problem
  void restore(const State& state);

 private:
  struct Motion;
  std::unique_ptr<Motion> motion_;
};

}  // namespace flexarm
