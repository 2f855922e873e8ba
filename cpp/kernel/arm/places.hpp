// Where the frames of an arm are in the world, and how they move: after the outward pass, where these are asked for.
#pragma once

#include "arm/state.hpp"
#include "wide/arena.hpp"

namespace {

/// A node's frame, or that of its beam's end or another slice.
template <class Sp>
struct Moving {
  Frame<Sp> at;  ///< in the world
  Motion<Sp> u;  ///< velocity, own axes

  static Moving world() {
    using S = typename Sp::Scalar;
    return {{Sp::turn(0, S{}, number<S>(1.0)), Sp::zero()}, Motion<Sp>::zero()};
  }
  Motion<Sp> in_world(const Motion<Sp>& m) const {
    return {Sp::rotate(at.R, m.linear), Sp::rotate_angular(at.R, m.angular)};
  }
};

template <class Sp>
struct Places {
  using S = typename Sp::Scalar;
  Moving<Sp>*frame, *end;  ///< of each node; where there is no beam, they are one
  Moving<Sp>* fork;        ///< where branches sit on slices

  void lay_out(const flexarm::lanes::Layout& layout, Arena& arena) {
    arena.take(layout.nodes, frame, end);
    arena.take(layout.forks, fork);
  }
  /// All frames (Eq. 82, 85), of a chain that has moved at rates v.
  template <class C>
  void find(const C& chain, const S* v) {
    Moving<Sp> before = Moving<Sp>::world();
    for (int i = 0; i < chain.layout.nodes; ++i) {
      const Node& node = chain.layout.node[i];
      const State<Sp>& s = chain.state[i];
      Moving<Sp>& f = frame[i];
      if (node.branch) before = node.parent < 0 ? Moving<Sp>::world() : seat_of(chain.layout, node);
      f = {before.at * s.frame, {Sp::unrotate(s.frame.R, s.frame.shift(before.u).linear), s.w}};
      if (node.kind == Node::prismatic) Sp::component(f.u.linear, node.axis) += node.sign * v[node.v];
      before = f;
      for (int k = 0; k < node.slices; ++k) {
        const auto& at = chain.fork[node.slice[k]];
        fork[node.slice[k]] = carried(f, at.slice, at.w);
      }
      if (node.ne > 0) before = carried(f, s.elastic.end, s.end_w);
      end[i] = before;
    }
  }
  /// Where a node sits, not on the world.
  const Moving<Sp>& seat_of(const flexarm::lanes::Layout& layout, const Node& node) const {
    return layout.on_slice(node) ? fork[node.seat] : end[node.parent];
  }

 private:
  static Moving<Sp> carried(const Moving<Sp>& f, const Slice<Sp>& at, const typename Sp::Ang& w) {
    return {f.at * at.frame, {Sp::unrotate(at.frame.R, (at.frame.shift(f.u) + at.rate).linear), w}};
  }
};

}  // namespace
