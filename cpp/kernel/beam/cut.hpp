// The elastic body at order 0: its kinetic energy is cut to terms linear in the elastic coordinates (in J alone) and
// constant (elsewhere); the rest is taken with its own exact equations of motion. Momenta
//   p = m v + w x c + L dq,   h = c x v + J w + C dq,   with c = S + L q, J = J0 + sum_k dJ_k q_k
// give, by the Boltzmann-Hamel equations, the code below in the place of Eq. 80, 81. The tip body is part of it, and
// so is gravity, but for the part on the tip body where it really is. The next node moves with the end slice.
#pragma once

#include "beam/quadratic.hpp"

namespace {

/// Inertia and forces, after `move_slice` of the end.
/// @param gravity  in link axes
template <class Sp, class S = typename Sp::Scalar>
void bend_cut(const Node& node, const double* p, const typename Sp::Lin& gravity, const S* q, const S* dq,
              const typename Sp::Ang& w, typename Sp::Rigid& M, Force<Sp>& F, Elastic<Sp>& out) {
  using Lin = typename Sp::Lin;
  using Ang = typename Sp::Ang;
  auto [m, c, J] = read<records::Body<Sp>>(p);
  Lin c_rate = Sp::zero();
  const auto [tip, on_end, at_rest] = read<records::CutTip<Sp>>(p);
  const Lin arm = Sp::rotate(out.end.frame.R, on_end);
  Lin beyond = tip * (out.end.frame.r + arm - at_rest);  // its mass times the part of its displacement beyond the cut
  Ang spin = Sp::zero_angular(), turning = Sp::zero_angular();  // C dq; dJ/dt w
  for (int k = 0; k < node.ne; ++k) {
    const auto [L, C, dJ, first] = read<records::CutCoordinate<Sp>>(p);
    const Ang h = Sp::apply(dJ, w);
    c += q[k] * L;
    c_rate += dq[k] * L;
    Sp::add(J, Sp::scaled(q[k], dJ));
    spin += dq[k] * C;
    turning += dq[k] * h;
    beyond = beyond - q[k] * first;
    const Lin by_q = tip * (out.end.J[k].linear + Sp::cross(out.end.J[k].angular, arm)) - first;
    out.e[k] = -0.5 * Sp::dot(w, h) - Sp::dot(by_q, gravity);
    out.M_er[k].force = L;
    out.M_er[k].moment = C;
  }
  for (int k = 0; k < node.ne * (node.ne + 1) / 2; ++k) out.M[k] = next<S>(p);
  M = {m, c, J};
  out.left_out = beyond;
  F.force = Sp::cross(w, Sp::cross(w, c) + number<S>(2.0) * c_rate);
  F.moment = turning + Sp::cross(w, Sp::apply(J, w) + spin) - Sp::moment(beyond, gravity);
  out.constants = p;
  add_elastic_forces(node, p, q, dq, out.e);
}

}  // namespace
