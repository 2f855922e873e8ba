// The operations that kernels need of a scalar: of one double, or (pack.hpp) of one in each lane.
#pragma once

#include <cstddef>

#include "wide/views.hpp"

namespace {

template <class S>
struct Lanes;
template <>
struct Lanes<double> {
  static constexpr int width = 1;
  static constexpr int lag = 0;  ///< rounds by which derivatives converge later
  using Mask = bool;
  static double load(const double* p) { return *p; }
  static void store(double* p, double x) { *p = x; }
  static double select(bool m, double a, double b) { return m ? a : b; }
  static bool all(bool m) { return m; }
  static bool none_of(bool m) { return !m; }
  static bool any(bool m) { return m; }
  static bool lane(bool m, int) { return m; }
  static bool everywhere(bool m) { return m; }
  static double root(double x) { return __builtin_sqrt(x); }
  static double atan2(double y, double x) { return __builtin_atan2(y, x); }
  static double size(double x) { return __builtin_fabs(x); }
  static double larger(double a, double b) { return a > b ? a : b; }
  static double smaller(double a, double b) { return a < b ? a : b; }
  static bool finite(double x) { return x - x == 0.0; }
};

template <class S>
S number(double x) {
  return S{} + x;
}

}  // namespace
