// Slices of any body, and the loads that act on them.
#pragma once

#include "lanes/cut.hpp"
#include "lanes/quadratic.hpp"
#include "lanes/sampled.hpp"

namespace {

using flexarm::lanes::Layout;
using flexarm::lanes::Place;
using flexarm::lanes::PlacedLoad;

/// Numbers P that the body of a node needs to work on.
inline std::size_t scratch_of(const Node& node) {
  return node.body == Node::sampled     ? sampled_scratch(node)
         : node.body == Node::quadratic ? quadratic_scratch(node)
                                        : 0;
}

/// A place that is fixed to a frame, of which `p` are the numbers, as a slice that no coordinate moves.
template <class Sp>
void fixed_slice(const double* p, Slice<Sp>& out) {
  out.x = Sp::read(p);
  out.R = Sp::read_rotation(p);
  out.u_dot = out.u_bias = Sp::zero();
  out.turning = out.turn_bias = Sp::zero_angular();
}

/// A slice of a node's body at elastic coordinates q and rates dq, of which `p` are the numbers, by those of the body's
/// points: what hangs on an arm (its end, loads, sensors, frames) hangs on one of these. A sampled body has been
/// sampled into `scratch`. Without `rates`, what tells of its velocity may be left as it is.
template <bool rates = true, class Sp, class S, class P>
void slice_at(const Node& node, const double* p, const double* points, const S* q, const S* dq, P* scratch,
              Slice<Sp>& out) {
  if (node.ne == 0)
    fixed_slice(p, out);
  else if (node.body == Node::sampled)
    sampled::move_slice(node, p, points, q, dq, scratch, out);
  else
    move_slice<rates>(node, p, q, dq, out);
}

template <class S>
void read_wrench(const Layout&, const S* w, typename Space<S>::Lin& f, typename Space<S>::Ang& m) {
  f = {w[0], w[1], w[2]};
  m = {w[3], w[4], w[5]};
}
/// In the plane, what acts across it does no work.
template <class S>
void read_wrench(const Layout& layout, const S* w, typename Plane<S>::Lin& f, typename Plane<S>::Ang& m) {
  f = {w[layout.along[0]], w[layout.along[1]]};
  m = {layout.turning * w[3 + layout.about]};
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

/// A force and moment about a body's origin, and elastic forces.
template <class Sp>
struct Forces {
  typename Sp::Lin& f;
  typename Sp::Ang& n;
  typename Sp::Scalar* e;

  /// Adds those of a force and moment on a slice, by its transposed Jacobian (Eq. 52, 53).
  void add(const Slice<Sp>& at, int ne, const typename Sp::Lin& force, const typename Sp::Ang& moment) {
    f += force;
    n += Sp::moment(at.x, force) + moment;
    for (int i = 0; i < ne; ++i) e[i] += Sp::dot(at.J_linear[i], force) + Sp::dot(at.J_angular[i], moment);
  }
};

template <class Sp, class P>
typename SpaceOf<Sp, P>::type::Lin widen_linear(const typename Sp::Lin& x) {
  if constexpr (Sp::planar)
    return {widen(x.x, P{}), widen(x.y, P{})};
  else
    return {widen(x.x, P{}), widen(x.y, P{}), widen(x.z, P{})};
}
template <class Sp, class P>
typename SpaceOf<Sp, P>::type::Ang widen_angular(const typename Sp::Ang& x) {
  if constexpr (Sp::planar)
    return {widen(x.z, P{})};
  else
    return widen_linear<Sp, P>(x);
}

template <class Sp, class P>
typename SpaceOf<Sp, P>::type::Rot widen_rotation(const typename Sp::Rot& R) {
  if constexpr (Sp::planar)
    return {widen(R.c, P{}), widen(R.s, P{})};
  else
    return {widen(R.xx, P{}), widen(R.xy, P{}), widen(R.xz, P{}), widen(R.yx, P{}), widen(R.yy, P{}),
            widen(R.yz, P{}), widen(R.zx, P{}), widen(R.zy, P{}), widen(R.zz, P{})};
}

/// Takes a load on one arm off a body's forces, as many slices at a time as a pack has lanes.
/// @param p     numbers of the first
/// @param f, m  force and moment, of the world turned into the node's axes; or in those of the slices
template <class Sp, class S, class P>
void take_groups(const Node& node, const PlacedLoad& load, const double* p, const typename Sp::Lin& f,
                 const typename Sp::Ang& m, const S* q, P* scratch, const Forces<Sp>& body) {
  using Pt = typename SpaceOf<Sp, P>::type;
  constexpr int W = Lanes<P>::width / Lanes<S>::width;
  const int ne = node.ne, n = Pt::linear + Pt::angular + ne, square = (n + W - 1) / W * W;  // what sum_lanes likes
  P *all = scratch, *qp = all + square;
  Slice<Pt> at;
  at.J_linear = reinterpret_cast<typename Pt::Lin*>(qp + ne);
  at.J_angular = reinterpret_cast<typename Pt::Ang*>(at.J_linear + ne);
  for (int i = 0; i < ne; ++i) qp[i] = widen(q[i], P{});
  const typename Pt::Lin fp = widen_linear<Sp, P>(f);
  const typename Pt::Ang mp = widen_angular<Sp, P>(m);
  for (int i = 0; i < square; ++i) all[i] = P{};
  typename Pt::Lin f_sum = Pt::zero();
  typename Pt::Ang n_sum = Pt::zero_angular();
  Forces<Pt> sum{f_sum, n_sum, all + Pt::linear + Pt::angular};
  for (int i = 0; i < load.slices; ++i) {
    const double* of_slice = p + static_cast<std::size_t>(i) * load.size * Lanes<P>::width;
    const P weight = next<P>(of_slice);
    move_slice<false>(node, of_slice, qp, qp, at);
    sum.add(at, ne, weight * (load.world ? fp : Pt::rotate(at.R, fp)),
            weight * (load.world ? mp : Pt::rotate_angular(at.R, mp)));
  }
  __builtin_memcpy(all, &f_sum, sizeof(f_sum));
  __builtin_memcpy(all + Pt::linear, &n_sum, sizeof(n_sum));
  S* total = reinterpret_cast<S*>(all);
  sum_lanes(all, square, total);
  typename Sp::Lin force;
  typename Sp::Ang moment;
  __builtin_memcpy(&force, total, sizeof(force));
  __builtin_memcpy(&moment, total + Sp::linear, sizeof(moment));
  body.f = body.f - force;
  body.n = body.n - moment;
  for (int i = 0; i < ne; ++i) body.e[i] -= total[Sp::linear + Sp::angular + i];
}

/// Takes the loads on a node off its body's forces, or off those of what its end carries; after these are set.
/// @param wrench        of all loads
/// @param end_attitude  in the world; of the beam's end
/// @param points        numbers of the node's points
template <class Sp, class S, class P, class State>
void subtract_loads(const Layout& layout, const Node& node, const S* wrench, const typename Sp::Rot& end_attitude,
                    const double* points, const S* q, const S* dq, State& s, Slice<Sp>& at, P* scratch) {
  using Lin = typename Sp::Lin;
  using Ang = typename Sp::Ang;
  Forces<Sp> own{s.body_f, s.body_n, s.elastic.e}, carried{s.tip_f, s.tip_n, nullptr};
  for (int k = 0; k < node.loads; ++k) {
    const PlacedLoad& load = layout.load[node.load[k]];
    const bool on_end = load.place.on == Place::end && node.ne > 0;
    Lin f;
    Ang m;
    read_wrench(layout, wrench + 6 * node.load[k], f, m);
    if (load.world) {
      const typename Sp::Rot& attitude = on_end ? end_attitude : s.attitude;
      f = Sp::unrotate(attitude, f);
      m = Sp::unrotate_angular(attitude, m);
    }
    const double* p = layout.load_numbers + load.numbers * Lanes<S>::width;
    const auto act = [&](const Lin& force, const Ang& moment) {  // on the slice whose numbers are next
      const double* of_slice = p;
      p += load.size * Lanes<S>::width;
      const S weight = -next<S>(of_slice);
      const bool moves = load.place.on == Place::slice;
      if (moves)
        slice_at<false>(node, of_slice, points, q, dq, scratch, at);
      else
        fixed_slice(of_slice, at);
      (on_end ? carried : own)
          .add(at, moves ? node.ne : 0, weight * (load.world ? force : Sp::rotate(at.R, force)),
               weight * (load.world ? moment : Sp::rotate_angular(at.R, moment)));
    };
    if (load.mean) act(f, load.slices == 0 ? m : Sp::zero_angular());
    if (load.slices == 0 || (load.mean && is_zero<S>(m))) continue;
    const Lin rest = load.mean ? Sp::zero() : f;
    if constexpr (sizeof(P) != sizeof(S))
      if (flexarm::lanes::slices_in_groups(node)) {
        take_groups(node, load, p, rest, m, q, scratch, own);
        continue;
      }
    for (int i = 0; i < load.slices; ++i) act(rest, m);
  }
}

}  // namespace
