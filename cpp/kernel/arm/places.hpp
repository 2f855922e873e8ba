// Where the frames of an arm are in the world, and how they move: after the outward pass, for what asks for it.
#pragma once

#include "arm/state.hpp"
#include "wide/arena.hpp"

namespace {

/// A node's frame, or that of its beam's end.
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

  void lay_out(int nodes, Arena& arena) { arena.take(nodes, frame, end); }
  /// All frames (Eq. 82, 85), of nodes that have moved at rates v.
  void find(const flexarm::lanes::Layout& layout, const State<Sp>* state, const S* v) {
    Moving<Sp> before = Moving<Sp>::world();
    for (int i = 0; i < layout.nodes; ++i) {
      const Node& node = layout.node[i];
      const State<Sp>& s = state[i];
      Moving<Sp>& f = frame[i];
      if (node.branch) before = node.parent < 0 ? Moving<Sp>::world() : end[node.parent];
      f = {before.at * s.frame, {Sp::unrotate(s.frame.R, s.frame.shift(before.u).linear), s.w}};
      if (node.kind == Node::prismatic) Sp::component(f.u.linear, node.axis) += node.sign * v[node.v];
      before = f;
      if (node.ne > 0) {
        const Slice<Sp>& e = s.elastic.end;
        before = {f.at * e.frame, {Sp::unrotate(e.frame.R, (e.frame.shift(f.u) + e.rate).linear), s.end_w}};
      }
      end[i] = before;
    }
  }
};

}  // namespace
