// Spatial operators (Sec. 2 and 4.1 of the paper).
//
// Spatial vectors are stacked [linear; angular] in body axes: velocity V = [v; w], acceleration
// A = [a; dw/dt] with a the absolute acceleration of the origin, force F = [f; m].
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

namespace flexarm {

template <class S>
using Vec3 = Eigen::Matrix<S, 3, 1>;
template <class S>
using Vec6 = Eigen::Matrix<S, 6, 1>;
template <class S>
using Mat3 = Eigen::Matrix<S, 3, 3>;
template <class S>
using Mat6 = Eigen::Matrix<S, 6, 6>;
template <class S>
using VecX = Eigen::Matrix<S, Eigen::Dynamic, 1>;
template <class S>
using MatX = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;
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

/// Coefficients of the rotation exp(tilde(t)) and of its left Jacobian, as functions of s = |t|^2:
/// a = sin|t|/|t|, b = (1 - cos|t|)/|t|^2, c = (|t| - sin|t|)/|t|^3, and db/ds, dc/ds.
template <class S>
struct RotationCoefficients {
  S a, b, c, db, dc;

  explicit RotationCoefficients(const S& s) {
    if (s < 1.0) {  // Taylor series: sum (-s)^k / (2k + 1)!, (2k + 2)!, (2k + 3)!; below 1e-17 after ten terms
      a = b = c = db = dc = S(0);
      for (int k = 9; k >= 0; --k) {
        a = 1.0 - s * a / ((2.0 * k + 2.0) * (2.0 * k + 3.0));
        b = 1.0 - s * b / ((2.0 * k + 3.0) * (2.0 * k + 4.0));
        c = 1.0 - s * c / ((2.0 * k + 4.0) * (2.0 * k + 5.0));
        // term k + 1 of b and c differentiated: ratio of successive coefficients (k + 2)/(k + 1)
        db = 1.0 - s * db * ((k + 2.0) / (k + 1.0)) / ((2.0 * k + 5.0) * (2.0 * k + 6.0));
        dc = 1.0 - s * dc * ((k + 2.0) / (k + 1.0)) / ((2.0 * k + 6.0) * (2.0 * k + 7.0));
      }
      b = b / 2.0;
      c = c / 6.0;
      db = -db / 24.0;
      dc = -dc / 120.0;
    } else {
      using std::cos;
      using std::sin;
      using std::sqrt;
      const S t = sqrt(s);
      a = sin(t) / t;
      b = (1.0 - cos(t)) / s;
      c = (1.0 - a) / s;
      db = (a - 2.0 * b) / (2.0 * s);
      dc = (b - 3.0 * c) / (2.0 * s);
    }
  }
};

/// exp(tilde(t)), the rotation by the vector t.
template <class S>
Mat3<S> rotation(const Vec3<S>& t, const RotationCoefficients<S>& k) {
  const Mat3<S> tt = tilde(t);
  Mat3<S> R = k.b * (tt * tt) + k.a * tt;
  R.diagonal().array() += S(1);
  return R;
}

/// The operator that carries the whole mechanics (Eq. 68): body n+1 has orientation R and position r in body
/// n. Phi = [R^T, -R^T tilde(r); 0, R^T] takes a velocity outward, Phi^T brings a force inward.
template <class S>
struct Phi {
  Mat3<S> R = Mat3<S>::Identity();
  Vec3<S> r = Vec3<S>::Zero();

  /// Phi V
  Vec6<S> outward(const Vec6<S>& V) const {
    const Vec3<S> w = V.template tail<3>();
    Vec6<S> out;
    out.template head<3>() = R.transpose() * (V.template head<3>() + w.cross(r));
    out.template tail<3>() = R.transpose() * w;
    return out;
  }

  /// Phi^T F, for one force or for several side by side.
  template <class In, class Out>
  void inward(const Eigen::MatrixBase<In>& F, Eigen::MatrixBase<Out>& out) const {
    for (Eigen::Index k = 0; k < F.cols(); ++k) {
      const Vec3<S> f = R * F.col(k).template head<3>();
      const Vec3<S> m = R * F.col(k).template tail<3>();
      out.col(k).template head<3>() = f;
      out.col(k).template tail<3>() = m + r.cross(f);
    }
  }
  Vec6<S> inward(const Vec6<S>& F) const {
    Vec6<S> out;
    inward(F, out);
    return out;
  }

  /// Phi^T M Phi, an inertia seen from the inner body.
  Mat6<S> inward_inertia(const Mat6<S>& M) const {
    Mat6<S> half, out;
    inward(M, half);                         // Phi^T M
    const Mat6<S> halfT = half.transpose();  // M Phi
    inward(halfT, out);
    const Mat6<S> outT = out.transpose();
    return 0.5 * (out + outT);  // symmetric to the last bit
  }
};

}  // namespace flexarm
