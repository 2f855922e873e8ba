// Drives of joints: forces and torques, or prescribed motions ("displacement driven", Sec. 5.2).
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

namespace flexarm {

struct MotionValue {
  double q, v, a;  ///< rad or m, and its first two time derivatives
};

/// A smooth function of time in polynomial pieces: on [breaks_k, breaks_k+1] the sum of coefficients(i, k)
/// (t - breaks_k)^(d - i), highest power d first. Copies share the numbers. As a `Drive::motion` it is one that a file
/// can hold; its value, as any other law of time, is a PolynomialValue.
class PiecewisePolynomial {
 public:
  /// @throws std::invalid_argument when the sizes do not fit or the breaks do not increase
  PiecewisePolynomial(Eigen::VectorXd breaks, Eigen::MatrixXd coefficients);
  /// The same at all times.
  static PiecewisePolynomial constant(double value);
  /// Value and derivatives at t; outside the breaks the first or last piece continues.
  MotionValue operator()(double t) const;
  /// The same, but constant outside the breaks, at the first or last value.
  PiecewisePolynomial standing() const;
  const Eigen::VectorXd& breaks() const { return numbers_->first; }
  const Eigen::MatrixXd& coefficients() const { return numbers_->second; }

 private:
  std::shared_ptr<const std::pair<Eigen::VectorXd, Eigen::MatrixXd>> numbers_;
};

struct PolynomialValue {
  PiecewisePolynomial of;
  double operator()(double t) const { return of(t).q; }
};
/// Several, written into a vector.
struct PolynomialValues {
  std::vector<PiecewisePolynomial> of;
  void operator()(double t, Eigen::VectorXd& out) const {
    out.resize(static_cast<Eigen::Index>(of.size()));
    for (std::size_t k = 0; k < of.size(); ++k) out[static_cast<Eigen::Index>(k)] = of[k](t).q;
  }
};
/// Six, as a wrench [f; m] (N, N m).
struct PolynomialWrench {
  std::vector<PiecewisePolynomial> of;
  Eigen::Matrix<double, 6, 1> operator()(double t) const {
    Eigen::Matrix<double, 6, 1> out;
    for (std::size_t k = 0; k < 6; ++k) out[static_cast<Eigen::Index>(k)] = of[k](t).q;
    return out;
  }
};

/// A drive of one velocity coordinate: a motion, or a force or torque (N, N m). Or of several at once, in proportion.
struct Drive {
  int coordinate;                             ///< not used with a `column`
  std::function<MotionValue(double)> motion;  ///< empty for a force-driven coordinate
  std::function<double(double)> force;        ///< empty for a prescribed coordinate
  Eigen::VectorXd breaks = {};                ///< times that no step may pass over, such as those of samples
  Eigen::VectorXd column = {};  ///< generalised force per unit of `force`, (nv), such as a patch's per volt
  bool rubs = false;            ///< dry friction: rest as a motion, or the sliding force
};

}  // namespace flexarm
