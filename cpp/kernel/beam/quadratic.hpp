// The elastic body at order 1 and 2: the parts of a link's M_rfr and N_rfr (Eq. 80, 81).
//
// A slice is at x = e + l q + s, with e the beam at rest, l q linear in the elastic coordinates and s quadratic
// in them. All integrals over the beam are of products of two such functions of X. The linear parts leave constant
// matrices, made at set-up. For the rest, set-up has chosen functions of X, orthonormal in the beam's mass, that span
// every s (beam_points.cpp): a "point" is the projection of x on one of them. Points are far fewer than Gauss points,
// and integrals are plain sums over them.
#pragma once

#include "beam/quadratic_plane.hpp"
#include "beam/quadratic_space.hpp"

namespace {

/// Numbers P that `bend` needs to work on in space; in the plane it needs fewer, and so do loads (loads.hpp).
inline std::size_t quadratic_scratch(const Node& node) {
  return static_cast<std::size_t>(quadratic::Parts<Space<double>>(node).size);
}

/// Inertia and inertial force of the body, in a link that turns at w and does not accelerate (Eq. 80, 81).
template <class S, class P>
void bend(const Node& node, const double* constants, const double* points, const S* q, const S* dq,
          const typename Plane<S>::Ang& w, typename Plane<S>::Rigid& M, Force<Plane<S>>& F, Elastic<Plane<S>>& out,
          P* scratch) {
  const quadratic::Parts<Plane<P>> parts(node);
  const quadratic::Sums<Plane<P>> packs(scratch, node.ne);
  S* lanes = view<S>(scratch);
  if (node.passes > 0) {
    quadratic::sum_positions(node, points, q, dq, w.z, scratch + parts.slopes, packs);
    sum_lanes(scratch, packs.size, lanes);
  } else {
    for (int k = 0; k < packs.size; ++k) lanes[k] = S{};
  }
  quadratic::finish(node, constants, q, dq, w.z, quadratic::Sums<Plane<S>>(lanes, node.ne), M, F, out);
}

/// The same in space.
template <class S, class P>
void bend(const Node& node, const double* constants, const double* points, const S* q, const S* dq,
          const typename Space<S>::Ang& w, typename Space<S>::Rigid& M, Force<Space<S>>& F, Elastic<Space<S>>& out,
          P* scratch) {
  const quadratic::Parts<Space<P>> parts(node);
  const quadratic::Sums<Space<P>> packs(scratch, node.ne);
  const typename Space<P>::Ang wp{widen(w.x, P{}), widen(w.y, P{}), widen(w.z, P{})};
  quadratic::sum_positions(node, points, q, dq, wp, parts, scratch, *packs.body);
  quadratic::sum_rotations(node, points, q, dq, wp, parts, scratch, *packs.body);
  quadratic::sum_columns(node, parts, scratch, packs);
  S* lanes = view<S>(scratch);
  sum_lanes(scratch, packs.size, lanes);
  quadratic::finish(node, constants, q, dq, w, quadratic::Sums<Space<S>>(lanes, node.ne), M, F, out);
}

/// Moves a slice of which `p` are the numbers (Eq. 24, 37, 38; in the plane turns add, so that Eq. 35, 39 are linear);
/// without `rates`, it makes its place and Jacobian alone.
template <bool rates = true, class S>
void move_slice(const Node& node, const double* p, const S* q, const S* dq, Slice<Plane<S>>& out) {
  using Sp = Plane<S>;
  out.frame.r = Sp::read(p);
  S turn{}, rate{}, y_dot{}, slope[kMostElastic], bias{};
  for (int k = 0; k < node.ne; ++k) {
    const auto [l, t] = read<records::PlaneSlope<S>>(p);
    slope[k] = S{};
    out.frame.r.y += l * q[k];
    y_dot += l * dq[k];
    turn += t * q[k];
    rate += t * dq[k];
    out.J[k].linear.y = l;
    out.J[k].angular = {t};
  }
  for (int k = 0; k < node.quadratic.position_blocks; ++k)
    add_block<rates>(node.quadratic.block[k], p, q, dq, out.frame.r.x, bias, slope, 1);
  S x_dot{};
  for (int k = 0; k < node.ne; ++k) {
    out.J[k].linear.x = slope[k];
    x_dot += slope[k] * dq[k];
  }
  S s, c;
  sine_cosine(turn, s, c);
  out.frame.R = {c, s};
  if constexpr (!rates) return;
  out.rate.linear = {x_dot, y_dot};
  out.bias.linear = {bias, S{}};
  out.rate.angular = {rate};
  out.bias.angular = {S{}};
}

/// The same in space: rows 0 to 2 make the place (Eq. 24, 37, 38), rows 3 to 5 the rotation vector (Eq. 35, 39, 40).
template <bool rates = true, class S>
void move_slice(const Node& node, const double* p, const S* q, const S* dq, Slice<Space<S>>& out) {
  using Sp = Space<S>;
  const int ne = node.ne;
  S slope[6 * kMostElastic], value[6] = {}, bias[6] = {}, rate[6] = {};
  for (int k = 0; k < 6 * ne; ++k) slope[k] = S{};
  for (int r = 0; r < 3; ++r) value[r] = next<S>(p);
  for (int d = 0; d < node.quadratic.directed; ++d) {
    const S l = next<S>(p);
    slope[node.quadratic.direction[d] * ne + node.quadratic.which[d]] = l;
    value[node.quadratic.direction[d]] += l * q[node.quadratic.which[d]];
  }
  for (int k = 0; k < ne; ++k) {
    const S l = next<S>(p);
    const int r = 3 + node.about[k];
    slope[r * ne + k] = l;
    value[r] += l * q[k];
  }
  for (int k = 0; k < node.quadratic.blocks; ++k) {
    const Block& b = node.quadratic.block[k];
    add_block<rates>(b, p, q, dq, value[b.row], bias[b.row], slope + b.row * ne, 1);
  }
  const Turned<S> turned({value[3], value[4], value[5]});
  out.frame.r = {value[0], value[1], value[2]};
  out.frame.R = turned.rotation();
  if constexpr (rates) {
    for (int r = 0; r < 6; ++r)
      for (int k = 0; k < ne; ++k) rate[r] += slope[r * ne + k] * dq[k];
    const typename Sp::Lin th_dot{rate[3], rate[4], rate[5]};
    out.rate.linear = {rate[0], rate[1], rate[2]};
    out.bias.linear = {bias[0], bias[1], bias[2]};
    out.rate.angular = turned.jacobian(th_dot, 1.0);
    out.bias.angular = turned.bias(th_dot, {bias[3], bias[4], bias[5]}, 1.0);
  }
  for (int k = 0; k < ne; ++k) {
    out.J[k].linear = {slope[k], slope[ne + k], slope[2 * ne + k]};
    out.J[k].angular = turned.jacobian({slope[3 * ne + k], slope[4 * ne + k], slope[5 * ne + k]}, 1.0);
  }
}

}  // namespace
