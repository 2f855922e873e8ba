// A function of the elastic coordinates with what a motion does to it: its value, its rate, the convective part of its
// second rate (that of a motion without elastic accelerations), and its slopes by the coordinates.
#pragma once

#include <Eigen/Core>
#include <cmath>

namespace oracle {

struct Jet {
  double value = 0.0, rate = 0.0, bias = 0.0;
  Eigen::VectorXd slopes = {};  ///< empty: none

  Jet() = default;
  Jet(double v) : value(v) {}  // NOLINT: a number is a constant
  Jet(double v, double r, double b, const Eigen::VectorXd& s) : value(v), rate(r), bias(b), slopes(s) {}

  /// f(x), of which df and ddf are the derivatives at x.
  Jet chain(double f, double df, double ddf) const {
    return {f, df * rate, df * bias + ddf * rate * rate, df * slopes};
  }
  Jet operator-() const { return chain(-value, -1.0, 0.0); }
  Jet& operator+=(const Jet& o) {
    value += o.value;
    rate += o.rate;
    bias += o.bias;
    if (slopes.size() == 0)
      slopes = o.slopes;
    else if (o.slopes.size() > 0)
      slopes += o.slopes;
    return *this;
  }
  Jet& operator-=(const Jet& o) { return *this += -o; }
  Jet& operator*=(const Jet& o) { return *this = *this * o; }
  friend Jet operator+(Jet a, const Jet& b) { return a += b; }
  friend Jet operator-(Jet a, const Jet& b) { return a -= b; }
  friend Jet operator*(const Jet& a, const Jet& b) {
    Jet out = b.chain(a.value * b.value, a.value, 0.0);
    out += {0.0, a.rate * b.value, a.bias * b.value + 2.0 * a.rate * b.rate, b.value * a.slopes};
    return out;
  }
  friend Jet sin(const Jet& x) { return x.chain(std::sin(x.value), std::cos(x.value), -std::sin(x.value)); }
  friend Jet cos(const Jet& x) { return x.chain(std::cos(x.value), -std::sin(x.value), -std::cos(x.value)); }
};

}  // namespace oracle

namespace Eigen {
template <>
struct NumTraits<oracle::Jet> : GenericNumTraits<double> {
  using Real = oracle::Jet;
  using NonInteger = oracle::Jet;
  using Nested = oracle::Jet;
  enum {
    IsComplex = 0,
    IsInteger = 0,
    IsSigned = 1,
    RequireInitialization = 1,
    ReadCost = 10,
    AddCost = 10,
    MulCost = 30
  };
};
}  // namespace Eigen

namespace oracle {

using Jet3 = Eigen::Matrix<Jet, 3, 1>;
using JetMatrix = Eigen::Matrix<Jet, 3, 3>;

inline Eigen::Vector3d values(const Jet3& a) { return {a[0].value, a[1].value, a[2].value}; }
inline Eigen::Vector3d rates(const Jet3& a) { return {a[0].rate, a[1].rate, a[2].rate}; }
inline Eigen::Vector3d biases(const Jet3& a) { return {a[0].bias, a[1].bias, a[2].bias}; }
inline Eigen::Vector3d slopes(const Jet3& a, Eigen::Index k) {
  const auto of = [&](const Jet& j) { return j.slopes.size() > 0 ? j.slopes[k] : 0.0; };
  return {of(a[0]), of(a[1]), of(a[2])};
}

}  // namespace oracle
