// Packs of doubles, one scenario (or one point of a beam) in each lane, by the compiler's vector types. Included by the
// kernels alone.
#pragma once

#include "lanes/scalar.hpp"

namespace {

typedef double Pack __attribute__((vector_size(8 * FLEXARM_WIDTH), may_alias));
using PackMask = decltype(Pack{} < Pack{});

template <>
struct Lanes<Pack> {
  static constexpr int width = FLEXARM_WIDTH;
  using Mask = PackMask;
  static Pack load(const double* p) {
    Pack x;
    __builtin_memcpy(&x, p, sizeof(x));
    return x;
  }
  static void store(double* p, const Pack& x) { __builtin_memcpy(p, &x, sizeof(x)); }
  static Pack select(const PackMask& m, const Pack& a, const Pack& b) { return m ? a : b; }
  static bool all(const PackMask& m) {
    long both = -1;
    for (int i = 0; i < width; ++i) both &= m[i];
    return both != 0;
  }
  static PackMask none_of(const PackMask& m) { return ~m; }  // where m is not
  static bool any(const PackMask& m) { return !all(~m); }
  static bool lane(const PackMask& m, int i) { return m[i] != 0; }
  static PackMask everywhere(bool m) { return PackMask{} - (m ? 1 : 0); }
  static Pack root(const Pack& x) {
    Pack y{};
    for (int i = 0; i < width; ++i) y[i] = __builtin_sqrt(x[i]);
    return y;
  }
  static Pack size(const Pack& x) { return x < 0.0 ? -x : x; }
  static Pack larger(const Pack& a, const Pack& b) { return a > b ? a : b; }
  static Pack smaller(const Pack& a, const Pack& b) { return a < b ? a : b; }
  static PackMask finite(const Pack& x) { return x - x == 0.0; }
};

/// sin and cos without branches: x less whole quarter turns (pi/2 in three parts: exact to 1e5 turns), Taylor series.
template <class S>
void sine_cosine(const S& x, S& s, S& c) {
  constexpr double kRound = 6755399441055744.0;  // 1.5 2^52: what is added and taken off again rounds to a whole number
  const S whole = (x * 0.63661977236758134308 + kRound);
  const S n = whole - kRound;
  S r = ((x - n * 1.57079632673412561417e+00) - n * 6.07710050630396597660e-11) - n * 2.02226624879595063154e-21;
  r = Lanes<S>::larger(number<S>(-1.0),
                       Lanes<S>::smaller(number<S>(1.0), r));  // of what has no digits behind the point
  const S z = r * r;
  S a = number<S>(1.0 / 355687428096000.0), b = number<S>(1.0 / 20922789888000.0);
  a = a * z - 1.0 / 1307674368000.0;
  a = a * z + 1.0 / 6227020800.0;
  a = a * z - 1.0 / 39916800.0;
  a = a * z + 1.0 / 362880.0;
  a = a * z - 1.0 / 5040.0;
  a = a * z + 1.0 / 120.0;
  a = a * z - 1.0 / 6.0;
  a = r + r * z * a;
  b = b * z - 1.0 / 87178291200.0;
  b = b * z + 1.0 / 479001600.0;
  b = b * z - 1.0 / 3628800.0;
  b = b * z + 1.0 / 40320.0;
  b = b * z - 1.0 / 720.0;
  b = b * z + 1.0 / 24.0;
  b = b * z - 0.5;
  b = 1.0 + z * b;
  // quarter turn n mod 4, in doubles
  const S pair = ((n * 0.5 - 0.25) + kRound) - kRound;  // floor(n / 2)
  const S odd = n - 2.0 * pair;                         // 0 or 1
  const S twice = ((pair * 0.5 - 0.25) + kRound) - kRound;
  const S sign = 1.0 - 2.0 * (pair - 2.0 * twice);  // 1 or -1
  s = sign * (a + odd * (b - a));
  c = sign * (b - odd * (b + a));
}

/// Of s^k in b, c, db/ds and dc/ds of a turn: (-1)^k / (2k + 2)!, (-1)^k / (2k + 3)!, and k + 1 times those of k + 1.
struct TurnSeries {
  static constexpr int kTerms = 13;
  double of[4][kTerms] = {};

  constexpr TurnSeries() {
    for (int f = 0; f < 2; ++f)
      for (int k = 0; k <= kTerms; ++k) {
        double x = k % 2 ? -1.0 : 1.0;
        for (int i = 2; i <= 2 * k + 2 + f; ++i) x /= i;
        if (k < kTerms) of[f][k] = x;
        if (k > 0) of[2 + f][k - 1] = k * x;
      }
  }
};
constexpr TurnSeries kTurn;

/// Of the rotation exp(t~) and its Jacobian, as functions of s = |t|^2; see spatial.hpp. Taylor series: to the last
/// digit for turns up to pi.
template <class S>
struct Turn {
  S a, b, c, db, dc;
  explicit Turn(const S& s) {
    const S ss = s * s;
    b = sum(kTurn.of[0], s, ss);
    c = sum(kTurn.of[1], s, ss);
    db = sum(kTurn.of[2], s, ss);
    dc = sum(kTurn.of[3], s, ss);
    a = 1.0 - s * c;
  }

 private:
  /// Even and odd powers apart: two short chains.
  static S sum(const double* x, const S& s, const S& ss) {
    S even = number<S>(x[12]), odd = number<S>(x[11]);
#pragma GCC unroll 5
    for (int k = 10; k > 0; k -= 2) {
      even = even * ss + x[k];
      odd = odd * ss + x[k - 1];
    }
    return (even * ss + x[0]) + s * odd;
  }
};

/// Sums of neighbours `half` lanes apart: of a where that bit of the lane is 0, of b where it is 1.
inline Pack fold_pair(const Pack& a, const Pack& b, int half) {
  constexpr int w = FLEXARM_WIDTH;
#if defined(__GNUC__) && !defined(__clang__)
  PackMask own{}, other{};
  for (int l = 0; l < w; ++l) {
    const int from = l & half ? w : 0;
    own[l] = from + l;
    other[l] = from + (l ^ half);
  }
  return __builtin_shuffle(a, b, own) + __builtin_shuffle(a, b, other);
#else
  Pack sum{};
  for (int l = 0; l < w; ++l) sum[l] = l & half ? b[l] + b[l ^ half] : a[l] + a[l ^ half];
  return sum;
#endif
}

/// Sums over the lanes of each of n packs; where scalar and pack are one type there is nothing to sum.
inline void sum_lanes(const double*, int, const double*) {}
inline void sum_lanes(const Pack*, int, const Pack*) {}
inline void sum_lanes(const Pack* in, int n, double* out) {
  constexpr int w = FLEXARM_WIDTH;
  int k = 0;
  for (; k + w <= n; k += w) {  // a square of them, folded in halves; out lies over in, and never ahead of it
    Pack fold[w];
    for (int i = 0; i < w; ++i) fold[i] = in[k + i];
#pragma GCC unroll 4
    for (int half = w / 2; half >= 1; half /= 2)
#pragma GCC unroll 4
      for (int i = 0; i < half; ++i) fold[i] = fold_pair(fold[i], fold[i + half], half);
    __builtin_memcpy(out + k, &fold[0], sizeof(Pack));
  }
  for (; k < n; ++k) {
    const Pack x = in[k];
    double sum = x[0];
    for (int i = 1; i < w; ++i) sum += x[i];
    out[k] = sum;
  }
}

}  // namespace
