// Model predictive control on implicit steps: torques that bring an arm along a reference within limits.
// After construction nothing is allocated, locked or thrown.
#pragma once

#ifdef FLEXARM_MPC

#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "flexarm/kinematics.hpp"
#include "flexarm/problem.hpp"

namespace flexarm {

/// One number of the arm that is led along a reference, kept within limits, or both:
/// y = by_q . q, or the place of a slice along a direction of the world.
struct MpcOutput {
  /// A joint's coordinate (rad; m), by the index of its rate in v.
  static MpcOutput joint(const Arm& arm, int rate);
  /// The place of a link's end, or of a slice at x metres of its beam, along a direction of the world (m).
  static MpcOutput place(const Arm& arm, std::size_t link, std::optional<double> x, const Eigen::Vector3d& along);

  Eigen::VectorXd by_q;                             ///< by the coordinate of each rate (nv); of balls zero
  bool placed = false;                              ///< whether it is a place
  std::size_t link = 0;                             ///< of the place
  std::optional<double> x = {};                     ///< of the place
  Eigen::Vector3d along = Eigen::Vector3d::Zero();  ///< of the place
  double weight = 0.0, rate_weight = 0.0;           ///< of (y - r)^2 and (dy/dt - dr/dt)^2 in the cost
  // Soft limits of y and dy/dt.
  double lower = -std::numeric_limits<double>::infinity(), upper = std::numeric_limits<double>::infinity();
  double rate_lower = -std::numeric_limits<double>::infinity(), rate_upper = std::numeric_limits<double>::infinity();
};

struct MpcOptions {
  double period = 1e-3;   ///< between samples (s), and the first stage's length
  double horizon = 0.5;   ///< how far it looks ahead (s)
  int stages = 25;        ///< implicit steps over the horizon; their lengths grow evenly from `period`
  int blocks = 12;        ///< over which inputs are held; the first is one stage
  double terminal = 0.1;  ///< for how long (s) the horizon's end counts in the cost
  /// The cost of breaking a soft limit, throughout a second, by as much as its span (or its size).
  double soft = 100.0;
  double friction_speed = 0.05;  ///< Coulomb friction is c v / sqrt(v^2 + friction_speed^2) (rad/s; m/s)
  bool delayed = false;          ///< whether inputs act a period after the sample that they answer
  int iterations = 1;            ///< linearisations and quadratic programs for a sample
  int max_qp_iterations = 500;   ///< of the active set
  int carried = 0;               ///< how many rates, the last ones, are states of controllers, which are not measured
  // Of each input u (nu); the generalised forces are `columns` u.
  Eigen::MatrixXd columns;       ///< (nv, nu)
  Eigen::VectorXd lower, upper;  ///< limits of u
  Eigen::VectorXd rate_limit;    ///< limits of |du/dt|
  Eigen::VectorXd effort;        ///< weights of (u less that which holds the arm)^2
  Eigen::VectorXd rate_effort;   ///< weights of (du/dt)^2
};

/// Model predictive control by the real-time iteration (Diehl, Bock, Schloeder 2005): at each sample one linearisation
/// about the plan of the sample before, shifted by a period, and one quadratic program. `prepare` does all that needs
/// no measurement; `feedback` the rest. The stages are implicit steps (L-stable, of order 2), with their exact
/// derivatives, condensed to the inputs. Least cost of
///   integral of  sum weight (y - r)^2 + rate_weight (dy/dt - dr/dt)^2 + effort (u - u_held)^2 + rate_effort (du/dt)^2
/// over the horizon, by Gauss and Newton's Hessian, where each stage counts by its end and its length. The
/// quadratic program is solved by DAQP (Arnstroem, Bemporad, Axehill 2022), begun with the active set of the last.
///
/// It knows the problem's arm and all that acts on it beside the inputs: motions, forces, loads and laws, at their
/// times. Sampled laws are linear ones (LinearLaw), at whose times stages are divided; their memory is predicted,
/// from zero at the first sample on. With these it allocates. Its start and events do not matter.
class Mpc {
 public:
  /// Reference of each output and its rate at time t (s): (ny) each, of outputs with a weight.
  using Reference = std::function<void(double t, Eigen::VectorXd& value, Eigen::VectorXd& rate)>;

  /// @throws std::invalid_argument naming the field and the value
  Mpc(const Problem& problem, const std::vector<MpcOutput>& outputs, const MpcOptions& options, Reference reference);
  ~Mpc();

  /// Forgets its plan: the next sample begins from the forces that hold the arm.
  void reset();
  /// The inputs that answer the state, (nq) and (nv) without the carried rates', at time t (s). Sizes are not
  /// checked.
  /// @return when not ok, `u` goes on along the last plan, within its limits: not_finite: of a state with nan, or that
  ///         no arm reaches; not_converged: the quadratic program or a stage was not solved
  Status feedback(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v);
  /// For the next sample, a period later: shifts the plan, and linearises about it.
  /// @return when not ok, the next `feedback` does that at the state that it is given
  Status prepare();

  /// The inputs to apply (nu), always finite and within the limits, and as generalised forces (nv).
  const Eigen::VectorXd& u() const;
  const Eigen::VectorXd& forces() const;
  /// The plan: inputs of blocks (nu x blocks), from these times on (s; the horizon's end behind).
  const Eigen::MatrixXd& plan() const;
  const Eigen::VectorXd& block_times() const;
  /// The prediction about which was linearised last: [q; v] (nq + nv x stages + 1), at these times from its begin (s).
  const Eigen::MatrixXd& predicted() const;
  const Eigen::VectorXd& stage_times() const;
  /// Of the last feedback: iterations of the active set.
  int qp_iterations() const;
  /// Times that a feedback was not ok since the reset.
  long failures() const;
  const MpcOptions& options() const;
  const Arm& arm() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace flexarm

#endif
