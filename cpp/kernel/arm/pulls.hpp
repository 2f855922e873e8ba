// Places of an arm in the world, forces on them, and the generalised forces that follow. For forces that tie several
// parts of an arm: struts, contacts, loops, loads by their state.
#pragma once

#include "arm/joints.hpp"
#include "arm/places.hpp"
#include "arm/state_loads.hpp"

namespace {

/// A force on one place.
template <class Sp>
struct Pull {
  Force<Sp> on_frame;            ///< of the place, in its axes
  typename Sp::Scalar* on_beam;  ///< on the coordinates of the beam that it is a slice of (ne)
};

/// Pose and velocity of a place in the world, in space for planar arms, too.
template <class S>
struct Stand {
  Frame<Space<S>> frame;
  Motion<Space<S>> u;
  static Stand world() {
    const S o{}, one = number<S>(1.0);
    return {{{one, o, o, o, one, o, o, o, one}, {o, o, o}}, Motion<Space<S>>::zero()};
  }
};

template <class Sp>
const Moving<Sp>& moving(const Places<Sp>& places, const Place& place) {
  return (place.on == Place::end ? places.end : places.frame)[place.node];
}

/// How a slice of a place stands. @param height  of the place across the plane
template <class Sp, class S>
Stand<S> stand_of(const Layout& layout, const Moving<Sp>& on, const Slice<Sp>& slice, const S& height) {
  S x[kAsked];
  put_world(layout, on.at * slice.frame, on.in_world(slice.frame.shift(on.u) + slice.rate), height, x);
  return {{{x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10], x[11]}, {x[0], x[1], x[2]}},
          {{x[12], x[13], x[14]}, {x[15], x[16], x[17]}}};
}

/// A force on a slice of a place, in the world's axes.
template <class Sp>
void pull_slice(const Layout& layout, const Places<Sp>& places, const Place& place, const Slice<Sp>& slice,
                const Force<Sp>& world, Pull<Sp>& found) {
  const Moving<Sp>& on = moving(places, place);
  const Force<Sp> F{Sp::unrotate(on.at.R, world.force), Sp::unrotate_angular(on.at.R, world.moment)};
  found.on_frame = slice.frame.shift_back(F);
  if (place.on != Place::slice) return;
  for (int j = 0; j < layout.node[place.node].ne; ++j) found.on_beam[j] = dot(slice.J[j], F);
}

/// Adds `size` times a pull to the forces that bodies need.
template <class C, class Sp>
void add_pull(C& chain, const Place& place, const Pull<Sp>& p, const typename Sp::Scalar& size) {
  State<Sp>& s = chain.state[place.node];
  (C::on_end(chain.layout, place) ? s.tip_force : s.body_force) += size * p.on_frame;
  if (place.on != Place::slice) return;
  for (int j = 0; j < chain.layout.node[place.node].ne; ++j) s.elastic.e[j] += size * p.on_beam[j];
}

/// Adds the generalised forces of a pull to g (nv): inward.
template <class C, class Sp>
void gather_pull(const C& chain, const Place& place, const Pull<Sp>& p, typename Sp::Scalar* g) {
  const Layout& layout = chain.layout;
  Force<Sp> F = p.on_frame;
  const Slice<Sp>* at = C::on_end(layout, place) ? &chain.state[place.node].elastic.end : nullptr;
  for (int i = place.node; i >= 0; i = layout.node[i].parent) {
    const Node& node = layout.node[i];
    if (at) {
      F = at->frame.turn_back(F);
      for (int n = 0; n < node.ne; ++n) g[node.ve + n] += dot(at->J[n], F);
      F = at->frame.shift_back(F);
    } else if (place.on == Place::slice && i == place.node) {
      for (int n = 0; n < node.ne; ++n) g[node.ve + n] += p.on_beam[n];
    }
    if (node.kind != Node::fixed) g[node.v] += node.sign * freedom(node, F);
    F = chain.to_parent(i, F);
    at = node.parent < 0 ? nullptr : chain.seat_of(node).slice;
  }
}

/// y = G^T x, of n columns of G (nv each).
template <class S, class V>
void times_columns(const S* G, int nv, int n, const V* x, V* y) {
  for (int k = 0; k < n; ++k) {
    y[k] = V{};
    for (int i = 0; i < nv; ++i) y[k] += G[k * nv + i] * x[i];
  }
}

}  // namespace
