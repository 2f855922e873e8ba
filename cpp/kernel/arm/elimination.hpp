// Forward dynamics of a tree of nodes after its `move`: inward articulated inertias and forces (Eq. 93-96), outward
// accelerations (Eq. 92). And the two halves of it: factors of the mass matrix, and solutions by these.
#pragma once

#include "arm/chain.hpp"
#include "door/kernels.hpp"

namespace {

using flexarm::lanes::Outcome;
using flexarm::lanes::Shift;

constexpr double kSingular = 1e-14;  // parts of an inertia below which a freedom's inertia is rounding

/// Takes a pivot, which must be above the least.
template <class C>
inline void accept(C& chain, const typename C::S& d, const typename C::S& least, typename C::Mask& good) {
  using S = typename C::S;
  const typename C::Mask above = d > least;
  if (!Lanes<S>::all(above)) chain.lost = chain.lost | (good & Lanes<S>::none_of(above | Lanes<S>::finite(d + least)));
  good = good & above;
}

// --- Factors: articulated inertias. ---

/// Adds the inertia M on a slice of a beam, in link axes, to M_ee and M_er; the sums go into e.L and e.W.
template <class Sp>
inline void add_carried(const Node& node, const Slice<Sp>& at, const typename Sp::Inertia& M,
                        const typename Sp::Scalar* M_ee, const Force<Sp>* M_er, Elastic<Sp>& e) {
  for (int k = 0; k < node.ne; ++k) {
    const Force<Sp> F = M * at.J[k];
    for (int j = 0; j <= k; ++j) e.L[packed(k, j)] = M_ee[packed(k, j)] + dot(at.J[j], F);
    e.W[k] = M_er[k] + at.frame.shift_back(F);
  }
}

/// Adds the inertias that wait at slices, which are turned into link axes. @return their sum about the link's origin
template <class C>
[[gnu::noinline]] typename C::Space::Inertia factor_slices(C& chain, const Node& node, Elastic<typename C::Space>& e) {
  using Sp = typename C::Space;
  typename Sp::Inertia sum = Sp::no_inertia();
  chain.for_slices(node, [&](auto& f) {
    f.M = Sp::rotate(f.slice.frame.R, f.M);
    add_carried(node, f.slice, f.M, e.L, e.W, e);
    f.add(sum, Sp::shift(f.M, f.slice.frame.r));
  });
  return sum;
}

/// Eliminates the elastic coordinates of a node: the inertia M on its end, in link axes, becomes that of the whole link
/// without these coordinates. M_ee = L D L^T goes into e.L (below the diagonal L, on it 1/D), W = L^-1 M_er into e.W.
template <class C>
inline void factor_beam(C& chain, const Node& node, State<typename C::Space>& s, typename C::Space::Inertia& M,
                        const Shift& shift, typename C::Mask& good) {
  using Sp = typename C::Space;
  using S = typename C::S;
  Elastic<Sp>& e = s.elastic;
  const int ne = node.ne;
  add_carried(node, e.end, M, e.M, e.M_er, e);
  M = Sp::shift(M, e.end.frame.r);
  Sp::add(M, s.body);
  if (node.slices > 0) C::add(M, factor_slices(chain, node, e));
  if (shift.stiffness != 0.0 || shift.damping != 0.0) {
    const double* K = e.constants;
    for (int k = 0; k < ne * (ne + 1) / 2; ++k) e.L[k] += shift.stiffness * next<S>(K);
    if (node.damped)
      for (int k = 0; k < ne * (ne + 1) / 2; ++k) e.L[k] += shift.damping * next<S>(K);
  }
  for (int k = 0; k < ne; ++k) {
    S d = e.L[packed(k, k)];
    for (int j = 0; j < k; ++j) {
      S l = e.L[packed(k, j)];
      for (int i = 0; i < j; ++i) l -= e.L[packed(k, i)] * e.L[packed(j, i)];
      e.L[packed(k, j)] = l;  // L D still
    }
    Force<Sp> W = e.W[k];
    for (int j = 0; j < k; ++j) {
      const S ld = e.L[packed(k, j)], l = ld * e.L[packed(j, j)];
      d -= l * ld;
      e.L[packed(k, j)] = l;
      W = W - l * e.W[j];
    }
    accept(chain, d, S{}, good);
    e.L[packed(k, k)] = 1.0 / d;
    e.W[k] = W;
    Sp::take(M, e.L[packed(k, k)], W);
  }
}

/// Eliminates the freedom of a joint: U = M H, M - U U^T / (H^T M H) (Eq. 93, 94).
template <class C>
inline void factor_joint(C& chain, const Node& node, State<typename C::Space>& s, typename C::Space::Inertia& M,
                         const Shift& shift, typename C::Mask& good) {
  using Sp = typename C::Space;
  using S = typename C::S;
  const bool about = node.kind == Node::revolute;
  s.U = Sp::column(M, about, node.axis);
  S d = freedom(node, s.U);
  if (node.passive) d += s.reflected + shift.damping * s.slope_v + shift.stiffness * s.slope_q;
  accept(chain, d, kSingular * Sp::trace(M, about), good);
  s.over_d = 1.0 / d;
  Sp::take(M, s.over_d, s.U);
  if (!node.passive) Sp::clear(M, about, node.axis);  // M~ H = 0: not even rounding, of which much would be left
}

inline bool is_free(const Node& node) { return node.kind != Node::fixed && !node.given; }

/// The recursions' factors, of M + shift without forces by state.
template <class C>
inline typename C::Mask factor_recursive(C& chain, const Shift& shift) {
  using Sp = typename C::Space;
  using S = typename C::S;
  typename C::Mask good = Lanes<S>::everywhere(true);
  chain.lost = Lanes<S>::everywhere(false);
  typename Sp::Inertia M = Sp::no_inertia();  // of all nodes behind, in the axes of this node's end, about its end
  chain.clear_forks();
  for (int i = chain.layout.nodes; i-- > 0;) {
    const Node& node = chain.layout.node[i];
    State<Sp>& s = chain.state[i];
    if (node.fork >= 0) chain.fork[node.fork].add_inertia_to(M);
    if (node.ne > 0) {
      if (node.tip) Sp::add(M, s.tip);
      M = Sp::rotate(s.elastic.end.frame.R, M);
      factor_beam(chain, node, s, M, shift, good);
    } else if (node.body) {
      Sp::add(M, s.body);
    }
    if (is_free(node)) factor_joint(chain, node, s, M, shift, good);
    if (node.parent >= 0 && !node.coincident) M = C::to_parent(node, s, M);
    if (node.branch) chain.leave_at_fork(node, M);
  }
  return good;
}

// --- Forces and accelerations by these factors. V are scalars of the chain or, of one arm, packs of right-hand sides.
// `biased`: with the forces and accelerations of the motion. ---

/// tau less the part that forces at slices take, into y. @return the sum of these forces about the link's origin
template <bool biased, class C, class V>
[[gnu::noinline]] auto apply_slices(const C& chain, const Node& node, const V* tau, V* y) {
  using Vs = typename SpaceOf<typename C::Space, V>::type;
  Force<Vs> sum = Force<Vs>::zero();
  for (int k = 0; k < node.ne; ++k) y[k] = tau[k];
  chain.for_slices(node, [&](auto& f) {
    const auto frame = wide<V>(f.slice.frame);
    Force<Vs> on = frame.turn_back(f.template force<Vs>());
    if constexpr (biased) on += f.M * f.slice.bias;
    for (int k = 0; k < node.ne; ++k) y[k] -= dot(wide<V>(f.slice.J[k]), on);
    sum += frame.shift_back(on);
  });
  return sum;
}

/// Takes a force F on a node's end, in link axes, and those at its slices to the link's origin without the elastic
/// coordinates, which keep in y the values that `outward` needs.
template <bool biased, class C, class V>
inline void apply_beam(const C& chain, const Node& node, const State<typename C::Space>& s,
                       Force<typename SpaceOf<typename C::Space, V>::type>& F, const V* tau, V* y) {
  using Vs = typename SpaceOf<typename C::Space, V>::type;
  const auto& e = s.elastic;
  const int ne = node.ne;
  Force<Vs> at_slices;
  if (node.slices > 0) {
    at_slices = apply_slices<biased>(chain, node, tau, y);
    tau = y;
  }
  for (int k = 0; k < ne; ++k) {
    V left = tau[k] - dot(wide<V>(e.end.J[k]), F);
    if constexpr (biased) left -= e.e[k];
    for (int j = 0; j < k; ++j) left -= e.L[packed(k, j)] * y[j];
    y[k] = left;
  }
  F = wide<V>(e.end.frame).shift_back(F);
  if constexpr (biased) F += s.body_force;
  if (node.slices > 0) F += at_slices;
  for (int k = 0; k < ne; ++k) {
    y[k] *= e.L[packed(k, k)];
    F += y[k] * wide<V>(e.W[k]);
  }
}

/// F + U (tau - H^T F) / (H^T M H) of a joint (Eq. 95, 96). @return the factor of U
template <bool biased, class Sp, class V>
inline V apply_joint(const Node& node, const State<Sp>& s, Force<typename SpaceOf<Sp, V>::type>& F, const V& tau) {
  const V applied = node.sign * tau;
  V u = applied - freedom(node, F);
  if constexpr (biased)
    if (node.passive) u -= node.sign * s.resistance;
  u *= s.over_d;
  F += u * wide<V>(s.U);
  if (!node.passive) freedom(node, F) = applied;
  return u;
}

/// The motion of slices, of that of the node's frame.
template <bool biased, class C, class V>
[[gnu::noinline]] void leave_at_slices(C& chain, const Node& node, const V* xe,
                                       Motion<typename SpaceOf<typename C::Space, V>::type> a) {
  using Vs = typename SpaceOf<typename C::Space, V>::type;
  chain.for_slices(node,
                   [&](auto& f) { f.template motion<Vs>() = C::template to_slice<biased>(node, f.slice, xe, a); });
}

/// Outward (Eq. 92): accelerations, into x, which holds those that are given and, of the others, results of
/// `apply_beam` and `apply_joint`.
template <bool biased, class C, class V>
inline void outward(C& chain, const Motion<typename SpaceOf<typename C::Space, V>::type>& base, V* x) {
  using Vs = typename SpaceOf<typename C::Space, V>::type;
  Motion<Vs> a = base;
  for (int i = 0; i < chain.layout.nodes; ++i) {
    const Node& node = chain.layout.node[i];
    const auto& s = chain.state[i];
    if (node.branch) a = node.seat < 0 ? base : chain.fork[node.seat].template motion<Vs>();
    if (!node.coincident) a = wide<V>(s.frame).to_child(a);
    if constexpr (biased) a += s.bias;
    if (is_free(node)) x[node.v] = node.sign * (x[node.v] - s.over_d * dot(a, wide<V>(s.U)));
    if (node.kind != Node::fixed) freedom(node, a) += node.sign * x[node.v];
    if (node.ne > 0) {
      const auto& e = s.elastic;
      V* xe = x + node.ve;
      for (int k = node.ne; k-- > 0;) {  // L^T x = y - D^-1 W A
        V value = xe[k] - e.L[packed(k, k)] * dot(a, wide<V>(e.W[k]));
        for (int j = k + 1; j < node.ne; ++j) value -= e.L[packed(j, k)] * xe[j];
        xe[k] = value;
      }
      if (node.slices > 0) leave_at_slices<biased>(chain, node, xe, a);
      if (i + 1 < chain.layout.nodes) a = C::template to_slice<biased>(node, e.end, xe, a);
    }
    if (node.fork >= 0) chain.fork[node.fork].template motion<Vs>() = a;
  }
}

/// x = (M + shift)^-1 r by the recursions' factors alone, without forces by state; zero where given.
template <class C, class V>
inline void solve_recursive(C& chain, const V* r, V* x) {
  using Sp = typename C::Space;
  using Vs = typename SpaceOf<Sp, V>::type;
  Force<Vs> F = Force<Vs>::zero();
  chain.clear_forks();
  for (int i = chain.layout.nodes; i-- > 0;) {
    const Node& node = chain.layout.node[i];
    const State<Sp>& s = chain.state[i];
    if (node.fork >= 0) F += chain.fork[node.fork].template force<Vs>();
    if (node.ne > 0) {
      F = wide<V>(s.elastic.end.frame).turn_back(F);
      apply_beam<false>(chain, node, s, F, r + node.ve, x + node.ve);
    }
    if (node.given) x[node.v] = V{};
    if (is_free(node)) x[node.v] = apply_joint<false>(node, s, F, r[node.v]);
    if (node.parent >= 0 && !node.coincident) F = wide<V>(s.frame).to_parent(F);
    if (node.branch) chain.leave_at_fork(node, F);
  }
  outward<false>(chain, Motion<Vs>::zero(), x);
}

/// x = (M + shift)^-1 r of the tree, with forces by state, by the factors; zero where given.
template <class C, class V>
inline void solve_tree(C& chain, const V* r, V* x) {
  solve_recursive(chain, r, x);
  if (chain.stiffened) chain.by_state->correct(chain.layout, x);
}
/// The same with closed loops.
template <class C, class V>
inline void solve(C& chain, const V* r, V* x) {
  solve_tree(chain, r, x);
  if (chain.layout.loops > 0) chain.by_state->loops.close(chain.layout, x);
}
/// Of a residual r, see Loops::correct.
template <class C>
inline void solve_step(C& chain, typename C::S* r, typename C::S* x) {
  solve_tree(chain, r, x);
  if (chain.layout.loops > 0) chain.by_state->loops.correct(chain.layout, r, x);
}

/// Factors M + shift of a chain after its `move`.
/// @return where every pivot is positive; where not, `chain.lost` says why
template <class C>
inline typename C::Mask factor(C& chain, const Shift& shift, double eased = kEased) {
  const typename C::Mask good = factor_recursive(chain, shift);
  chain.stiffened =
      chain.layout.by_state() && (shift.stiffness != 0.0 || shift.damping != 0.0) && chain.by_state->acts(chain.layout);
  if (chain.stiffened)
    chain.by_state->factor(chain, shift, [&](const auto* r, auto* x) { solve_recursive(chain, r, x); });
  if (chain.layout.loops > 0)
    chain.by_state->loops.factor(chain, shift, eased, [&](const auto* r, auto* x) { solve_tree(chain, r, x); });
  return good;
}

/// Accelerations x of the tree become those of the closed loops, by the factors of the mass matrix.
template <class C>
[[gnu::noinline]] void constrain(C& chain, const typename C::Lin& base, typename C::S* x) {
  ByState<C>& by_state = *chain.by_state;
  chain.accelerate(base, x);
  by_state.loops.accelerate(chain, by_state.places, base, x);
  by_state.loops.factor(chain, Shift{}, kEased, [&](const auto* r, auto* y) { solve_recursive(chain, r, y); });
  by_state.loops.constrain(chain.layout, x);
}
/// After inverse dynamics with accelerations x: d^2 g/dt^2 of the loops.
template <class C>
inline void accelerate_loops(C& chain, const typename C::Lin& base, const typename C::S* x) {
  if (chain.layout.loops > 0) chain.by_state->loops.accelerate(chain, chain.by_state->places, base, x);
}
/// Coordinates and rates nearly on the loops come nearer, by the last factors. @param w  scratch (nv)
template <class C>
[[gnu::noinline]] void shut(C& chain, typename C::S* q, typename C::S* v, typename C::S* w) {
  ByState<C>& by_state = *chain.by_state;
  const int nv = chain.layout.nv;
  chain.template move<true, false>(q, v);
  by_state.places.find(chain, v);
  by_state.loops.find(chain, by_state.places, q, v);
  for (int i = 0; i < nv; ++i) w[i] = typename C::S{};
  by_state.loops.close_places(chain.layout, w);
  displace(chain.layout, q, w, q);
  for (int i = 0; i < nv; ++i) w[i] = typename C::S{};
  by_state.loops.close_rates(chain.layout, w);
  for (int i = 0; i < nv; ++i) v[i] += w[i];
}
/// The same from farther off: to the nearest in the norm of M + shift.
template <class C>
[[gnu::noinline]] void project(C& chain, const Shift& shift, typename C::S* q, typename C::S* v, typename C::S* w) {
  constexpr int kRounds = 3;
  chain.move(q, v);
  factor(chain, shift, kProjected);
  for (int round = 0; round < kRounds; ++round) shut(chain, q, v, w);
}
/// Forces of loops, of the rest r of inverse dynamics when all other forces are taken off it; r becomes their
/// part of these forces. @param x  scratch (nv)
template <class C>
[[gnu::noinline]] void react(C& chain, typename C::S* r, typename C::S* x) {
  factor(chain, Shift{});
  chain.by_state->loops.add_held(chain.layout, 1.0, r);
  solve_tree(chain, r, x);
  chain.by_state->loops.react(chain.layout, r, x);
}

/// Forward dynamics of a chain after its `move`: inward articulated inertias M and forces F of all nodes behind, in the
/// axes of a node's end, about its end; outward accelerations.
/// @param tau  generalised forces
/// @param x    accelerations, of which it holds those that are given
/// @return where every pivot is positive; where not, `chain.lost` says why
template <class C>
inline typename C::Mask forward(C& chain, const typename C::Lin& base, const typename C::S* tau, typename C::S* x) {
  using Sp = typename C::Space;
  using S = typename C::S;
  typename C::Mask good = Lanes<S>::everywhere(true);
  chain.lost = Lanes<S>::everywhere(false);
  chain.stiffened = false;
  typename Sp::Inertia M = Sp::no_inertia();
  Force<Sp> F = Force<Sp>::zero();
  chain.clear_forks();
  for (int i = chain.layout.nodes; i-- > 0;) {
    const Node& node = chain.layout.node[i];
    State<Sp>& s = chain.state[i];
    if (node.fork >= 0) {
      chain.fork[node.fork].add_inertia_to(M);
      F += chain.fork[node.fork].template force<Sp>();
    }
    if (node.ne > 0) {
      const Slice<Sp>& end = s.elastic.end;
      if (node.tip) Sp::add(M, s.tip);
      if (node.tip || node.loads > 0 || node.tied) F += s.tip_force;
      M = Sp::rotate(end.frame.R, M);
      F = end.frame.turn_back(F) + M * end.bias;
      factor_beam(chain, node, s, M, Shift{}, good);
      apply_beam<true>(chain, node, s, F, tau + node.ve, x + node.ve);
    } else if (node.body) {
      Sp::add(M, s.body);
      F += s.body_force;
    }
    if (is_free(node)) {
      factor_joint(chain, node, s, M, Shift{}, good);
      x[node.v] = apply_joint<true>(node, s, F, tau[node.v]);
    }
    if (!node.coincident || node.given) {
      Motion<Sp> bias = s.bias;
      if (node.kind != Node::fixed && node.given) freedom(node, bias) += node.sign * x[node.v];  // it is known
      F += M * bias;
    }
    if (node.parent >= 0 && !node.coincident) {
      M = C::to_parent(node, s, M);
      F = s.frame.to_parent(F);
    }
    if (!node.branch) continue;
    chain.leave_at_fork(node, M);
    chain.leave_at_fork(node, F);
  }
  outward<true>(chain, Motion<Sp>{base, Sp::zero_angular()}, x);
  if (chain.layout.loops > 0) constrain(chain, base, x);
  return good;
}

/// The outcome for one arm.
template <class C>
inline Outcome outcome(const C& chain, bool good) {
  return good ? Outcome::good : chain.lost ? Outcome::not_finite : Outcome::singular;
}

}  // namespace
