// Forward dynamics of a chain after its `move`, and of an implicit step what it solves: inward articulated inertias and
// forces (Eq. 93-96), outward accelerations (Eq. 92).
#pragma once

#include "lanes/chain.hpp"

namespace {

using flexarm::lanes::Shift;

constexpr double kSingular = 1e-14;  // parts of an inertia below which what a freedom moves is rounding

/// Takes a pivot, which must be above the least.
template <class C>
inline void accept(C& chain, const typename C::S& d, const typename C::S& least, typename C::Mask& good) {
  using S = typename C::S;
  const typename C::Mask above = d > least;
  if (!Lanes<S>::all(above)) chain.lost = chain.lost | (good & Lanes<S>::none_of(above | Lanes<S>::finite(d + least)));
  good = good & above;
}

/// Eliminates the elastic coordinates of a node: M, f and n, of what its end carries, become those of the whole body
/// without these coordinates.
template <bool inertia, bool forces, bool biased, class C>
inline void condense(C& chain, const Node& node, State<typename C::Space>& s, typename C::Space::Inertia& M,
                     typename C::Lin& f, typename C::Ang& n, const typename C::S* tau, const Shift& shift,
                     typename C::Mask& good) {
  using Sp = typename C::Space;
  using S = typename C::S;
  using Lin = typename C::Lin;
  using Ang = typename C::Ang;
  Elastic<Sp>& e = s.elastic;
  const int ne = node.ne;
  if constexpr (forces) {
    f = Sp::rotate(e.end.R, f);
    n = Sp::rotate_angular(e.end.R, n);
  }
  if constexpr (inertia) {
    const typename Sp::Inertia carried = Sp::rotate(e.end.R, M);
    M = Sp::shift(carried, e.end.x);
    if constexpr (forces && biased) {
      f += Sp::force(carried, e.end.u_bias, e.end.turn_bias);
      n += Sp::torque(carried, e.end.u_bias, e.end.turn_bias);
    }
    for (int k = 0; k < ne; ++k) {
      const Lin g = Sp::force(carried, e.end.J_linear[k], e.end.J_angular[k]);
      const Ang h = Sp::torque(carried, e.end.J_linear[k], e.end.J_angular[k]);
      for (int j = 0; j <= k; ++j)
        e.L[packed(k, j)] = e.M[packed(k, j)] + (Sp::dot(e.end.J_linear[j], g) + Sp::dot(e.end.J_angular[j], h));
      e.W_linear[k] = e.M_linear[k] + g;
      e.W_angular[k] = e.M_angular[k] + (h + Sp::moment(e.end.x, g));
    }
    Sp::add(M, s.body);
    if (shift.stiffness != 0.0 || shift.damping != 0.0) {
      const double* K = e.constants;
      for (int k = 0; k < ne * (ne + 1) / 2; ++k) e.L[k] += shift.stiffness * next<S>(K);
      if (node.damped)
        for (int k = 0; k < ne * (ne + 1) / 2; ++k) e.L[k] += shift.damping * next<S>(K);
    }
    // M = L D L^T in e.L: below the diagonal L, on it 1/D; W = L^-1 M_er
    for (int k = 0; k < ne; ++k) {
      S d = e.L[packed(k, k)];
      for (int j = 0; j < k; ++j) {
        S l = e.L[packed(k, j)];
        for (int i = 0; i < j; ++i) l -= e.L[packed(k, i)] * e.L[packed(j, i)];
        e.L[packed(k, j)] = l;  // L D still
      }
      Lin wl = e.W_linear[k];
      Ang wa = e.W_angular[k];
      for (int j = 0; j < k; ++j) {
        const S ld = e.L[packed(k, j)], l = ld * e.L[packed(j, j)];
        d -= l * ld;
        e.L[packed(k, j)] = l;
        wl = wl - l * e.W_linear[j];
        wa = wa - l * e.W_angular[j];
      }
      accept(chain, d, S{}, good);
      const S over = 1.0 / d;
      e.L[packed(k, k)] = over;
      e.W_linear[k] = wl;
      e.W_angular[k] = wa;
      Sp::take(M, over, wl, wa);
    }
  }
  if constexpr (forces) {
    for (int k = 0; k < ne; ++k) {
      S y = tau[node.ve + k] - (Sp::dot(e.end.J_linear[k], f) + Sp::dot(e.end.J_angular[k], n));
      if constexpr (biased) y -= e.e[k];
      for (int j = 0; j < k; ++j) y -= e.L[packed(k, j)] * e.y[j];
      e.y[k] = y;
    }
    n += Sp::moment(e.end.x, f);
    if constexpr (biased) {
      f += s.body_f;
      n += s.body_n;
    }
    for (int k = 0; k < ne; ++k) {
      e.y[k] *= e.L[packed(k, k)];
      f += e.y[k] * e.W_linear[k];
      n += e.y[k] * e.W_angular[k];
    }
  }
}

/// Inward: articulated inertias and their factors, or articulated forces, or both.
/// @return where every pivot is positive; where not, `chain.lost` says why
template <bool inertia, bool forces, bool biased, class C>
inline typename C::Mask inward(C& chain, const typename C::S* tau, const typename C::S* given, const Shift& shift) {
  using Sp = typename C::Space;
  using S = typename C::S;
  using Lin = typename C::Lin;
  using Ang = typename C::Ang;
  typename C::Mask good = Lanes<S>::everywhere(true);
  chain.lost = Lanes<S>::everywhere(false);
  typename Sp::Inertia M = Sp::no_inertia();  // of what follows, in the axes of this node's end, about its end
  Lin f = Sp::zero();
  Ang n = Sp::zero_angular();
  for (int i = chain.layout.nodes; i-- > 0;) {
    const Node& node = chain.layout.node[i];
    State<Sp>& s = chain.state[i];
    if (node.ne > 0) {
      if constexpr (inertia)
        if (node.tip) Sp::add(M, s.tip);
      if constexpr (forces && biased)
        if (node.tip || node.loads > 0) {
          f += s.tip_f;
          n += s.tip_n;
        }
      condense<inertia, forces, biased>(chain, node, s, M, f, n, tau, shift, good);
    } else {
      if constexpr (inertia)
        if (node.body) Sp::add(M, s.body);
      if constexpr (forces && biased)
        if (node.body) {
          f += s.body_f;
          n += s.body_n;
        }
    }
    // the joint is eliminated (Eq. 93-96)
    const bool about = node.kind == Node::revolute;
    if (node.kind != Node::fixed && !node.given) {
      if constexpr (inertia) {
        Sp::column(M, about, node.axis, s.U_f, s.U_n);
        S d = about ? Sp::angular_component(s.U_n, node.axis) : Sp::component(s.U_f, node.axis);
        if (node.passive) d += s.reflected + shift.damping * s.slope_v + shift.stiffness * s.slope_q;
        accept(chain, d, kSingular * Sp::trace(M, about), good);
        s.over_d = 1.0 / d;
        Sp::take(M, s.over_d, s.U_f, s.U_n);
        if (!node.passive) Sp::clear(M, about, node.axis);  // M~ H = 0: not even rounding, of which much would be left
      }
      if constexpr (forces) {
        const S applied = node.sign * tau[node.v];
        S u = applied - (about ? Sp::angular_component(n, node.axis) : Sp::component(f, node.axis));
        if constexpr (biased)
          if (node.passive) u -= node.sign * s.resistance;
        s.u = s.over_d * u;
        f += s.u * s.U_f;
        n += s.u * s.U_n;
        if (!node.passive) (about ? Sp::angular_component(n, node.axis) : Sp::component(f, node.axis)) = applied;
      }
    }
    if constexpr (inertia && forces && biased)
      if (!node.coincident || node.given) {
        Lin a = s.bias_a;
        Ang dw = s.bias_w;
        if (node.kind != Node::fixed && node.given)  // what is prescribed is part of the bias
          (about ? Sp::angular_component(dw, node.axis) : Sp::component(a, node.axis)) += node.sign * given[node.v];
        f += Sp::force(M, a, dw);
        n += Sp::torque(M, a, dw);
      }
    if (i == 0) break;
    if (node.coincident) continue;
    if constexpr (inertia)
      M = Sp::shift(
          about && !node.turned && !node.ball ? Sp::rotate(node.axis, s.sine, s.cosine, M) : Sp::rotate(s.R, M), s.r);
    if constexpr (forces) {
      f = Sp::rotate(s.R, f);
      n = Sp::rotate_angular(s.R, n) + Sp::moment(s.r, f);
    }
  }
  return good;
}

/// Outward: accelerations, into x, which holds those that are given. Without biases, of what solve_shifted asks for.
template <bool biased, class C>
inline void outward(C& chain, const typename C::Lin& base, typename C::S* x) {
  using Sp = typename C::Space;
  using S = typename C::S;
  using Lin = typename C::Lin;
  using Ang = typename C::Ang;
  Lin a = base;  // of the frame before, at its end
  Ang dw = Sp::zero_angular();
  for (int i = 0; i < chain.layout.nodes; ++i) {
    const Node& node = chain.layout.node[i];
    State<Sp>& s = chain.state[i];
    if (!node.coincident) {
      const Lin at = i == 0 ? a : a + Sp::cross(dw, s.r);
      a = Sp::unrotate(s.R, at);
      dw = Sp::unrotate_angular(s.R, dw);
    }
    if constexpr (biased) {
      a += s.bias_a;
      dw += s.bias_w;
    }
    if (node.kind != Node::fixed) {
      if (!node.given) x[node.v] = node.sign * (s.u - s.over_d * (Sp::dot(s.U_f, a) + Sp::dot(s.U_n, dw)));
      const S qdd = node.sign * x[node.v];
      (node.kind == Node::revolute ? Sp::angular_component(dw, node.axis) : Sp::component(a, node.axis)) += qdd;
    }
    if (node.ne == 0) continue;
    Elastic<Sp>& e = s.elastic;
    S* xe = x + node.ve;
    for (int k = node.ne; k-- > 0;) {  // L^T x = y - D^-1 W A
      S value = e.y[k] - e.L[packed(k, k)] * (Sp::dot(e.W_linear[k], a) + Sp::dot(e.W_angular[k], dw));
      for (int j = k + 1; j < node.ne; ++j) value -= e.L[packed(j, k)] * xe[j];
      xe[k] = value;
    }
    if (i + 1 < chain.layout.nodes) C::template carry_end<biased>(node, e, xe, a, dw);
  }
}

}  // namespace
