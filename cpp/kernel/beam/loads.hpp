// Slices of any body, and the loads that act on them.
#pragma once

#include "beam/cut.hpp"
#include "beam/quadratic.hpp"
#include "beam/sampled.hpp"

namespace {

using flexarm::lanes::Layout;
using flexarm::lanes::Place;
using flexarm::lanes::PlacedLoad;

/// Numbers P that the body of a node needs to work on.
inline std::size_t scratch_of(const Node& node) {
  return node.body == Node::sampled_beam     ? sampled_scratch(node)
         : node.body == Node::quadratic_beam ? quadratic_scratch(node)
                                             : 0;
}

/// A place that is fixed to a frame, of which `p` are the numbers, as a slice that no coordinate moves.
template <class Sp>
void fixed_slice(const double* p, Slice<Sp>& out) {
  const auto [r, R] = read<records::Seat<Sp>>(p);
  out.frame = {R, r};
  out.rate = out.bias = Motion<Sp>::zero();
}

/// A slice of a node's body at elastic coordinates q and rates dq, of which `p` are the numbers, by those of the body's
/// points: the arm's end, loads, sensors and frames each belong to one. A sampled body has been
/// sampled into `scratch`. Without `rates`, its rate and bias may be left unset.
template <bool rates = true, class Sp, class S, class P>
void slice_at(const Node& node, const double* p, const double* points, const S* q, const S* dq, P* scratch,
              Slice<Sp>& out) {
  if (node.ne == 0)
    fixed_slice(p, out);
  else if (node.body == Node::sampled_beam)
    sampled::move_slice(node, p, points, q, dq, scratch, out);
  else
    move_slice<rates>(node, p, q, dq, out);
}

template <class S>
Force<Space<S>> read_wrench(Space<S>, const Layout&, const S* w) {
  return {{w[0], w[1], w[2]}, {w[3], w[4], w[5]}};
}
/// In the plane: a force across it does no work.
template <class S>
Force<Plane<S>> read_wrench(Plane<S>, const Layout& layout, const S* w) {
  return {{w[layout.along[0]], w[layout.along[1]]}, {layout.turning * w[3 + layout.about]}};
}

template <class S>
bool is_zero(const typename Space<S>::Lin& x) {
  using L = Lanes<S>;
  return L::all(L::size(x.x) + L::size(x.y) + L::size(x.z) < 1e-300);
}
template <class S>
bool is_zero(const typename Plane<S>::Ang& x) {
  return Lanes<S>::all(Lanes<S>::size(x.z) < 1e-300);
}

/// The same space for other numbers.
template <class Sp, class P>
struct SpaceOf;
template <class S, class P>
struct SpaceOf<Space<S>, P> {
  using type = Space<P>;
};
template <class S, class P>
struct SpaceOf<Plane<S>, P> {
  using type = Plane<P>;
};

/// Vectors of one arm as those of packs, the same in all lanes.
template <class V, class S>
typename Space<V>::Lin wide_vector(Space<S>, const typename Space<S>::Lin& x) {
  return {widen(x.x, V{}), widen(x.y, V{}), widen(x.z, V{})};
}
template <class V, class S>
typename Plane<V>::Lin wide_vector(Plane<S>, const typename Plane<S>::Lin& x) {
  return {widen(x.x, V{}), widen(x.y, V{})};
}
template <class V, class S>
typename Plane<V>::Ang wide_vector(Plane<S>, const typename Plane<S>::Ang& x) {
  return {widen(x.z, V{})};
}
template <class V, class Sp>
Motion<typename SpaceOf<Sp, V>::type> wide(const Motion<Sp>& m) {
  return {wide_vector<V>(Sp{}, m.linear), wide_vector<V>(Sp{}, m.angular)};
}
template <class V, class Sp>
Force<typename SpaceOf<Sp, V>::type> wide(const Force<Sp>& f) {
  return {wide_vector<V>(Sp{}, f.force), wide_vector<V>(Sp{}, f.moment)};
}
template <class V, class S>
Frame<Space<V>> wide(const Frame<Space<S>>& frame) {
  const auto& R = frame.R;
  const auto w = [](const S& x) { return widen(x, V{}); };
  return {{w(R.xx), w(R.xy), w(R.xz), w(R.yx), w(R.yy), w(R.yz), w(R.zx), w(R.zy), w(R.zz)},
          wide_vector<V>(Space<S>{}, frame.r)};
}
template <class V, class S>
Frame<Plane<V>> wide(const Frame<Plane<S>>& frame) {
  return {{widen(frame.R.c, V{}), widen(frame.R.s, V{})}, wide_vector<V>(Plane<S>{}, frame.r)};
}

/// The forces of a body: about its origin, and on its elastic coordinates.
template <class Sp>
struct BodyForces {
  Force<Sp>& body;
  typename Sp::Scalar* e;

