// A problem as an integrator outside sees it: accelerations at a state, events between, derivatives.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "flexarm/derivatives.hpp"
#include "flexarm/dry_friction.hpp"
#include "system.hpp"

namespace flexarm {

/// The state is q (of coordinates that are not prescribed) and v (of such rates). Joints with dry friction stick or
/// slide between two events, as in Stepper: a joint that sticks is held, one that slides is pushed by a constant force.
class Exchange {
 public:
  /// At the problem's start, which must outlive it.
  /// @throws std::invalid_argument for an arm whose motion is no ordinary differential equation, and for a start
  /// without accelerations
  Exchange(const Problem& problem, double t);

  const System& system() const { return s_; }
  double t() const { return t_; }
  void set_time(double t);
  const std::vector<int>& coordinates() const { return s_.free_q; }
  const std::vector<int>& rates() const { return s_.ws.free; }
  /// Sets the state (free coordinates, then rates).
  void place(const double* x);
  /// Other inputs act from now on.
  void touch() { fresh_ = driven_ = false; }
  /// Constant generalised forces (nv), to which those of drives are added.
  void set_tau(const Eigen::VectorXd& tau) {
    s_.constant_tau = tau;
    touch();
  }

  /// Accelerations (nv), at the state and time.
  /// @throws std::invalid_argument where there are none
  const Eigen::VectorXd& a();
  const Eigen::VectorXd& q();  ///< with the prescribed ones
  const Eigen::VectorXd& v();
  const Eigen::VectorXd& coordinate_rates();  ///< dq/dt (nq)
  /// Forces as of System::react: applied ones and reactions (nv).
  const Eigen::VectorXd& tau();
  const Eigen::VectorXd& friction();

  /// An event: controllers sample, and each joint with dry friction sticks or slides anew.
  /// Rates may leap to zero, and accelerations anywhere.
  void event();
  /// The next event that is known beforehand (s); infinite: none.
  double next_event() const;
  /// Passes through zero where a joint begins to slide, or comes to rest.
  double indicator(int rate);

  /// The derivative of the accelerations in a direction: of the coordinates dq (nq), the rates dv (nv), generalised
  /// forces (nv; without those that `dq` and `dv` bring about by laws) and the loads' wrenches.
  /// @throws std::invalid_argument where there are none
  Eigen::VectorXd slope(const Eigen::VectorXd& dq, const Eigen::VectorXd& dv, const Eigen::VectorXd& force,
                        const std::vector<Vec6<double>>& wrenches);
  /// Force (nv) of a unit of a continuous law's reference: zero where the law, or a motor, is at its limit.
  Eigen::VectorXd column(std::size_t law);
  /// The force of a motor at its limit does not change: sets such entries to zero.
  void limit(Eigen::VectorXd& force);

  /// All that determines the rest of the run, the controllers' own memory included, which `visit` reads or writes.
  void memory(const std::function<void(double&)>& visit);
  Control& control() { return control_; }

 private:
  void drive();
  void check(Status status) const;
  void linearise();

  Control control_;
  System s_;
  std::unique_ptr<OneStep> rubbing_;
  std::vector<Rub> rubs_;
  std::vector<signed char> ways_;
  double t_;
  bool driven_ = false, fresh_ = false, reacted_ = false, sloped_ = false;
  Eigen::VectorXd a_, dq_;
  std::vector<bool> held_;
  std::optional<ForwardDerivatives> slopes_;
  Eigen::MatrixXd law_q_, law_v_;  // less the slopes of the laws' forces
};

}  // namespace flexarm
