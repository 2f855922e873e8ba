// Frames of an arm in motion, and quantities of these alone: poses, Jacobians, velocities and accelerations of
// places, energy and momentum. Always in space, so that nothing is mapped back from a plane.
#pragma once

#include "arm/chain.hpp"
#include "door/frame_kernels.hpp"

namespace {

using flexarm::lanes::Sums;

template <class S>
struct Frames {
  using Sp = Space<S>;
  using C = Chain<Sp, S>;
  using Lin = typename Sp::Lin;
  using Ang = typename Sp::Ang;
  /// A node's frame, or that of its beam's end or another slice.
  struct Moving {
    Frame<Sp> at;  ///< in the world
    Motion<Sp> u;  ///< velocity, own axes
  };

  C chain;
  Moving *frame, *end;  ///< of each node; where there is no beam, they are one
  Moving* fork;         ///< where branches sit on slices
  S *q, *v, *a;

  Frames(const Layout& layout, const double* numbers, Arena& arena) : chain(layout, numbers, arena) {
    arena.take(layout.nodes, frame, end);
    arena.take(layout.forks, fork);
    S* all = nullptr;  // in one row
    arena.take_zeros(layout.nq + 2 * layout.nv, all);
    q = all;
    v = q + layout.nq;
    a = v + layout.nv;
  }
  static std::size_t memory(const Layout& layout) {
    Arena none;
    Frames(layout, nullptr, none);
    return none.bytes();
  }

  /// Moves all frames (Eq. 82, 85) from the coordinates and rates in q and v; with inertias and forces, or without.
  template <bool forces = false>
  void place() {
    chain.template move<true, forces>(q, v);
    const Moving world{{Sp::turn(0, S{}, number<S>(1.0)), Sp::zero()}, Motion<Sp>::zero()};
    Moving before = world;
    for (int i = 0; i < chain.layout.nodes; ++i) {
      const Node& node = chain.layout.node[i];
      const State<Sp>& s = chain.state[i];
      Moving& f = frame[i];
      if (node.branch) before = node.parent < 0 ? world : seat_of(node);
      f = {before.at * s.frame, {Sp::unrotate(s.frame.R, s.frame.shift(before.u).linear), s.w}};
      if (node.kind == Node::prismatic) Sp::component(f.u.linear, node.axis) += node.sign * v[node.v];
      before = f;
      const auto of = [&](const Slice<Sp>& e, const Ang& w) -> Moving {
        return {f.at * e.frame, {Sp::unrotate(e.frame.R, (e.frame.shift(f.u) + e.rate).linear), w}};
      };
      for (int k = 0; k < node.slices; ++k) {
        const auto& at = chain.fork[node.slice[k]];
        fork[node.slice[k]] = of(at.slice, at.w);
      }
      if (node.ne > 0) before = of(s.elastic.end, s.end_w);
      end[i] = before;
    }
  }
  /// Where a node sits, not on the world.
  const Moving& seat_of(const Node& node) const { return chain.slice_under(node) ? fork[node.seat] : end[node.parent]; }

  /// A place: the frame that it belongs to, and in its axes a slice.
  struct Spot {
    const Node& node;
    const State<Sp>& state;
    const Moving& frame;
    Motion<Sp> a;  ///< acceleration of the frame, own axes
    const Slice<Sp>& slice;
    int own;  ///< elastic coordinates that move the slice in the frame
    Frame<Sp> in_world() const { return frame.at * slice.frame; }
  };
  Spot spot(const Place& at, const double* numbers) {
    const Node& node = chain.layout.node[at.node];
    const State<Sp>& s = chain.state[at.node];
    Slice<Sp>& slice = *chain.slice;
    if (at.on == Place::slice && node.body == Node::sampled_beam)
      sampled::sample(Sp{}, node, chain.numbers + node.points, q + node.qe, v + node.ve, chain.scratch);
    if (at.on == Place::slice)
      slice_at(node, numbers, chain.numbers + node.points, q + node.qe, v + node.ve, chain.scratch, slice);
    else
      fixed_slice(numbers, slice);
    if (at.on == Place::end && node.ne > 0) return {node, s, end[at.node], s.end_a, slice, 0};
    return {node, s, frame[at.node], s.a, slice, at.on == Place::slice ? node.ne : 0};
  }

