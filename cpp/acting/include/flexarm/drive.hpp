// What drives the joints: forces and torques, or prescribed motions ("displacement driven", Sec. 5.2).
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

namespace flexarm {

struct MotionValue {
  double q, v, a;  ///< rad or m, and its first two time derivatives
};

/// A smooth function of time in polynomial pieces: on [breaks_k, breaks_k+1] the sum of coefficients(i, k)
/// (t - breaks_k)^(d - i), highest power d first.
class PiecewisePolynomial {
 public:
  /// @throws std::invalid_argument when the sizes do not fit or the breaks do not increase
  PiecewisePolynomial(Eigen::VectorXd breaks, Eigen::MatrixXd coefficients);
  /// Value and derivatives at t; outside the breaks the first or last piece goes on.
  MotionValue operator()(double t) const;
  /// The same, but outside the breaks it stands still at its first or last value.
  MotionValue within(double t) const;
  const Eigen::VectorXd& breaks() const { return breaks_; }
  const Eigen::MatrixXd& coefficients() const { return coefficients_; }

 private:
  Eigen::VectorXd breaks_;
  Eigen::MatrixXd coefficients_;
};

/// A drive of one velocity coordinate: a motion, or a force or torque (N, N m). Or of several at once, in proportion.
struct Drive {
  int coordinate;                             ///< not used with a `column`
  std::function<MotionValue(double)> motion;  ///< empty for a force-driven coordinate
  std::function<double(double)> force;        ///< empty for a prescribed coordinate
  Eigen::VectorXd breaks = {};                ///< times that no step may pass over, such as those of samples
  Eigen::VectorXd column = {};  ///< generalised force per unit of `force`, (nv), such as a patch's per volt
  bool rubs = false;            ///< dry friction: a motion that is rest, or the force on what slides
};

}  // namespace flexarm
