// Dual numbers for the kernels: a double with its derivatives in some directions. Included by the kernels alone.
#pragma once

#include "lanes/chain.hpp"

namespace {

/// A number and its derivatives in several directions.
struct LaneDual {
  static constexpr int packs = FLEXARM_WIDTH < 8 ? 8 / FLEXARM_WIDTH : 1, directions = packs * FLEXARM_WIDTH;
  double x;
  Pack d[packs];

  LaneDual operator-() const {
    return map(-x, [&](int i) { return -d[i]; });
  }
  template <class F>
  static LaneDual map(double x, const F& f) {
    LaneDual out;
    out.x = x;
    for (int i = 0; i < packs; ++i) out.d[i] = f(i);
    return out;
  }
  friend LaneDual operator+(const LaneDual& a, const LaneDual& b) {
    return map(a.x + b.x, [&](int i) { return a.d[i] + b.d[i]; });
  }
  friend LaneDual operator-(const LaneDual& a, const LaneDual& b) {
    return map(a.x - b.x, [&](int i) { return a.d[i] - b.d[i]; });
  }
  friend LaneDual operator*(const LaneDual& a, const LaneDual& b) {
    return map(a.x * b.x, [&](int i) { return a.x * b.d[i] + b.x * a.d[i]; });
  }
  friend LaneDual operator+(const LaneDual& a, double b) {
    return map(a.x + b, [&](int i) { return a.d[i]; });
  }
  friend LaneDual operator-(const LaneDual& a, double b) { return a + (-b); }
  friend LaneDual operator*(const LaneDual& a, double b) {
    return map(a.x * b, [&](int i) { return a.d[i] * b; });
  }
  friend LaneDual operator+(double a, const LaneDual& b) { return b + a; }
  friend LaneDual operator-(double a, const LaneDual& b) {
    return map(a - b.x, [&](int i) { return -b.d[i]; });
  }
  friend LaneDual operator*(double a, const LaneDual& b) { return b * a; }
  friend LaneDual operator/(const LaneDual& a, const LaneDual& b) {
    const double over = 1.0 / b.x, x = a.x * over;
    return map(x, [&](int i) { return (a.d[i] - x * b.d[i]) * over; });
  }
  friend LaneDual operator/(const LaneDual& a, double b) { return a * (1.0 / b); }
  friend LaneDual operator/(double a, const LaneDual& b) {
    const double x = a / b.x, slope = -x / b.x;
    return map(x, [&](int i) { return slope * b.d[i]; });
  }
#define FLEXARM_IN_PLACE(op)                                                   \
  LaneDual& operator op## = (const LaneDual& b) { return *this = *this op b; } \
  LaneDual& operator op## = (double b) { return *this = *this op b; }
  FLEXARM_IN_PLACE(+)
  FLEXARM_IN_PLACE(-)
  FLEXARM_IN_PLACE(*)
  FLEXARM_IN_PLACE(/)
#undef FLEXARM_IN_PLACE
  bool operator<(double b) const { return x < b; }
  bool operator>(double b) const { return x > b; }
  bool operator<(const LaneDual& b) const { return x < b.x; }
  bool operator>(const LaneDual& b) const { return x > b.x; }
};

template <>
struct Lanes<LaneDual> {
  static constexpr int width = 1, lag = 2;
  using Mask = bool;
  static LaneDual load(const double* p) { return LaneDual{} + *p; }
  static LaneDual select(bool m, const LaneDual& a, const LaneDual& b) { return m ? a : b; }
  static bool everywhere(bool m) { return m; }
  static bool all(bool m) { return m; }
  static bool none_of(bool m) { return !m; }
  static bool finite(const LaneDual& a) { return a.x - a.x == 0.0; }
  static LaneDual root(const LaneDual& a) {
    const double x = __builtin_sqrt(a.x), slope = 0.5 / x;
    return LaneDual::map(x, [&](int i) { return slope * a.d[i]; });
  }
  static LaneDual atan2(const LaneDual& y, const LaneDual& x) {
    const double over = 1.0 / (x.x * x.x + y.x * y.x);
    return LaneDual::map(__builtin_atan2(y.x, x.x), [&](int i) { return over * (x.x * y.d[i] - y.x * x.d[i]); });
  }
  static LaneDual size(const LaneDual& a) { return a < 0.0 ? -a : a; }
  static LaneDual larger(const LaneDual& a, const LaneDual& b) { return a > b ? a : b; }
  static LaneDual smaller(const LaneDual& a, const LaneDual& b) { return a < b ? a : b; }
};

inline LaneDual widen(const LaneDual& x, const LaneDual&) { return x; }
inline void sum_lanes(const LaneDual*, int, const LaneDual*) {}

template <>
inline void sine_cosine<LaneDual>(const LaneDual& x, LaneDual& s, LaneDual& c) {
  double sine, cosine;
  sine_cosine(x.x, sine, cosine);
  const LaneDual at = x;  // s or c may be x
  s = LaneDual::map(sine, [&](int i) { return cosine * at.d[i]; });
  c = LaneDual::map(cosine, [&](int i) { return -sine * at.d[i]; });
}

inline double slope_of(const LaneDual& x, int direction) {
  return x.d[direction / FLEXARM_WIDTH][direction % FLEXARM_WIDTH];
}

/// Calls visit(first, count) with the slopes of x[first], x[first + 1], .. set to 1, each in a direction of its own.
template <class Visit>
void for_directions(LaneDual* x, int all, const Visit& visit) {
  constexpr int W = FLEXARM_WIDTH, D = LaneDual::directions;
  for (int first = 0; first < all; first += D) {
    const int count = all - first < D ? all - first : D;
    const auto seed = [&](double slope) {
      for (int k = 0; k < count; ++k) x[first + k].d[k / W][k % W] = slope;
    };
    seed(1.0);
    visit(first, count);
    seed(0.0);
  }
}

}  // namespace
