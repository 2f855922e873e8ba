// Passive forces of joints: springs, dampers, stops and reflected inertia, with the slopes that implicit steps
// need.
#pragma once

#include "arm/state.hpp"
#include "space/ball.hpp"

namespace {

constexpr double kSoftEntry = 1e-3;  // rad or m past a stop over which its damping sets in

/// Springs, dampers and stops; see JointForce.
template <class Sp, class S>
inline void resist(const Node& node, const double*& p, const S& q, const S& v, State<Sp>& s) {
  const auto spring = read<records::Spring<S>>(p);
  s.reflected = spring.reflected;
  s.resistance = spring.stiffness * (q - spring.rest) + spring.damping * v;
  s.slope_q = spring.stiffness;
  s.slope_v = spring.damping;
  if (!node.stops) return;
  const auto stops = read<records::Stops<S>>(p);
  const S k = stops.stiffness, d = stops.damping, one = number<S>(1.0), o{};
  for (int side = 0; side < 2; ++side) {
    const S depth = side == 0 ? q - stops.lower : q - stops.upper;
    const auto hit = side == 0 ? depth < 0.0 : depth > 0.0;
    const S size = side == 0 ? -depth : depth, entry = size * (1.0 / kSoftEntry);
    const auto soft = entry < 1.0;
    const S part = Lanes<S>::select(soft, entry, one);
    const S push = k * depth + d * part * v;
    const S by_q = k + Lanes<S>::select(soft, d * v * ((side == 0 ? -1.0 : 1.0) / kSoftEntry), o);
    s.resistance += Lanes<S>::select(hit, push, o);
    s.slope_q += Lanes<S>::select(hit, by_q, o);
    s.slope_v += Lanes<S>::select(hit, d * part, o);
  }
  s.slope_q = Lanes<S>::select(s.slope_q < 0.0, o, s.slope_q);
}

/// The same of a ball, into the three nodes that it is.
template <class Sp, class S>
inline void resist_ball(const Node& node, const double*& p, const S* q, const S* v, State<Sp>* s) {
  const auto spring = read<records::BallSpring<S>>(p);
  const BallTurn<S> turn(q);
  for (int k = 0; k < 3; ++k) {
    const auto& axis = k == 0 ? spring.x : k == 1 ? spring.y : spring.z;
    s[k].reflected = axis.reflected;
    s[k].resistance = spring.stiffness * turn.vector[k] + axis.damping * v[k];
    s[k].slope_q = spring.stiffness;
    s[k].slope_v = axis.damping;
  }
  if (!node.stops) return;
  const auto stop = read<records::BallStop<S>>(p);
  const S one = number<S>(1.0), o{};
  const S depth = turn.angle - stop.upper, entry = depth * (1.0 / kSoftEntry);
  const auto hit = depth > 0.0;
  const S over = 1.0 / Lanes<S>::select(hit, turn.angle, one);
  const S damping = stop.damping * Lanes<S>::select(entry < 1.0, entry, one);
  const S rate = over * (turn.vector[0] * v[0] + turn.vector[1] * v[1] + turn.vector[2] * v[2]);
  const S push = over * (stop.stiffness * depth + damping * rate);
  for (int k = 0; k < 3; ++k) {
    s[k].resistance += Lanes<S>::select(hit, push * turn.vector[k], o);
    s[k].slope_q += Lanes<S>::select(hit, stop.stiffness, o);
    s[k].slope_v += Lanes<S>::select(hit, damping, o);
  }
}

}  // namespace
