// Gauss collocation: implicit Runge-Kutta steps of high order.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <memory>
#include <optional>

#include "flexarm/derivatives.hpp"
#include "flexarm/step.hpp"

namespace flexarm {

class StepError;  // of steps that are chosen

struct CollocationOptions {
  int stages = 4;  ///< 1 to 4; the order is twice that
  /// Of the iteration: error of the velocities, as a part of those of the motion, both in the norm of kinetic energy.
  double rtol = 1e-12;
  int max_iterations = 30;
  /// Of steps that are chosen: the error of places that they aim at, in parts of the arm's length, of angles (rad), and
  /// of energy, in parts of the largest kinetic energy; 0: steps are as long as they are given.
  double tolerance = 0.0;
};

/// Gauss-Legendre collocation (Hairer & Wanner, Solving ODEs II, IV.5): the accelerations at s points of the step are
///   residual of inverse dynamics at (q_i, v_i, a_i) = 0,  v_i = v0 + h sum A_ij a_j,  q_i = q0 + h sum A_ij v_j
/// A ball turns by a vector u from a middle place, du/dt = turn_rate(u, w), where u at the step's end is minus that at
/// its beginning: quaternions of unit length, the same order and symmetry, and a steady spin without error.
/// Order 2s, symmetric in time, unconditionally stable on linear vibration, whose energy it keeps: it steps over modes
/// that are fast but quiet, and stays accurate. Of an arm with dry friction, whose switches strike such modes, the
/// points are Radau's (Radau IIA): order 2s - 1, and modes that are too fast die out. Newton's iteration with exact
/// Jacobians, kept as long as they serve; its matrix is dense, (s n)^2: for arms of up to some tens of coordinates.
class CollocationStep final : public Step {
 public:
  /// @throws std::invalid_argument naming the field and the value; for joints with dry friction, which it does not know
  explicit CollocationStep(const Arm& arm, const CollocationOptions& options = {},
                           DryFriction friction = DryFriction::refused);
  /// The arm must outlive it.
  explicit CollocationStep(const Arm&& arm, const CollocationOptions& options = {},
                           DryFriction friction = DryFriction::refused) = delete;
  ~CollocationStep() override;
  Status start(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& tau) override;
  Status advance(double h, Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau,
                 const Given& given) override;
  Status jump(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& tau) override;
  OneStep* rubbing() override { return rests_ ? &*rests_ : nullptr; }
  bool interpolates() const override { return true; }
  void inside(double c, Eigen::VectorXd& q, Eigen::VectorXd& v) const override;
  void memory(const std::function<void(double&)>& visit) override;
  void recalled() override;
  Stages stages() const override;
  bool chooses() const override { return options_.tolerance > 0.0; }
  double error() const override { return error_; }
  double error_order() const override { return s_ + 2.0; }
  void undo(Eigen::VectorXd& q, Eigen::VectorXd& v) override;
  void weights(double c, Eigen::VectorXd& once, Eigen::VectorXd& twice) const override;

 private:
  struct Ball {
    Eigen::Index q, v;  ///< its first coordinate and rate
  };
  bool held(int rate) const { return ways_[static_cast<std::size_t>(rate)] == Tape::held; }
  void reduce();
  bool place(double h);
  bool turn_balls(double h);
  void predict(double ratio);
  void differentiate(Workspace& ws);
  bool factor(double h);
  void set_forces(int i, Workspace& ws) const;
  bool believable(double h, Workspace& ws);
  bool lost(double h);
  /// x^T M x
  template <class X>
  double form(const Eigen::MatrixXd& M, const X& x) {
    product_.head(x.size()).noalias() = M * x;
    return x.dot(product_.head(x.size()));
  }
  Status iterate(double h, Workspace& ws);
  double missing(Eigen::Index k, const Eigen::Ref<const Eigen::VectorXd>& tau, const Workspace& ws) const;
  /// Sets the forces of loops for the sweeps: those at point i; between the points.
  void set_loop_forces(int i, Workspace& ws) const;
  void set_loop_forces_inside(double x, Workspace& ws) const;
  void take_loops(Workspace& ws, Eigen::VectorXd& forces);
  void drop_rows();
  void judge(Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau, const Given& given);

