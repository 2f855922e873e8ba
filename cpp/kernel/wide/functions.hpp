// Sine and cosine, and functions of a rotation vector, of any scalar and without branches.
#pragma once

#include "wide/scalar.hpp"

namespace {

/// sin and cos without branches: x less whole quarter turns (pi/2 in three parts: exact to 1e5 turns), Taylor series.
template <class S>
void sine_cosine(const S& x, S& s, S& c) {
  constexpr double kRound = 6755399441055744.0;  // 1.5 2^52: added and taken off again, it rounds to a whole number
  const S whole = (x * 0.63661977236758134308 + kRound);
  const S n = whole - kRound;
  S r = ((x - n * 1.57079632673412561417e+00) - n * 6.07710050630396597660e-11) - n * 2.02226624879595063154e-21;
  constexpr double kDigits = 1e15;  // a number without digits behind the point has no sine: nan
  r = Lanes<S>::select(Lanes<S>::size(x) < kDigits, r, number<S>(__builtin_nan("")));
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

/// Of the rotation exp(t~) and its Jacobian, as functions of s = |t|^2: R = 1 + a t~ + b t~^2, and
/// J = 1 + b t~ + c t~^2 (Eq. 35). Taylor series are right to the
/// last digit for turns up to pi; sines take over where they are no longer needed for their digits.
template <class S>
struct Turn {
  using L = Lanes<S>;
  static constexpr double kSeries = 9.0;
  S a, b, c, db, dc;
  explicit Turn(const S& s) {
    const S ss = s * s;
    b = sum(kTurn.of[0], s, ss);
    c = sum(kTurn.of[1], s, ss);
    db = sum(kTurn.of[2], s, ss);
    dc = sum(kTurn.of[3], s, ss);
    a = 1.0 - s * c;
    const auto small = s < kSeries;
    if (L::all(small)) return;
    const S large = L::larger(number<S>(kSeries), s), over = 1.0 / large, t = L::root(large);
    S sine, cosine;
    sine_cosine(t, sine, cosine);
    const S far_a = sine / t, far_b = (1.0 - cosine) * over, far_c = (1.0 - far_a) * over, half = 0.5 * over;
    a = L::select(small, a, far_a);
    b = L::select(small, b, far_b);
    c = L::select(small, c, far_c);
    db = L::select(small, db, half * (far_a - 2.0 * far_b));
    dc = L::select(small, dc, half * (far_b - 3.0 * far_c));
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

}  // namespace
