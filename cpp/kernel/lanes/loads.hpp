// Slices of any body, and the loads that act on them.
#pragma once

#include "lanes/quadratic.hpp"

namespace {

using flexarm::lanes::Layout;
using flexarm::lanes::Place;
using flexarm::lanes::PlacedLoad;

/// Numbers P that the body of a node needs to work on.
inline std::size_t scratch_of(const Node& node) { return node.body == Node::quadratic ? quadratic_scratch(node) : 0; }

/// A place that is fixed to a frame, of which `p` are the numbers, as a slice that no coordinate moves.
template <class Sp>
void fixed_slice(const double* p, Slice<Sp>& out) {
  out.x = Sp::read(p);
  out.R = Sp::read_rotation(p);
  out.u_dot = out.u_bias = Sp::zero();
  out.turning = out.turn_bias = Sp::zero_angular();
}

/// A slice of a node's body at elastic coordinates q and rates dq, of which `p` are the numbers: what hangs on an arm
/// (its end, loads, sensors, frames) hangs on one of these.
template <class Sp, class S, class P>
void slice_at(const Node& node, const double* p, const S* q, const S* dq, P* /*scratch*/, Slice<Sp>& out) {
  if (node.ne == 0)
    fixed_slice(p, out);
  else
    move_slice(node, p, q, dq, out);
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

/// Takes the loads on a node off its body's forces, or off those of what its end carries, by the transposed Jacobians
/// of the slices they act on (Eq. 52, 53). After these are set.
/// @param wrench        of all loads
/// @param end_attitude  in the world; of the beam's end
template <class Sp, class S, class P, class State>
void subtract_loads(const Layout& layout, const Node& node, const S* wrench, const typename Sp::Rot& end_attitude,
                    const S* q, const S* dq, State& s, Slice<Sp>& at, P* scratch) {
  using Lin = typename Sp::Lin;
  using Ang = typename Sp::Ang;
  for (int k = 0; k < node.loads; ++k) {
    const PlacedLoad& load = layout.load[node.load[k]];
    const bool carried = load.place.on == Place::end && node.ne > 0;
    Lin f;
    Ang m;
    read_wrench(layout, wrench + 6 * node.load[k], f, m);
    if (load.world) {
      const typename Sp::Rot& attitude = carried ? end_attitude : s.attitude;
      f = Sp::unrotate(attitude, f);
      m = Sp::unrotate_angular(attitude, m);
    }
    const double* p = layout.load_numbers + load.numbers * Lanes<S>::width;
    const auto act = [&](const Lin& force, const Ang& moment) {
      const double* of_slice = p;
      p += load.size * Lanes<S>::width;
      const S weight = next<S>(of_slice);
      if (load.place.on == Place::slice)
        slice_at(node, of_slice, q, dq, scratch, at);
      else
        fixed_slice(of_slice, at);
      const Lin fk = weight * (load.world ? force : Sp::rotate(at.R, force));
      const Ang mk = weight * (load.world ? moment : Sp::rotate_angular(at.R, moment));
      Lin& body_f = carried ? s.tip_f : s.body_f;
      Ang& body_n = carried ? s.tip_n : s.body_n;
      body_f = body_f - fk;
      body_n = body_n - (Sp::moment(at.x, fk) + mk);
      if (load.place.on != Place::slice) return;
      for (int i = 0; i < node.ne; ++i)
        s.elastic.e[i] -= Sp::dot(at.J_linear[i], fk) + Sp::dot(at.J_angular[i], mk);
    };
    if (load.mean) act(f, load.slices == 0 ? m : Sp::zero_angular());
    if (load.mean && is_zero<S>(m)) continue;
    for (int i = 0; i < load.slices; ++i) act(load.mean ? Sp::zero() : f, m);
  }
}

}  // namespace
