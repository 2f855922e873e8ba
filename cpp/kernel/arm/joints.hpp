// How a joint moves its frame: places, velocities, and accelerations beyond those that its freedom gives (Eq. 82, 83).
#pragma once

#include "arm/resistance.hpp"

namespace {

using flexarm::lanes::Layout;

/// Acceleration of a frame's origin in a parent that turns by w, own axes.
template <class Sp>
inline typename Sp::Lin centripetal(const Frame<Sp>& frame, const typename Sp::Ang& w) {
  return Sp::unrotate(frame.R, Sp::cross(w, Sp::cross(w, frame.r)));
}

/// A ball's first node, on a frame that turns by w. @param p, q, v  its numbers, quaternion and rates
template <class Sp, class S>
inline void move_ball(const Node& node, const double*& p, const typename Sp::Rot& seat, const S* q, const S* v,
                      const typename Sp::Ang& w, State<Sp>& s) {
  if constexpr (!Sp::planar) {
    if (node.passive) resist_ball(node, p, q, v, &s);
    const typename Sp::Rot R = ball_rotation(q);
    s.frame.R = node.turned ? Sp::times(seat, R) : R;
    const typename Sp::Ang carried = Sp::unrotate_angular(s.frame.R, w), own{v[0], v[1], v[2]};
    s.w = carried + own;
    s.bias = {centripetal(s.frame, w), Sp::cross(carried, own)};
  }
}

/// H^T of a motion or a force: its part along, or about, the axis of a joint.
template <class Sp>
inline typename Sp::Scalar& freedom(const Node& node, Motion<Sp>& m) {
  return node.kind == Node::revolute ? Sp::angular_component(m.angular, node.axis) : Sp::component(m.linear, node.axis);
}
template <class Sp>
inline typename Sp::Scalar& freedom(const Node& node, Force<Sp>& f) {
  return node.kind == Node::revolute ? Sp::angular_component(f.moment, node.axis) : Sp::component(f.force, node.axis);
}

/// A node in the frame of the one before it.
template <class Sp>
inline void stay(const typename Sp::Ang& w, State<Sp>& s) {
  using S = typename Sp::Scalar;
  s.frame = {Sp::turn(0, S{}, number<S>(1.0)), Sp::zero()};
  s.w = w;
  s.bias = Motion<Sp>::zero();
}

inline bool is_hinge(const Node& node) { return node.kind == Node::revolute && !node.ball && !node.coincident; }

/// Numbers P that `turn_hinges` needs to work on, of one arm or of one in each lane.
template <class S, class P>
inline std::size_t hinge_scratch(const Layout& layout) {
  constexpr std::size_t W = sizeof(P) / sizeof(S);
  return 3 * ((static_cast<std::size_t>(layout.nodes) + W - 1) / W);
}

/// Sines and cosines of the hinges of nodes from `first` to before `end`; of one arm, of several hinges at once.
template <class Sp, class S, class P>
inline void turn_hinges(const Layout& layout, int first, int end, const S* q, State<Sp>* state, P* scratch) {
  constexpr int W = sizeof(P) / sizeof(S);
  S* angle = view<S>(scratch);
  int count = 0;
  for (int i = first; i < end; ++i)
    if (const Node& node = layout.node[i]; is_hinge(node)) angle[count++] = node.sign * q[node.q];
  while (count % W != 0) angle[count++] = S{};
  P *sines = scratch + count / W, *cosines = sines + count / W;
  for (int k = 0; k < count / W; ++k) sine_cosine(scratch[k], sines[k], cosines[k]);
  const S *sine = view<S>(sines), *cosine = view<S>(cosines);
  for (int i = first; i < end; ++i)
    if (is_hinge(layout.node[i])) {
      state[i].sine = *sine++;
      state[i].cosine = *cosine++;
    }
}

/// A hinge, or a slide, or neither, seated on a frame that turns by w.
template <bool rates, class Sp, class S>
inline void move_joint(const Node& node, const typename Sp::Rot& seat, const S* q, const S* v,
                       const typename Sp::Ang& w, State<Sp>& s) {
  const S &sn = s.sine, &cs = s.cosine;
  const bool hinge = node.kind == Node::revolute, slide = node.kind == Node::prismatic;
  s.frame.R = !hinge ? seat : node.turned ? Sp::turned(seat, node.axis, sn, cs) : Sp::turn(node.axis, sn, cs);
  if (slide) {
    typename Sp::Lin along = Sp::zero();
    Sp::component(along, node.axis) += node.sign * q[node.q];
    s.frame.r += Sp::rotate(s.frame.R, along);
  }
  if constexpr (rates) {
    const typename Sp::Ang carried = Sp::unrotate_angular(s.frame.R, w);
    s.w = carried;
    s.bias = {centripetal(s.frame, w), Sp::zero_angular()};
    if (hinge) {
      typename Sp::Ang own = Sp::zero_angular();
      Sp::angular_component(own, node.axis) += node.sign * v[node.v];
      s.w += own;
      s.bias.angular = Sp::cross(carried, own);
    } else if (slide) {
      typename Sp::Lin rate = Sp::zero();
      Sp::component(rate, node.axis) += 2.0 * (node.sign * v[node.v]);
      s.bias.linear += Sp::cross(carried, rate);
    }
  }
}

}  // namespace
