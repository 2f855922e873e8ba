// An instance of a unit: its variables' values, and the simulation or the model behind them.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "exchange.hpp"
#include "variables.hpp"

namespace flexarm {

/// All calls throw std::invalid_argument naming the variable and the value.
class Unit {
 public:
  enum class Mode { instantiated, initialising, event, continuous, stepping, terminated };

  /// @param exchanges  model exchange, or else co-simulation
  /// @param events     co-simulation with event mode, in which inputs are set
  Unit(Resources resources, bool exchanges, bool events);

  /// Of its archive and kind.
  const std::string& name() const { return name_; }
  /// @throws std::invalid_argument where the mode is none of `allowed`
  void need(const char* call, std::initializer_list<Mode> allowed) const;
  /// The time at which it begins (s), instead of the scene's.
  void start_at(double time);
  void begin();
  void enter(Mode mode) { mode_ = mode; }
  void reset();

  double get(std::size_t reference);
  void set(std::size_t reference, double value);

  bool exchanges() const { return exchanges_; }
  bool events() const { return events_; }
  Exchange& exchange();
  /// References of its event indicators, in the order of the file.
  const std::vector<std::size_t>& indicators() const { return indicators_; }
  double nominal(std::size_t state) const;

  /// Of co-simulation. @return the time reached (s) @throws std::runtime_error where a step could not be taken
  double advance(double now, double step);
  double t();

  void slopes(const std::vector<std::size_t>& unknowns, const std::vector<std::size_t>& knowns, const double* seed,
              double* out);

  /// All that determines the rest of the run; `laws` are of this instance alone.
  struct State {
    std::string of;  ///< name of the unit
    std::vector<double> numbers;
    std::shared_ptr<const Control> laws;  ///< with all that they remember; none: of bytes
  };
  State state();
  /// @throws std::invalid_argument where bytes cannot hold a state
  void check_bytes() const;
  void restore(const State& state);

 private:
  const Variable& variable(std::size_t reference) const;
  void make();
  bool before() const;
  void place_inputs(const Problem& p);
  static double factor(const Variable& x, const Problem& p);
  const Eigen::VectorXd& q();
  const Eigen::VectorXd& v();
  void move();
  double& input(const Variable& x);
  void memory(const std::function<void(double&)>& visit);

  const Resources resources_;
  const std::string name_;
  const bool exchanges_, events_;
  Mode mode_ = Mode::instantiated;
  std::vector<std::size_t> indicators_;
  std::vector<double> values_;  // of inputs and parameters as given, of starts; by reference
  double start_, first_ = 0.0;  // s; the first step
  Eigen::VectorXd q0_, v0_;
  Inputs in_;
  bool made_ = false, changed_ = false, moved_ = false;
  std::unique_ptr<const Scene> scene_;  // with the parameters
  std::unique_ptr<Simulation> simulation_;
  std::unique_ptr<Exchange> exchange_;
  std::unique_ptr<Workspace> ws_;
  Eigen::VectorXd dq_;
};

}  // namespace flexarm
