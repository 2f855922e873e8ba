// Forward dynamics of a chain after its `move`, and of an implicit step what it solves: inward articulated inertias and
// forces (Eq. 93-96), outward accelerations (Eq. 92).
#pragma once

#include "lanes/chain.hpp"
#include "lanes/kernels.hpp"

namespace {

using flexarm::lanes::Outcome;
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

/// The chain's numbers as scalars V, of forces and accelerations: as they are or, of one arm, V a pack, the same in all
/// lanes.
template <class C, class V>
struct Among {
  using Own = typename C::Space;
  using Space = typename SpaceOf<Own, V>::type;
  using Lin = typename Space::Lin;
  using Ang = typename Space::Ang;
  static Lin linear(const typename Own::Lin& x) { return widen_linear<Own, V>(x); }
  static Ang angular(const typename Own::Ang& x) { return widen_angular<Own, V>(x); }
  static typename Space::Rot rotation(const typename Own::Rot& R) { return widen_rotation<Own, V>(R); }
};

/// Eliminates the elastic coordinates of a node: M, f and n, of what its end carries, become those of the whole body
/// without these coordinates.
template <bool inertia, bool forces, bool biased, class C, class V>
inline void condense(C& chain, const Node& node, State<typename C::Space>& s, typename C::Space::Inertia& M,
                     typename Among<C, V>::Lin& f, typename Among<C, V>::Ang& n, const V* tau, V* x, const Shift& shift,
                     typename C::Mask& good) {
  using A = Among<C, V>;
  using Vs = typename A::Space;
  using Sp = typename C::Space;
  using S = typename C::S;
  using Lin = typename C::Lin;
  using Ang = typename C::Ang;
  Elastic<Sp>& e = s.elastic;
  const int ne = node.ne;
  if constexpr (forces) {
    const typename Vs::Rot R = A::rotation(e.end.R);
    f = Vs::rotate(R, f);
    n = Vs::rotate_angular(R, n);
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
    V* y = x + node.ve;
    for (int k = 0; k < ne; ++k) {
      V left =
          tau[node.ve + k] - (Vs::dot(A::linear(e.end.J_linear[k]), f) + Vs::dot(A::angular(e.end.J_angular[k]), n));
      if constexpr (biased) left -= e.e[k];
      for (int j = 0; j < k; ++j) left -= e.L[packed(k, j)] * y[j];
      y[k] = left;
    }
    n += Vs::moment(A::linear(e.end.x), f);
    if constexpr (biased) {
      f += s.body_f;
      n += s.body_n;
    }
    for (int k = 0; k < ne; ++k) {
      y[k] *= e.L[packed(k, k)];
      f += y[k] * A::linear(e.W_linear[k]);
      n += y[k] * A::angular(e.W_angular[k]);
    }
  }
}

/// Inward: articulated inertias and their factors, or articulated forces, or both.
/// @param tau  generalised forces
/// @param x    accelerations that are given; gets what `outward` goes on from
/// @return where every pivot is positive; where not, `chain.lost` says why
template <bool inertia, bool forces, bool biased, class C, class V>
inline typename C::Mask inward(C& chain, const V* tau, V* x, const Shift& shift) {
  using A = Among<C, V>;
  using Vs = typename A::Space;
  using Sp = typename C::Space;
  using S = typename C::S;
  typename C::Mask good = Lanes<S>::everywhere(true);
  chain.lost = Lanes<S>::everywhere(false);
  typename Sp::Inertia M = Sp::no_inertia();  // of what follows, in the axes of this node's end, about its end
  typename A::Lin f = Vs::zero();
  typename A::Ang n = Vs::zero_angular();
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
      condense<inertia, forces, biased>(chain, node, s, M, f, n, tau, x, shift, good);
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
        const V applied = node.sign * tau[node.v];
        V u = applied - (about ? Vs::angular_component(n, node.axis) : Vs::component(f, node.axis));
        if constexpr (biased)
          if (node.passive) u -= node.sign * s.resistance;
        u *= s.over_d;
        f += u * A::linear(s.U_f);
        n += u * A::angular(s.U_n);
        if (!node.passive) (about ? Vs::angular_component(n, node.axis) : Vs::component(f, node.axis)) = applied;
        x[node.v] = u;
      }
    }
    if constexpr (inertia && forces && biased)
      if (!node.coincident || node.given) {
        typename C::Lin a = s.bias_a;
        typename C::Ang dw = s.bias_w;
        if (node.kind != Node::fixed && node.given)  // what is prescribed is part of the bias
          (about ? Sp::angular_component(dw, node.axis) : Sp::component(a, node.axis)) += node.sign * x[node.v];
        f += Sp::force(M, a, dw);
        n += Sp::torque(M, a, dw);
      }
    if (i == 0) break;
    if (node.coincident) continue;
    if constexpr (inertia)
      M = Sp::shift(
          about && !node.turned && !node.ball ? Sp::rotate(node.axis, s.sine, s.cosine, M) : Sp::rotate(s.R, M), s.r);
    if constexpr (forces) {
      const typename Vs::Rot R = A::rotation(s.R);
      f = Vs::rotate(R, f);
      n = Vs::rotate_angular(R, n) + Vs::moment(A::linear(s.r), f);
    }
  }
  return good;
}

