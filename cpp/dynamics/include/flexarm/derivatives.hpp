// Exact derivatives, by dual numbers through the sweeps of inverse dynamics and kinematics. O(N^2). On the fast kernels
// where they know the arm.
#pragma once

#include <memory>
#include <optional>

#include "flexarm/inverse.hpp"

namespace flexarm {

namespace lanes {
class KernelArm;
}

/// State of an arm in dual numbers, and its directions: every coordinate, then every rate, four at a time.
class TangentState {
 public:
  explicit TangentState(const Arm& arm);
  void set(const Eigen::VectorXd& q_value, const Eigen::VectorXd& v_value, const Eigen::VectorXd& a_value);
  /// Calls evaluate() with four directions seeded at once, then store(k, lane) for each: k < nq a coordinate, then
  /// rates, but for those where by_v is false.
  template <class Evaluate, class Store>
  void sweep(const Evaluate& evaluate, const Store& store, bool by_v = true);
  VecX<Tangent> q, v, a;
};

/// Exact Jacobians of inverse dynamics.
class InverseDerivatives {
 public:
  explicit InverseDerivatives(const Arm& arm, const std::vector<Load>& loads = {});
  /// Value of a load from now on.
  void set_wrench(std::size_t load, const Vec6<double>& wrench);
  /// dtau/dq (nv x nq) and dtau/dv (nv x nv) at (q, v, a). (dtau/da is the mass matrix.) Without `by_v` dv may be left
  /// as it is, which takes half the time.
  void operator()(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a,
                  bool by_v = true);
  Eigen::MatrixXd dq, dv;

 private:
  std::shared_ptr<const lanes::KernelArm> fast_;  ///< with its loads' values and memory; or else:
  std::vector<double> wrenches_, memory_;
  std::optional<SweepWorkspace<Tangent>> ws_;
  std::optional<TangentState> state_;
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
  MadeOnce kept_;                           ///< which owns the next
  const lanes::KernelArm* fast_ = nullptr;  ///< in space, with its memory; or else:
  std::vector<double> memory_;
  const Slice<Tangent>& slice(const Arm& arm);  ///< after move_arm
  Slice<Tangent> slice_;
  std::optional<SweepWorkspace<Tangent>> ws_;
  std::optional<TangentState> state_;
};

}  // namespace flexarm
