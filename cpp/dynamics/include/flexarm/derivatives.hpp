// Exact derivatives, by dual numbers through the recursions of inverse dynamics and kinematics. O(N^2).
#pragma once

#include <memory>
#include <optional>

#include "flexarm/inverse.hpp"

namespace flexarm {

namespace lanes {
class KernelArm;
}

/// Exact Jacobians of inverse dynamics.
class InverseDerivatives {
 public:
  explicit InverseDerivatives(const Arm& arm, const std::vector<Load>& loads = {});
  /// Value of a load from now on.
  void set_wrench(std::size_t load, const Vec6<double>& wrench);
  /// dtau/dq (nv x nq) and dtau/dv (nv x nv) at (q, v, a). (dtau/da is the mass matrix.) Without `by_v` dv is left as
  /// it is, which takes half the time.
  void operator()(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a,
                  bool by_v = true);
  Eigen::MatrixXd dq, dv;

 private:
  std::shared_ptr<const lanes::KernelArm> known_;  ///< with its loads
  std::vector<double> wrenches_, memory_;
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
  std::vector<double> memory_;
};

}  // namespace flexarm
