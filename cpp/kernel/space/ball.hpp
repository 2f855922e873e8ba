// Balls: a unit quaternion (w x y z) for the turn, the angular velocity in the axes that turn for its rates. And
// an arm's coordinates with them; the others are the integrals of its rates.
#pragma once

#include "door/layout.hpp"
#include "space/space.hpp"

namespace {

using flexarm::lanes::Layout;
using flexarm::lanes::Node;

constexpr double kPull = 1.0;  // 1/s, of a quaternion's length to 1

template <class S>
S square_of(const S* p) {
  return p[0] * p[0] + p[1] * p[1] + p[2] * p[2] + p[3] * p[3];
}

/// The rotation of a quaternion of any length; not a number where its square overflows.
template <class S>
typename Space<S>::Rot ball_rotation(const S* p) {
  const S square = square_of(p), scale = 2.0 / square, one = 0.5 * (scale * square), w = scale * p[0];
  const S x = scale * p[1], y = scale * p[2], z = scale * p[3];
  const S xx = x * p[1], yy = y * p[2], zz = z * p[3], xy = x * p[2], xz = x * p[3], yz = y * p[3];
  const S wx = w * p[1], wy = w * p[2], wz = w * p[3];
  return {one - (yy + zz), xy - wz, xz + wy, xy + wz, one - (xx + zz), yz - wx, xz - wy, yz + wx, one - (xx + yy)};
}

/// The turn of a ball: rotation vector and angle, at most pi.
template <class S>
struct BallTurn {
  using L = Lanes<S>;
  S vector[3], angle;

  explicit BallTurn(const S* p) {
    constexpr double kSmall = 1e-8;
    const S one = number<S>(1.0), square = p[1] * p[1] + p[2] * p[2] + p[3] * p[3];
    const auto back = p[0] < 0.0, turned = square > 0.0;
    const S w = L::select(back, -p[0], p[0]);  // with all signs changed it is the same rotation
    const auto small = square - kSmall * (w * w) < 0.0;
    const S length = L::root(L::select(turned, square, one)), some = L::select(small, w, one);
    const S x2 = L::select(small, square, S{}) / (some * some);
    const S series = (2.0 / some) * (1.0 - x2 * (1.0 / 3.0) + x2 * x2 * 0.2);  // 2 atan(x) = 2 (x - x^3/3 + ..)
    const S factor = L::select(small, series, 2.0 * L::atan2(length, w) / length);
    const S sense = L::select(back, -factor, factor);
    for (int k = 0; k < 3; ++k) vector[k] = sense * p[k + 1];
    angle = L::select(turned, factor * length, S{});
  }
};

/// Calls `own(q, v, given)` for every coordinate that is the integral of a rate, and whether it is prescribed;
/// `ball(q, v)` for a quaternion and its rates.
template <class Own, class Ball>
void for_coordinates(const Layout& layout, const Own& own, const Ball& ball) {
  for (int i = 0; i < layout.nodes; ++i) {
    const Node& node = layout.node[i];
    if (node.ball)
      ball(node.q, node.v);
    else if (node.kind != Node::fixed && !node.coincident)
      own(node.q, node.v, node.given);
    for (int k = 0; k < node.ne; ++k) own(node.qe + k, node.ve + k, false);
  }
}

template <class S>
void scale_to_one(S* p) {
  const S over = 1.0 / Lanes<S>::root(square_of(p));
  for (int k = 0; k < 4; ++k) p[k] = over * p[k];
}

/// The quaternion p0 turned by the rotation vector u, in the axes that turn: p0 exp(u / 2), of unit length.
template <class S>
void turn_ball(const S* p0, const S* u, S* p) {
  using L = Lanes<S>;
  const S x = 0.5 * u[0], y = 0.5 * u[1], z = 0.5 * u[2], square = x * x + y * y + z * z;
  const auto small = square < 1e-16;
  const S angle = L::root(L::select(small, number<S>(1.0), square));
  S sine, cosine;
  sine_cosine(angle, sine, cosine);
  const S c = L::select(small, 1.0 - 0.5 * square, cosine);
  const S k = L::select(small, 1.0 - square * (1.0 / 6.0), sine / angle);
  const S w = p0[0], a = p0[1], b = p0[2], d = p0[3], sx = k * x, sy = k * y, sz = k * z;
  p[0] = w * c - (a * sx + b * sy + d * sz);
  p[1] = w * sx + c * a + (b * sz - d * sy);
  p[2] = w * sy + c * b + (d * sx - a * sz);
  p[3] = w * sz + c * d + (a * sy - b * sx);
  scale_to_one(p);
}

/// Rates of a quaternion at an angular velocity w in the axes that turn: E(p) w, and, where its length has drifted,
/// a term that draws it back to 1.
template <class S>
void ball_rates(const S* p, const S* w, S* dp) {
  const S pull = kPull * (1.0 - square_of(p));
  dp[0] = pull * p[0] - 0.5 * (p[1] * w[0] + p[2] * w[1] + p[3] * w[2]);
  dp[1] = 0.5 * (p[0] * w[0] + (p[2] * w[2] - p[3] * w[1])) + pull * p[1];
  dp[2] = 0.5 * (p[0] * w[1] + (p[3] * w[0] - p[1] * w[2])) + pull * p[2];
  dp[3] = 0.5 * (p[0] * w[2] + (p[1] * w[1] - p[2] * w[0])) + pull * p[3];
}

/// q0 moved by u, rates times time: q0 + u, and a ball's quaternion turned by u. Prescribed coordinates keep their
/// values.
template <class S>
void displace(const Layout& layout, const S* q0, const S* u, S* q) {
  for_coordinates(
      layout,
      [&](int i, int j, bool given) {
        if (!given) q[i] = q0[i] + u[j];
      },
      [&](int i, int j) { turn_ball(q0 + i, u + j, q + i); });
}

/// dq/dt = E(q) v; a quaternion that has drifted is drawn back to unit length.
template <class S>
void coordinate_rates(const Layout& layout, const S* q, const S* v, S* dq) {
  for_coordinates(
      layout, [&](int i, int j, bool) { dq[i] = v[j]; }, [&](int i, int j) { ball_rates(q + i, v + j, dq + i); });
}

/// Scales quaternions to unit length.
template <class S>
void normalise(const Layout& layout, S* q) {
  for_coordinates(layout, [](int, int, bool) {}, [&](int i, int) { scale_to_one(q + i); });
}

}  // namespace
