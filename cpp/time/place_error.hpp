// The error of a step of collocation, as far as it can be seen: at places of the arm, and at its joints.
#pragma once

#include <Eigen/LU>
#include <functional>
#include <vector>

#include "flexarm/kinematics.hpp"

namespace flexarm {

/// Between its points a step of collocation does not solve the equations of motion: a force is missed there. What this
/// displaces is the error of the step. Places that are looked at are each link's end, the middle of its beam, and the
/// joints. (docs/theory/time-integration.md, "Steps that are chosen")
class PlaceError {
 public:
  /// @param free    rates that are not prescribed; must outlive it
  /// @param points  of the step, in parts of it
  /// @param rubs    whether the arm has dry friction: the last point is the end of the step
  /// @param tolerance  of a run: of places, in parts of the arm's length, and of angles (rad)
  PlaceError(const Arm& arm, Workspace& ws, const std::vector<int>& free, const Eigen::VectorXd& points, bool rubs,
             double tolerance);

  /// Where the missed force is asked for, in parts of the step.
  const Eigen::VectorXd& asked() const { return asked_; }
  /// What the rates' coordinates move at this state.
  void look(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v);
  /// For steps of this length, where the free rates have these matrices of mass, damping and stiffness.
  void factor(double h, const Eigen::MatrixXd& M, const Eigen::MatrixXd& C, const Eigen::MatrixXd& K);
  /// The largest error of a place within the step, in parts of what a step may miss; infinite where it is no number.
  /// @param missed_force  of the free rates
  double operator()(const Eigen::VectorXd& missed_force);
  /// Its numbers, for a state that is kept.
  void memory(const std::function<void(double&)>& visit);

 private:
  const Arm* arm_;
  const std::vector<int>* free_;
  Eigen::VectorXd asked_;
  double allowed_;                   ///< error of a step, in parts of the arm's length and rad
  double length_ = 0.0;              ///< of the arm (m)
  double missed_part_ = 0.0;         ///< places missed within a step, over h^2 times accelerations missed where asked
  double missed_time2_ = 0.0;        ///< that times h^2 (s^2)
  std::vector<PlacedSlice> places_;  ///< that are looked at
  Eigen::MatrixXd moves_;            ///< what the coordinates move: rows of each place and of the joints, over allowed_
  Mat6X<double> jacobian_;
  Eigen::MatrixXd filter_;  ///< of a damped step, which leaves of an error what can be seen
  Eigen::PartialPivLU<Eigen::MatrixXd> filtered_;
  Eigen::VectorXd forced_, displaced_;
};

}  // namespace flexarm
