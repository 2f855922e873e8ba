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
  C chain;
  Places<Sp> places;
  S *q, *v, *a;

  Frames(const Layout& layout, const double* numbers, Arena& arena) : chain(layout, numbers, arena) {
    places.lay_out(layout, arena);
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
    places.find(chain, v);
  }

  /// A place: the frame that it belongs to, and in its axes a slice.
  struct Spot {
    const Node& node;
    const State<Sp>& state;
    const Moving<Sp>& frame;
    Motion<Sp> a;  ///< acceleration of the frame, own axes
    const Slice<Sp>& slice;
    int own;  ///< elastic coordinates that move the slice in the frame
    Frame<Sp> in_world() const { return frame.at * slice.frame; }
  };
  Spot spot(const Place& at, const double* numbers) {
    const Node& node = chain.layout.node[at.node];
    const State<Sp>& s = chain.state[at.node];
    const Slice<Sp>& slice = chain.slice_of(at, numbers, q, v);
    if (at.on == Place::end && node.ne > 0) return {node, s, places.end[at.node], s.end_a, slice, 0};
    return {node, s, places.frame[at.node], s.a, slice, at.on == Place::slice ? node.ne : 0};
  }

  /// Velocity of a place, world axes (Eq. 85).
  Motion<Sp> velocity(const Spot& at) const {
    return at.frame.in_world(at.slice.frame.shift(at.frame.u) + at.slice.rate);
  }
  /// Acceleration (Eq. 45, 46, 86); after the chain has accelerated with the accelerations in a.
  Motion<Sp> acceleration(const Spot& at) const {
    const Slice<Sp>& s = at.slice;
    Motion<Sp> sum = s.frame.shift(at.a) + C::convective(s, at.frame.u.angular) + s.bias;
    const S* ddq = a + at.node.ve;
    for (int k = 0; k < at.own; ++k) sum += ddq[k] * s.J[k];
    return at.frame.in_world(sum);
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
      arm = p - places.end[place.node].at.r;
    }
    for (int i = place.node; i >= 0; i = chain.layout.node[i].parent) {
      const Node& node = chain.layout.node[i];
      const Frame<Sp>& own = places.frame[i].at;
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
      arm = p - places.seat_of(chain.layout, node).at.r;
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
    const auto add = [&](const Moving<Sp>& f, const typename Sp::Rigid& body, const Force<Sp>& momentum) {
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
      Force<Sp> momentum = s.body * places.frame[i].u;  // the rigid rows of Eq. 80
      for (int k = 0; k < node.ne; ++k) momentum += v[node.ve + k] * s.elastic.M_er[k];
      add(places.frame[i], s.body, momentum);
      if (node.body == Node::cut)
        sum.moment += Sp::rotate(places.frame[i].at.R, s.elastic.left_out);  // there gravity acts, too
      if (node.tip) add(places.end[i], s.tip, s.tip * places.end[i].u);
    }
    return sum;
  }
};

}  // namespace
