// Spatial vectors (Sec. 2 of the paper) are stacked [linear; angular] in body axes: velocity V = [v; w], acceleration
// A = [a; dw/dt] with a the absolute acceleration of the origin, force F = [f; m].
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

namespace flexarm {

constexpr double kPi = 3.14159265358979323846;

template <class S>
using Vec6 = Eigen::Matrix<S, 6, 1>;
template <class S>
using Mat3 = Eigen::Matrix<S, 3, 3>;
template <class S>
using Mat6 = Eigen::Matrix<S, 6, 6>;
template <class S>
using Mat6X = Eigen::Matrix<S, 6, Eigen::Dynamic>;

/// tilde(a) b = a x b (Eq. 2).
template <class Derived>
Mat3<typename Derived::Scalar> tilde(const Eigen::MatrixBase<Derived>& a) {
  using S = typename Derived::Scalar;
  Mat3<S> m;
  m << S(0), -a[2], a[1], a[2], S(0), -a[0], -a[1], a[0], S(0);
  return m;
}

}  // namespace flexarm
