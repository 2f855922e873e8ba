// The quadratic body (quadratic.hpp) in the plane: its sums, and inertia and forces by these.
#pragma once

#include "beam/quadratic_sums.hpp"

namespace {
namespace quadratic {

/// Sums over the points of position.
template <class S, class P>
void sum_positions(const Node& node, const double* t, const S* q, const S* dq, const S& w, P* slopes,
                   Sums<Plane<P>> sums) {
  const int ne = node.ne, points = node.passes;
  const P wp = widen(w, P{});
  P c{}, c_rate{}, bias{}, J{}, n{};
  for (int k = 0; k < ne; ++k) sums.e[k] = P{};
  for (int k = 0; k < ne; ++k) sums.M_linear[k] = sums.M_angular[k].z = P{};
  for (int a = 0; a < points; ++a) {
    P* slope = slopes + a;  // by coordinates, in strides of the number of points
    for (int k = 0; k < ne; ++k) slope[k * points] = P{};
    const P one = next<P>(t), X = next<P>(t), Y = next<P>(t);
    const double* l = t;
    P y = Y, y_dot{};
    for (int k = 0; k < ne; ++k) {
      const P lk = next<P>(t);
      y += lk * widen(q[k], P{});
      y_dot += lk * widen(dq[k], P{});
    }
    P s{}, b{}, s_dot{};
    for (int k = 0; k < node.quadratic.position_blocks; ++k)
      add_block(node.quadratic.block[k], t, q, dq, s, b, slope, points);
    for (int k = 0; k < ne; ++k) s_dot += slope[k * points] * widen(dq[k], P{});
    // acceleration along x, and the part of s along y (Eq. 45)
    const P x = X + s, push = 2.0 * (wp * s_dot);
    const P acc = b - wp * (wp * x + 2.0 * y_dot);
    c += one * s;
    c_rate += one * s_dot;
    bias += one * b;
    J += (X + x) * s;
    n += x * push - y * b;
    for (int k = 0; k < ne; ++k) {
      const P lk = next<P>(l);
      const P gk = slope[k * points];
      sums.e[k] += gk * acc + lk * push;
      sums.M_linear[k] += one * gk;
      sums.M_angular[k].z += s * lk - y * gk;
    }
  }
  *sums.body = {c, c_rate, bias, J, n};
  for (int k = 0; k < packed(ne, 0); ++k) sums.M[k] = P{};
  add_products<1>(slopes, slopes, ne, points, sums.M);
}

/// Adds the parts linear in q, and the body that does not bend, to the sums (Eq. 80, 81).
template <class S>
void finish(const Node& node, const double* p, const S* q, const S* dq, const S& w, Sums<Plane<S>> sums,
            typename Plane<S>::Rigid& M, Force<Plane<S>>& F, Elastic<Plane<S>>& out) {
  using Sp = Plane<S>;
  const Moments<Sp>& body = *sums.body;
  auto [m, c, J] = read<records::Body<Sp>>(p);
  c.x += body.c;
  J.zz += body.J;
  S c_y_rate{}, swirl{};  // the swirl is the integral of y dy/dt
  for (int k = 0; k < node.ne; ++k) {
    const auto [cl, ex, ey, rotary] = read<records::PlaneCoordinate<S>>(p);
    S my = ey, my_dot{};  // l_k is paired with y here
    for (int j = 0; j < node.ne; ++j) {
      const S L = next<S>(p);
      my += L * q[j];
      my_dot += L * dq[j];
    }
    c.y += cl * q[k];
    c_y_rate += cl * dq[k];
    J.zz += q[k] * (ey + my);
    swirl += dq[k] * my;
    out.e[k] = sums.e[k] - w * w * my;
    out.M_er[k].force = {sums.M_linear[k], cl};
    out.M_er[k].moment = {ex + rotary + sums.M_angular[k].z};
  }
  M = {m, c, J};
  const S ww = w * w, w2 = 2.0 * w;
  F.force = {body.bias - ww * c.x - w2 * c_y_rate, w2 * body.c_rate - ww * c.y};
  F.moment = {w2 * swirl + body.n};
  finish_elastic(node, p, sums.M, q, dq, out);
}

}  // namespace quadratic
}  // namespace