  const Arm* arm_;
  CollocationOptions options_;
  int s_;
  Eigen::VectorXd c_, b_;          ///< points and weights of the step
  Eigen::MatrixXd A_, A2_;         ///< integrals to the points, once and twice
  Eigen::MatrixXd monomials_;      ///< column j: the Lagrange polynomial of point j, lowest power first
  std::vector<int> free_;          ///< rates that are not prescribed
  std::vector<bool> free_q_;       ///< whether a coordinate is
  std::optional<OneStep> rests_;   ///< dry friction at an instant
  std::vector<signed char> ways_;  ///< of each rate, see Tape::Way
  std::vector<signed char> was_;   ///< the same before the last switch
  Eigen::VectorXd rub_;            ///< friction of sliding rates (nv)
  std::vector<Ball> balls_;
  Eigen::MatrixXd turn_weights_;  ///< A less half the weights of the step, which end at the middle
  Eigen::MatrixXd q_, v_, a_;     ///< at the points, one column each
  Eigen::MatrixXd tau_;           ///< forces there
  Eigen::MatrixXd u_, du_;        ///< turn of each ball from the middle, and its rate, in the rows of its rates
  Eigen::MatrixXd a_before_;
  Eigen::MatrixXd offsets_;                          ///< of feedback at the points
  std::vector<std::vector<Vec6<double>>> wrenches_;  ///< of the loads at the points
  Eigen::VectorXd q0_, v0_, qs_, vs_, as_, middle_;
  mutable Eigen::VectorXd once_, twice_;  ///< of `inside`
  std::optional<InverseDerivatives> derivatives_;
  Eigen::MatrixXd M_, C_, K_;              ///< of the free rates
  Eigen::MatrixXd M_all_, C_all_, K_all_;  ///< of all
  Eigen::MatrixXd rate_by_q_, rate_by_v_;
  Eigen::Index rows_ = 0;              ///< of loops
  Eigen::MatrixXd G_, closing_;        ///< their columns, of all and of the free rates
  Eigen::MatrixXd G_by_q_, G_by_v_;    ///< of their second derivatives by time
  Eigen::MatrixXd by_force_, closed_;  ///< M^-1 G and G^T M^-1 G of the free rates
  Eigen::LLT<Eigen::MatrixXd> inertia_, closure_;
  Eigen::VectorXd row_forces_;
  Eigen::MatrixXd left_;                        ///< of `drop_rows`
  Eigen::VectorXd own_;                         ///< of each row: the root of G^T M^-1 G
  Eigen::VectorXd taken_;                       ///< 1 of rows that are more than rounding beside others, else 0
  Eigen::Matrix3Xd found_;                      ///< g and its derivatives by time
  Eigen::MatrixXd reaction_, reaction_before_;  ///< forces of the rows at the points, one column each
  Eigen::MatrixXd newton_;
  Eigen::PartialPivLU<Eigen::MatrixXd> lu_;
  Eigen::VectorXd residual_, correction_, product_;
  Eigen::MatrixXd moved_;  ///< places, by a correction
  bool fresh_ = false;
  double h_ = 0.0;            ///< of the last step
  double h_factored_ = 0;     ///< of the matrix
  double contraction_ = 1.0;  ///< of the iteration, as last measured
  double best_ = 1.0;         ///< with Jacobians of the same step
  double scale_ = 0.0;        ///< v^T M v of the motion (J), its peaks remembered for a while
  double peak_ = 0.0;         ///< the same of its velocities alone
  double mass_ = 0.0;         ///< of the arm (kg)
  double fastest_ = 0.0;      ///< v^T M v: the largest in the last step (J)
  double error_ = 0.0, h_before_ = 0.0;
  std::unique_ptr<StepError> seen_;  ///< of steps that are chosen
  Eigen::VectorXd missed_force_;     ///< of the free rates, between the points
};

}  // namespace flexarm
