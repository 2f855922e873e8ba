// Where branches sit: on the end of a node that is not the one before them in the list, or on a slice of its beam. Here
// the branches' forces and inertias are summed up inward, and the motion of that end or slice is kept outward.
#pragma once

#include "arm/state.hpp"

namespace {

/// P: the widest scalar of right-hand sides.
template <class Sp, class P>
struct Fork {
  using S = typename Sp::Scalar;
  static constexpr int kNumbers = (Sp::linear + Sp::angular) * static_cast<int>(sizeof(P) / sizeof(S));
  Slice<Sp> slice;          ///< of a beam, where it is on one,
  typename Sp::Ang w;       ///< its angular velocity, own axes,
  Motion<Sp> a;             ///< and its acceleration
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
