// Nodes with a child that does not stand right behind them in the list: here the branches' forces and inertias are
// summed up inward, and the motion of the node's end is kept outward.
#pragma once

#include "arm/state.hpp"

namespace {

/// P: the widest scalar of right-hand sides.
template <class Sp, class P>
struct Fork {
  using S = typename Sp::Scalar;
  static constexpr int kNumbers = (Sp::linear + Sp::angular) * static_cast<int>(sizeof(P) / sizeof(S));
  typename Sp::Inertia M;   ///< articulated inertia
  typename Sp::Rigid body;  ///< composite inertia
  alignas(P) S force_numbers[kNumbers];
  alignas(P) S motion_numbers[kNumbers];

  /// Of right-hand sides in the scalars of Sv.
  template <class Sv>
  Force<Sv>& force() {
    return *view<Force<Sv>>(force_numbers);
  }
  template <class Sv>
  Motion<Sv>& motion() {
    return *view<Motion<Sv>>(motion_numbers);
  }
  /// Adds one inertia to another, number by number.
  template <class Any>
  static void add(Any& sum, const Any& other) {
    S* a = view<S>(&sum);
    const S* b = view<const S>(&other);
    for (std::size_t k = 0; k < sizeof(Any) / sizeof(S); ++k) a[k] += b[k];
  }
  void add_inertia_to(typename Sp::Inertia& sum) const { add(sum, M); }
  /// The sums, before an inward recursion.
  void clear() {
    M = Sp::no_inertia();
    body = Sp::no_body();
    for (S& x : force_numbers) x = S{};
  }
};

}  // namespace
