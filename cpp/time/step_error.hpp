// The error of a step of collocation, as far as it can be seen: at places of the arm, at its joints, and in its energy.
#pragma once

#include <Eigen/LU>
#include <functional>
#include <vector>

#include "flexarm/kinematics.hpp"

namespace flexarm {

/// Between its points a step of collocation does not solve the equations of motion: a force is missed there, whose
/// displacement is the error of the step. Places that are looked at are each link's end, the middle of its beam, and
/// the joints; energy is compared with the largest of the run. (docs/theory/time-integration.md, "Steps that are
/// chosen")
class StepError {
 public:
  /// @param free    rates that are not prescribed; must outlive it
  /// @param points  of the step, in parts of it
  /// @param rubs    whether the arm has dry friction: the last point is the end of the step
  /// @param tolerance  of a run: of places, in parts of the arm's length, of angles (rad), and of energy
  StepError(const Arm& arm, Workspace& ws, const std::vector<int>& free, const Eigen::VectorXd& points, bool rubs,
            double tolerance);

  /// Where the missed force is asked for, in parts of the step.
  const Eigen::VectorXd& asked() const { return asked_; }
  /// The displacements by the rates' coordinates at this state.
  void look(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v);
  /// For steps of this length, where the free rates have these matrices of mass, damping and stiffness.
  void factor(double h, const Eigen::MatrixXd& M, const Eigen::MatrixXd& C, const Eigen::MatrixXd& K);
  /// The largest error within the step, in parts of the allowed one; infinite where it is no number.
  /// @param missed_force  of the free rates, where it was asked for
  /// @param M  mass matrix of all rates; v, a  rates and accelerations where it was asked for
  /// @param kinetic  energy (J): the largest within the step
  double operator()(const Eigen::VectorXd& missed_force, const Eigen::MatrixXd& M, const Eigen::VectorXd& v,
                    const Eigen::VectorXd& a, double kinetic);
  /// Before a step is judged; and where it is taken back.
  void begin() { kinetic_before_ = kinetic_; }
  void undo() { kinetic_ = kinetic_before_; }
  /// Its numbers, for a state that is kept.
  void memory(const std::function<void(double&)>& visit);

 private:
  double of_places() const;
  double of_energy(const Eigen::VectorXd& missed_force, const Eigen::MatrixXd& M, const Eigen::VectorXd& v,
                   const Eigen::VectorXd& a);

  const Arm* arm_;
  const std::vector<int>* free_;
  Eigen::VectorXd asked_;
  double tolerance_;
  double allowed_;                   ///< error of a step, in parts of the arm's length and rad
  double length_ = 0.0;              ///< of the arm (m): from the base to the farthest end, along the links
  double places_missed_ = 0.0;       ///< within a step, over h^2 times the accelerations that are missed where asked
  double rates_missed_ = 0.0;        ///< the same over h times these
  double h_ = 0.0;                   ///< of the step (s)
  double kinetic_ = 0.0;             ///< the largest kinetic energy so far (J)
  double kinetic_before_ = 0.0;      ///< and before the last step
  std::vector<PlacedSlice> places_;  ///< that are looked at
  Eigen::MatrixXd moves_;            ///< moves by the coordinates: rows of each place and of the joints, over allowed_
  Mat6X<double> jacobian_;
  Eigen::MatrixXd filter_;  ///< of a damped step, which leaves the visible part of an error
  Eigen::PartialPivLU<Eigen::MatrixXd> filtered_;
  Eigen::VectorXd forced_, displaced_, impulse_, inertia_;
};

}  // namespace flexarm
