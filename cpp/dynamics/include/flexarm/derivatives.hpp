// Exact derivatives, by dual numbers through the recursions of inverse dynamics and kinematics. O(N^2).
#pragma once

#include <optional>

#include "flexarm/inverse.hpp"

namespace flexarm {

namespace lanes {
class KernelArm;
class Memory;
class SlopesMemory;
}  // namespace lanes

/// Exact Jacobians of inverse dynamics. Feedback laws are not in them: see add_feedback_slopes.
class InverseDerivatives {
 public:
  explicit InverseDerivatives(const Arm& arm, const std::vector<Load>& loads = {});
  /// Value of a load from now on.
  void set_wrench(std::size_t load, const Vec6<double>& wrench);
  void recall(const Workspace& ws);  ///< of a run, the memory of its contacts, and the forces that loops hold with
  /// Loops hold with these forces from now on, one for each row of the arm's loops (Loop::rows); none: with none.
  /// @throws std::invalid_argument where there are others
  void hold(const Arm& arm, const Eigen::VectorXd& forces);
  /// dtau/dq (nv x nq) and dtau/dv (nv x nv) at (q, v, a). (dtau/da is the mass matrix.) Without `by_v` dv is left as
  /// it is, which takes half the time.
  void operator()(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a,
                  bool by_v = true);
  Eigen::MatrixXd dq, dv;
  /// Of d^2 g/dt^2 at fixed accelerations, of the rigid rows of loops: by the coordinates, and then by the rates.
  Eigen::MatrixXd loops;

 private:
  Held<lanes::SlopesMemory> memory_;
};

/// Exact Jacobians of forward dynamics, from those of inverse dynamics at its accelerations: da/dq = -M^-1 dtau/dq,
/// da/dv = -M^-1 dtau/dv, da/dtau = M^-1. M^-1 is the articulated-body method's, in O(N) for a column.
class ForwardDerivatives {
 public:
  /// @param prescribed  rates whose acceleration is given (in `a`), as of a Workspace: their rows are zero, and their
  /// forces have no effect
  explicit ForwardDerivatives(const Arm& arm, const std::vector<Load>& loads = {},
                              const std::vector<bool>& prescribed = {});
  /// Value of a load from now on.
  void set_wrench(std::size_t load, const Vec6<double>& wrench);
  /// da/dq (nv x nq), da/dv and da/dtau (nv x nv) at (q, v, tau), and a. Columns of a ball's quaternion are those of
  /// its rotation, for any length of the quaternion.
  /// @return Status::singular where a coordinate has no inertia, Status::not_finite; the matrices are then as they were
  Status operator()(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& tau);
  Eigen::MatrixXd dq, dv, dtau;
  Eigen::VectorXd a;  ///< result; input where prescribed

 private:
  Held<lanes::SlopesMemory> memory_;
};

/// Exact derivatives of the motion of one slice, world axes.
class MotionDerivatives {
 public:
  /// @param x  metres along the link's beam, or nothing for the link's end
  MotionDerivatives(const Arm& arm, std::size_t link, std::optional<double> x);
  /// By q (12 x nq) and v (12 x nv) of [velocity; acceleration] at fixed a. (Those of the acceleration by a are the
  /// Jacobian.)
  void operator()(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a);
  Eigen::MatrixXd dq, dv;
  /// Time derivative of the Jacobian (6 x nv) at q and v.
  Mat6X<double> jacobian_rate(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v);

 private:
  PlacedSlice at_;
  MadeOnce kept_;                  ///< which owns the next
  const lanes::KernelArm* known_;  ///< in space
  Held<lanes::Memory> memory_;
};

}  // namespace flexarm