/// Outward: accelerations, into x as `inward` left it, which holds those that are given. Without biases, of what
/// solve_shifted asks for.
template <bool biased, class C, class V>
inline void outward(C& chain, const typename Among<C, V>::Lin& base, V* x) {
  using A = Among<C, V>;
  using Vs = typename A::Space;
  using Sp = typename C::Space;
  typename A::Lin a = base;  // of the frame before, at its end
  typename A::Ang dw = Vs::zero_angular();
  for (int i = 0; i < chain.layout.nodes; ++i) {
    const Node& node = chain.layout.node[i];
    State<Sp>& s = chain.state[i];
    if (!node.coincident) {
      const typename A::Lin at = i == 0 ? a : a + Vs::cross(dw, A::linear(s.r));
      const typename Vs::Rot R = A::rotation(s.R);
      a = Vs::unrotate(R, at);
      dw = Vs::unrotate_angular(R, dw);
    }
    if constexpr (biased) {
      a += s.bias_a;
      dw += s.bias_w;
    }
    if (node.kind != Node::fixed) {
      if (!node.given) {
        const V carried = Vs::dot(A::linear(s.U_f), a) + Vs::dot(A::angular(s.U_n), dw);
        x[node.v] = node.sign * (x[node.v] - s.over_d * carried);
      }
      const V qdd = node.sign * x[node.v];
      (node.kind == Node::revolute ? Vs::angular_component(dw, node.axis) : Vs::component(a, node.axis)) += qdd;
    }
    if (node.ne == 0) continue;
    Elastic<Sp>& e = s.elastic;
    V* xe = x + node.ve;
    for (int k = node.ne; k-- > 0;) {  // L^T x = y - D^-1 W A
      const V carried = Vs::dot(A::linear(e.W_linear[k]), a) + Vs::dot(A::angular(e.W_angular[k]), dw);
      V value = xe[k] - e.L[packed(k, k)] * carried;
      for (int j = k + 1; j < node.ne; ++j) value -= e.L[packed(j, k)] * xe[j];
      xe[k] = value;
    }
    if (i + 1 < chain.layout.nodes) C::template carry_end<biased>(node, e, xe, a, dw);
  }
}

/// What became of the factors of one arm.
template <class C>
inline Outcome outcome(const C& chain, bool good) {
  return good ? Outcome::good : chain.lost ? Outcome::not_finite : Outcome::singular;
}

/// Factors M + shift of a chain after its `move`.
template <class C>
inline typename C::Mask factor(C& chain, const Shift& shift) {
  const typename C::S* none = nullptr;
  return inward<true, false, false>(chain, none, static_cast<typename C::S*>(nullptr), shift);
}
/// x = (M + shift)^-1 r, zero where given.
template <class C, class V>
inline void solve(C& chain, const V* r, V* x) {
  for (int i = 0; i < chain.layout.nodes; ++i)
    if (chain.layout.node[i].given) x[chain.layout.node[i].v] = V{};
  inward<false, true, false>(chain, r, x, Shift{});
  outward<false>(chain, Among<C, V>::Space::zero(), x);
}

}  // namespace
