// Dual numbers with W directional derivatives: exact Jacobians of any kernel that is a template on its
// scalar.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>

namespace flexarm {

/// value + sum_k d[k] eps_k with eps_i eps_j = 0.
template <int W>
struct Dual {
  double value = 0.0;
  std::array<double, W> d{};

  Dual() = default;
  Dual(double v) : value(v) {}  // NOLINT: a number is a dual number

  /// f(x) with f'(x) = slope: the chain rule.
  Dual chain(double f, double slope) const {
    Dual out(f);
    for (int k = 0; k < W; ++k) out.d[k] = slope * d[k];
    return out;
  }
  Dual operator-() const { return chain(-value, -1.0); }
  Dual& operator+=(const Dual& o) {
    value += o.value;
    for (int k = 0; k < W; ++k) d[k] += o.d[k];
    return *this;
  }
  Dual& operator-=(const Dual& o) {
    value -= o.value;
    for (int k = 0; k < W; ++k) d[k] -= o.d[k];
    return *this;
  }
  Dual& operator*=(const Dual& o) {
    for (int k = 0; k < W; ++k) d[k] = d[k] * o.value + value * o.d[k];
    value *= o.value;
    return *this;
  }
  Dual& operator/=(const Dual& o) {
    const double inv = 1.0 / o.value;
    value *= inv;
    for (int k = 0; k < W; ++k) d[k] = (d[k] - value * o.d[k]) * inv;
    return *this;
  }
  Dual& operator*=(double s) {
    value *= s;
    for (double& x : d) x *= s;
    return *this;
  }

  friend Dual operator+(Dual a, const Dual& b) { return a += b; }
  friend Dual operator-(Dual a, const Dual& b) { return a -= b; }
  friend Dual operator*(Dual a, const Dual& b) { return a *= b; }
  friend Dual operator/(Dual a, const Dual& b) { return a /= b; }
  friend Dual operator+(double a, Dual b) {
    b.value += a;
    return b;
  }
  friend Dual operator+(Dual a, double b) {
    a.value += b;
    return a;
  }
  friend Dual operator-(double a, const Dual& b) { return a + (-b); }
  friend Dual operator-(Dual a, double b) {
    a.value -= b;
    return a;
  }
  friend Dual operator*(double a, Dual b) { return b *= a; }
  friend Dual operator*(Dual a, double b) { return a *= b; }
  friend Dual operator/(Dual a, double b) { return a *= 1.0 / b; }
  friend bool operator<(const Dual& a, double b) { return a.value < b; }

  friend Dual sqrt(const Dual& x) {
    const double s = std::sqrt(x.value);
    return x.chain(s, 0.5 / s);
  }
  friend Dual atan2(const Dual& y, const Dual& x) {
    Dual out(std::atan2(y.value, x.value));
    const double square = y.value * y.value + x.value * x.value;
    for (int k = 0; k < W; ++k) out.d[k] = (x.value * y.d[k] - y.value * x.d[k]) / square;
    return out;
  }
  friend Dual sin(const Dual& x) { return x.chain(std::sin(x.value), std::cos(x.value)); }
  friend Dual cos(const Dual& x) { return x.chain(std::cos(x.value), -std::sin(x.value)); }
};

/// Scalar of exact derivatives: four directions at a time.
using Tangent = Dual<4>;

}  // namespace flexarm

namespace Eigen {
template <int W>
struct NumTraits<flexarm::Dual<W>> : GenericNumTraits<double> {
  using Real = flexarm::Dual<W>;
  using NonInteger = flexarm::Dual<W>;
  using Nested = flexarm::Dual<W>;
  enum {
    IsComplex = 0,
    IsInteger = 0,
    IsSigned = 1,
    RequireInitialization = 1,
    ReadCost = W,
    AddCost = W,
    MulCost = 2 * W
  };
};
template <int W, class Op>
struct ScalarBinaryOpTraits<double, flexarm::Dual<W>, Op> {
  using ReturnType = flexarm::Dual<W>;
};
template <int W, class Op>
struct ScalarBinaryOpTraits<flexarm::Dual<W>, double, Op> {
  using ReturnType = flexarm::Dual<W>;
};
}  // namespace Eigen