  /// Velocity of a place, world axes (Eq. 85).
  Motion<Sp> velocity(const Spot& at) const {
    return in_world(at.frame, at.slice.frame.shift(at.frame.u) + at.slice.rate);
  }
  /// Acceleration (Eq. 45, 46, 86); after the chain has accelerated with the accelerations in a.
  Motion<Sp> acceleration(const Spot& at) const {
    const Slice<Sp>& s = at.slice;
    Motion<Sp> sum = s.frame.shift(at.a) + C::convective(s, at.frame.u.angular) + s.bias;
    const S* ddq = a + at.node.ve;
    for (int k = 0; k < at.own; ++k) sum += ddq[k] * s.J[k];
    return in_world(at.frame, sum);
  }
  static Motion<Sp> in_world(const Moving& frame, const Motion<Sp>& m) {
    return {Sp::rotate(frame.at.R, m.linear), Sp::rotate(frame.at.R, m.angular)};
  }

  /// visit(rate, motion) for each rate that moves a place: columns of its Jacobian (Eq. 91: Phi H), world axes.
  template <class Visit>
  void jacobian(const Place& place, const double* numbers, const Visit& visit) {
    const Spot at = spot(place, numbers);
    const Lin p = at.in_world().r;
    const Slice<Sp>* slice = nullptr;  // of this node, that the way goes over, and how far it is to the place
    Lin arm = Sp::zero();
    if (place.on == Place::slice) {
      slice = &at.slice;
    } else if (place.on == Place::end) {
      slice = &chain.state[place.node].elastic.end;
      arm = p - end[place.node].at.r;
    }
    for (int i = place.node; i >= 0; i = chain.layout.node[i].parent) {
      const Node& node = chain.layout.node[i];
      const Frame<Sp>& own = frame[i].at;
      if (node.kind != Node::fixed) {
        const Lin h = Sp::rotate(own.R, number<S>(node.sign) * Sp::unit(node.axis));
        if (node.kind == Node::revolute)
          visit(node.v, Motion<Sp>{Sp::cross(h, p - own.r), h});
        else
          visit(node.v, Motion<Sp>{h, Sp::zero()});
      }
      for (int k = 0; k < node.ne && slice; ++k) {
        const Ang turn = Sp::rotate(own.R, slice->J[k].angular);
        visit(node.ve + k, Motion<Sp>{Sp::rotate(own.R, slice->J[k].linear) + Sp::cross(turn, arm), turn});
      }
      if (node.parent < 0) return;
      slice = chain.seat_of(node).slice;
      arm = p - seat_of(node).at.r;
    }
  }

  /// Of the whole arm; after `place<true>`.
  struct Whole {
    S twice_kinetic, mass;
    Lin moment;  ///< first moment about the world's origin
    Lin linear;  ///< momentum
    Ang angular;
  };
  Whole whole() const {
    Whole sum{chain.twice_kinetic(v), S{}, Sp::zero(), Sp::zero(), Sp::zero()};
    const auto add = [&](const Moving& f, const typename Sp::Rigid& body, const Force<Sp>& momentum) {
      const Force<Sp> world = f.at.to_parent(momentum);
      sum.mass += body.m;
      sum.moment += body.m * f.at.r + Sp::rotate(f.at.R, body.c);
      sum.linear += world.force;
      sum.angular += world.moment;
    };
    for (int i = 0; i < chain.layout.nodes; ++i) {
      const Node& node = chain.layout.node[i];
      const State<Sp>& s = chain.state[i];
      if (!node.body) continue;
      Force<Sp> momentum = s.body * frame[i].u;  // the rigid rows of Eq. 80
      for (int k = 0; k < node.ne; ++k) momentum += v[node.ve + k] * s.elastic.M_er[k];
      add(frame[i], s.body, momentum);
      if (node.body == Node::cut)
        sum.moment += Sp::rotate(frame[i].at.R, s.elastic.left_out);  // there gravity acts, too
      if (node.tip) add(end[i], s.tip, s.tip * end[i].u);
    }
    return sum;
  }
};

}  // namespace
