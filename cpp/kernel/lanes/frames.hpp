// Frames of an arm in motion, and what follows from these alone: poses, Jacobians, velocities and accelerations of
// places, energy and momentum. Always in space, so that nothing is mapped back from a plane.
#pragma once

#include "lanes/chain.hpp"
#include "lanes/frame_kernels.hpp"

namespace {

using flexarm::lanes::Sums;

template <class S>
struct Frames {
  using Sp = Space<S>;
  using C = Chain<Sp, S>;
  using Lin = typename Sp::Lin;
  using Ang = typename Sp::Ang;
  using Rot = typename Sp::Rot;
  /// A node's frame, or that of its beam's end.
  struct Frame {
    Rot R;  ///< in the world
    Lin p;  ///< and its place
    Lin u;  ///< velocity, own axes
  };

  C chain;
  Frame *frame, *end;  ///< of each node; where there is no beam, they are one
  S *q, *v, *a;

  Frames(const Layout& layout, const double* numbers, Room& room) : chain(layout, numbers, room) {
    room.take(layout.nodes, frame, end);
    S* all = nullptr;  // in one row
    room.take_zeros(layout.nq + 2 * layout.nv, all);
    q = all;
    v = q + layout.nq;
    a = v + layout.nv;
  }
  static std::size_t memory(const Layout& layout) {
    Room none;
    Frames(layout, nullptr, none);
    return none.bytes();
  }

  /// Moves all frames (Eq. 82, 85) from the coordinates and rates in q and v; with inertias and forces, or without.
  template <bool forces = false>
  void place() {
    chain.template move<true, forces>(q, v);
    const S one = number<S>(1.0), o{};
    Frame before{{one, o, o, o, one, o, o, o, one}, Sp::zero(), Sp::zero()};
    Ang w = Sp::zero_angular();
    for (int i = 0; i < chain.layout.nodes; ++i) {
      const Node& node = chain.layout.node[i];
      const State<Sp>& s = chain.state[i];
      Frame& f = frame[i];
      f.R = Sp::times(before.R, s.R);
      f.p = before.p + Sp::rotate(before.R, s.r);
      f.u = Sp::unrotate(s.R, before.u + Sp::cross(w, s.r));
      if (node.kind == Node::prismatic) Sp::component(f.u, node.axis) += node.sign * v[node.v];
      before = f;
      w = s.w;
      if (node.ne > 0) {
        const Slice<Sp>& e = s.elastic.end;
        before.R = Sp::times(f.R, e.R);
        before.p = f.p + Sp::rotate(f.R, e.x);
        before.u = Sp::unrotate(e.R, f.u + Sp::cross(s.w, e.x) + e.u_dot);
        w = s.end_w;
      }
      end[i] = before;
    }
  }

  /// A place: the frame that it belongs to, and in its axes a slice.
  struct Spot {
    const Node& node;
    const State<Sp>& state;
    const Frame& frame;
    Ang w, dw;
    Lin a;
    const Slice<Sp>& slice;
    int own;  ///< elastic coordinates that move the slice in the frame
    Lin p() const { return frame.p + Sp::rotate(frame.R, slice.x); }
  };
  Spot spot(const Place& at, const double* numbers) {
    const Node& node = chain.layout.node[at.node];
    const State<Sp>& s = chain.state[at.node];
    Slice<Sp>& slice = *chain.slice;
    if (at.on == Place::slice && node.body == Node::sampled)
      sampled::sample<false>(Sp{}, node, chain.numbers + node.points, q + node.qe, v + node.ve, chain.scratch);
    if (at.on == Place::slice)
      slice_at(node, numbers, chain.numbers + node.points, q + node.qe, v + node.ve, chain.scratch, slice);
    else
      fixed_slice(numbers, slice);
    if (at.on == Place::end && node.ne > 0) return {node, s, end[at.node], s.end_w, s.end_dw, s.end_a, slice, 0};
    return {node, s, frame[at.node], s.w, s.dw, s.a, slice, at.on == Place::slice ? node.ne : 0};
  }

