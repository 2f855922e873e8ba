// When Newton's iteration of a step has come near enough, of one arm or of each in a pack.
#pragma once

#include "wide/scalar.hpp"

namespace {

constexpr double kVanishing = 1e-14;  // parts of the coordinates: a correction below that stalls is rounding
constexpr double kForget = 0.99;      // per step, of the motion's scale
constexpr double kStalls = 0.5;       // contraction above which an iteration stalls
constexpr double kDivided = 1e-3;     // the least that the sum of all corrections to come is divided by

template <class S>
struct Newton {
  using L = Lanes<S>;
  using Mask = typename L::Mask;

  S contraction;  ///< of the last corrections, as measured, in this step or before
  S last{};       ///< size of the last correction

  /// At the first iteration of a step, the rate measured before counts less with every step.
  /// @param best  contraction that is believed without a measurement in the same step
  void begin(double best) {
    contraction = L::larger(number<S>(best), L::root(contraction) * L::root(L::root(contraction)));
    last = S{};
  }
  /// Where it begins anew within a step.
  void again(const Mask& where) {
    contraction = L::select(where, number<S>(1.0), contraction);
    last = L::select(where, S{}, last);
  }
  /// A correction of this size in iteration n = 1, 2, .. of the arms that are `open`.
  void correct(int n, const S& size, const Mask& open) {
    const S one = number<S>(1.0);
    if (n > 1) contraction = L::select(open, L::select(size < last, size / last, one), contraction);
    last = L::select(open, size, last);
  }
  /// Where corrections do not get smaller.
  Mask stalls(int n) const { return (contraction > kStalls) & L::everywhere(n > 2); }
  /// Size of all corrections that are still to come, were they made: a geometric series.
  S left() const {
    return L::smaller(number<S>(1.0), contraction / L::larger(1.0 - contraction, number<S>(kDivided))) * last;
  }
};

}  // namespace