  /// Adds those of a force and moment on a slice, by its transposed Jacobian (Eq. 52, 53).
  void add(const Slice<Sp>& at, int ne, const Force<Sp>& load) {
    body += at.frame.shift_back(load);
    for (int i = 0; i < ne; ++i) e[i] += dot(at.J[i], load);
  }
};

/// Takes a load on one arm off a body's forces, as many slices at a time as a pack has lanes.
/// @param p     numbers of the first
/// @param force  of the world turned into the node's axes; or in those of the slices
template <class Sp, class S, class P>
void take_groups(const Node& node, const PlacedLoad& load, const double* p, const Force<Sp>& force, const S* q,
                 P* scratch, const BodyForces<Sp>& body) {
  using Pt = typename SpaceOf<Sp, P>::type;
  constexpr int W = Lanes<P>::width / Lanes<S>::width;
  const int ne = node.ne, n = Pt::linear + Pt::angular + ne, square = (n + W - 1) / W * W;  // in whole packs
  P *all = scratch, *qp = all + square;
  Slice<Pt> at;
  at.J = view<Motion<Pt>>(qp + ne);
  for (int i = 0; i < ne; ++i) qp[i] = widen(q[i], P{});
  const Force<Pt> wide_force = wide<P>(force);
  for (int i = 0; i < square; ++i) all[i] = P{};
  Force<Pt> body_sum = Force<Pt>::zero();
  BodyForces<Pt> sum{body_sum, all + Pt::linear + Pt::angular};
  for (int i = 0; i < load.slices; ++i) {
    const double* of_slice = p + static_cast<std::size_t>(i) * load.size * Lanes<P>::width;
    const P weight = next<P>(of_slice);
    move_slice<false>(node, of_slice, qp, qp, at);
    sum.add(at, ne, weight * (load.world ? wide_force : at.frame.turn_back(wide_force)));
  }
  *view<Force<Pt>>(all) = body_sum;
  S* total = view<S>(all);
  sum_lanes(all, square, total);
  body.body = body.body - *view<Force<Sp>>(total);
  for (int i = 0; i < ne; ++i) body.e[i] -= total[Sp::linear + Sp::angular + i];
}

/// Takes the loads on a node off its body's forces, or off those of the body on its end; after these are set.
/// @param wrenches      of all loads
/// @param end_attitude  in the world; of the beam's end
/// @param points        numbers of the node's points
template <class Sp, class S, class P, class State>
void subtract_loads(const Layout& layout, const Node& node, const S* wrenches, const typename Sp::Rot& end_attitude,
                    const double* points, const S* q, const S* dq, State& s, Slice<Sp>& at, P* scratch) {
  BodyForces<Sp> own{s.body_force, s.elastic.e}, carried{s.tip_force, nullptr};
  for (int k = 0; k < node.loads; ++k) {
    const PlacedLoad& load = layout.load[node.load[k]];
    const bool on_end = load.place.on == Place::end && node.ne > 0;
    Force<Sp> wrench = read_wrench(Sp{}, layout, wrenches + 6 * node.load[k]);
    if (load.world) {
      const typename Sp::Rot& attitude = on_end ? end_attitude : s.attitude;
      wrench = {Sp::unrotate(attitude, wrench.force), Sp::unrotate_angular(attitude, wrench.moment)};
    }
    const double* p = layout.place_numbers + load.numbers * Lanes<S>::width;
    const auto act = [&](const Force<Sp>& force) {  // on the slice whose numbers are next
      const double* of_slice = p;
      p += load.size * Lanes<S>::width;
      const S weight = -next<S>(of_slice);
      const bool moves = load.place.on == Place::slice;
      if (moves)
        slice_at<false>(node, of_slice, points, q, dq, scratch, at);
      else
        fixed_slice(of_slice, at);
      (on_end ? carried : own).add(at, moves ? node.ne : 0, weight * (load.world ? force : at.frame.turn_back(force)));
    };
    if (load.mean) act({wrench.force, load.slices == 0 ? wrench.moment : Sp::zero_angular()});
    if (load.slices == 0 || (load.mean && is_zero<S>(wrench.moment))) continue;
    const Force<Sp> rest{load.mean ? Sp::zero() : wrench.force, wrench.moment};
    if constexpr (sizeof(P) != sizeof(S))
      if (flexarm::lanes::slices_in_groups(node)) {
        take_groups(node, load, p, rest, q, scratch, own);
        continue;
      }
    for (int i = 0; i < load.slices; ++i) act(rest);
  }
}

}  // namespace