  /// Velocity [linear; angular] of a place, world axes (Eq. 85).
  void velocity(const Spot& at, Lin& linear, Ang& angular) const {
    linear = Sp::rotate(at.frame.R, at.frame.u + Sp::cross(at.w, at.slice.x) + at.slice.u_dot);
    angular = Sp::rotate(at.frame.R, at.w + at.slice.turning);
  }
  /// Acceleration (Eq. 45, 46, 86); after the chain has accelerated with the accelerations in a.
  void acceleration(const Spot& at, Lin& linear, Ang& angular) const {
    const Slice<Sp>& s = at.slice;
    const Lin sweep = Sp::cross(at.w, s.x) + number<S>(2.0) * s.u_dot;
    linear = at.a + Sp::cross(at.dw, s.x) + Sp::cross(at.w, sweep) + s.u_bias;
    angular = at.dw + Sp::cross(at.w, s.turning) + s.turn_bias;
    const S* ddq = a + at.node.ve;
    for (int k = 0; k < at.own; ++k) {
      linear += ddq[k] * s.J_linear[k];
      angular += ddq[k] * s.J_angular[k];
    }
    linear = Sp::rotate(at.frame.R, linear);
    angular = Sp::rotate(at.frame.R, angular);
  }

  /// visit(rate, linear, angular) for each rate that moves a place: columns of its Jacobian (Eq. 91: Phi H), world
  /// axes.
  template <class Visit>
  void jacobian(const Place& place, const double* numbers, const Visit& visit) {
    const Spot at = spot(place, numbers);
    const Lin p = at.p();
    for (int i = 0; i <= place.node; ++i) {
      const Node& node = chain.layout.node[i];
      if (node.kind != Node::fixed) {
        const Lin h = Sp::rotate(frame[i].R, number<S>(node.sign) * Sp::unit(node.axis));
        if (node.kind == Node::revolute)
          visit(node.v, Sp::cross(h, p - frame[i].p), h);
        else
          visit(node.v, h, Sp::zero());
      }
      const bool here = i == place.node;
      if (here && place.on == Place::frame) break;
      const Slice<Sp>& s = here && place.on == Place::slice ? at.slice : chain.state[i].elastic.end;
      const Lin arm = here && place.on == Place::slice ? Sp::zero() : p - end[i].p;
      for (int k = 0; k < node.ne; ++k) {
        const Ang turn = Sp::rotate(frame[i].R, s.J_angular[k]);
        visit(node.ve + k, Sp::rotate(frame[i].R, s.J_linear[k]) + Sp::cross(turn, arm), turn);
      }
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
    const auto add = [&](const Frame& f, const typename Sp::Rigid& body, Lin linear, Ang angular) {
      const Lin world = Sp::rotate(f.R, linear);
      sum.mass += body.m;
      sum.moment += body.m * f.p + Sp::rotate(f.R, body.c);
      sum.linear += world;
      sum.angular += Sp::rotate(f.R, angular) + Sp::cross(f.p, world);
    };
    for (int i = 0; i < chain.layout.nodes; ++i) {
      const Node& node = chain.layout.node[i];
      const State<Sp>& s = chain.state[i];
      if (!node.body) continue;
      Lin linear = Sp::force(s.body, frame[i].u, s.w);  // momenta: the rigid rows of Eq. 80
      Ang angular = Sp::torque(s.body, frame[i].u, s.w);
      for (int k = 0; k < node.ne; ++k) {
        linear += v[node.ve + k] * s.elastic.M_linear[k];
        angular += v[node.ve + k] * s.elastic.M_angular[k];
      }
      add(frame[i], s.body, linear, angular);
      if (node.body == Node::cut) sum.moment += Sp::rotate(frame[i].R, s.elastic.left_out);  // there gravity acts, too
      if (node.tip) add(end[i], s.tip, Sp::force(s.tip, end[i].u, s.end_w), Sp::torque(s.tip, end[i].u, s.end_w));
    }
    return sum;
  }
};

}  // namespace
