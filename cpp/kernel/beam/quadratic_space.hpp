// The quadratic body (quadratic.hpp) in space: its sums, and inertia and forces by these.
#pragma once

#include "beam/quadratic_sums.hpp"

namespace {
namespace quadratic {

template <class P>
typename Space<P>::Lin vector_at(const P* x) {
  return {x[0], x[1], x[2]};
}
template <class P>
void put_vector(P* at, const typename Space<P>::Lin& x) {
  at[0] = x.x;
  at[1] = x.y;
  at[2] = x.z;
}

/// Adds x x^T.
template <class T>
void add_square(const typename Space<T>::Lin& x, typename Space<T>::Sym& xx) {
  xx.xx += x.x * x.x;
  xx.yy += x.y * x.y;
  xx.zz += x.z * x.z;
  xx.xy += x.x * x.y;
  xx.xz += x.x * x.z;
  xx.yz += x.y * x.z;
}

/// Sums over the points of position, which leave their slopes, forces and places in scratch.
template <class S, class P>
void sum_positions(const Node& node, const double*& t, const S* q, const S* dq, const typename Space<P>::Ang& w,
                   Parts<Space<P>> parts, P* scratch, Moments<Space<P>>& sums) {
  using Pt = Space<P>;
  using Lin = typename Pt::Lin;
  const int rows = parts.rows;
  P *slopes = scratch + parts.slopes, *forces = scratch + parts.forces;
  Position<P>* place = view<Position<P>>(scratch + parts.positions);
  Lin c = Pt::zero(), c_rate = c, bias = c, n = c;
  typename Pt::Sym xx = Pt::none();
  for (int a = 0; a < node.passes; ++a) {
    P* slope = slopes + 3 * a;
    for (int k = 0; k < node.ne; ++k) put_vector(slope + k * rows, Pt::zero());
    const P one = next<P>(t);
    P x[3], b[3] = {P{}, P{}, P{}}, u[3] = {P{}, P{}, P{}};
    for (P& xi : x) xi = next<P>(t);
    for (int d = 0; d < node.quadratic.directed; ++d) {
      const P l = next<P>(t);
      const int k = node.quadratic.which[d], row = node.quadratic.direction[d];
      x[row] += l * widen(q[k], P{});
      slope[k * rows + row] = l;
    }
    for (int k = 0; k < node.quadratic.position_blocks; ++k) {
      const Block& block = node.quadratic.block[k];
      add_block(block, t, q, dq, x[block.row], b[block.row], slope + block.row, rows);
    }
    for (int k = 0; k < node.ne; ++k)
      for (int r = 0; r < 3; ++r) u[r] += slope[k * rows + r] * widen(dq[k], P{});
    const Lin at = vector_at(x), u_dot = vector_at(u), u_bias = vector_at(b);
    const Lin drift = number<P>(2.0) * Pt::cross(w, u_dot) + u_bias;
    put_vector(forces + 3 * a, Pt::cross(w, Pt::cross(w, at)) + drift);  // Eq. 45
    place[a] = {one, at};
    c += one * at;
    c_rate += one * u_dot;
    bias += one * u_bias;
    add_square<P>(at, xx);
    n += Pt::cross(at, drift);
  }
  sums.c = c;
  sums.c_rate = c_rate;
  sums.bias = bias;
  sums.xx = xx;
  sums.n = n;
}

/// The points' rotation vectors theta, their slopes and convective second rates b, three rows a point.
/// @param t  numbers of the first point
template <class S, class P>
void add_turns(const Node& node, const double* t, int apart, const S* q, const S* dq, P* slopes, int rows, P* theta,
               P* b) {
  for (int i = 0; i < 3 * node.rotary; ++i) theta[i] = b[i] = P{};
  for (int k = 0; k < node.ne; ++k) {
    const double* l = t + (6 + k) * Lanes<P>::width;
    const P qk = widen(q[k], P{});
    P *column = slopes + k * rows, *const end = column + 3 * node.rotary, *turn = theta + node.about[k];
    for (const int r = node.about[k]; column < end; column += 3, turn += 3, l += apart) {
      put_vector(column, Space<P>::zero());
      column[r] = Lanes<P>::load(l);
      *turn += column[r] * qk;
    }
  }
  t += (6 + node.ne) * Lanes<P>::width;
  for (int k = node.quadratic.position_blocks; k < node.quadratic.blocks; ++k) {
    const Block& block = node.quadratic.block[k];
    const int r = block.row - 3;
    add_blocks(block, t, apart, q, dq, theta + r, b + r, slopes + r, rows, node.rotary);
    t += block.ni * block.nj * Lanes<P>::width;
  }
}

/// A point of rotation: the moments that turn the section there, and R times the root of its inertia, from the slopes
/// of its rotation vector, in place of which it leaves the root of its inertia times J_R. All but R is in section axes.
template <class S, class P>
void turn_section(const Node& node, const double* t, const S* dq, const typename Space<P>::Ang& w, P* slope, int rows,
                  const typename Space<P>::Lin& theta, const typename Space<P>::Lin& b, typename Space<P>::Lin& torque,
                  typename Space<P>::Rot& turn) {
  using Pt = Space<P>;
  using Lin = typename Pt::Lin;
  const Lin root = Pt::read(t), gyro = Pt::read(t);
  P d[3] = {P{}, P{}, P{}};
  const Turned<P> turned(theta);
  for (int k = 0; k < node.ne; ++k) {
    const P qd = widen(dq[k], P{});
    P* column = slope + k * rows;
    for (int r = 0; r < 3; ++r) d[r] += column[r] * qd;
    const Lin J = turned.jacobian(vector_at(column), -1.0);  // Eq. 39
    put_vector(column, {root.x * J.x, root.y * J.y, root.z * J.z});
  }
  const Lin theta_dot = vector_at(d);
  const typename Pt::Rot R = turned.rotation();
  // carried and own angular velocity, and the rate of their sum with accelerations left out (Eq. 46)
  const Lin carried = Pt::unrotate(R, w), own = turned.jacobian(theta_dot, -1.0), W = carried + own;
  const Lin W_dot = Pt::cross(carried, own) + turned.bias(theta_dot, b, -1.0);
  torque = {root.x * W_dot.x + gyro.x * (W.y * W.z), root.y * W_dot.y + gyro.y * (W.z * W.x),
            root.z * W_dot.z + gyro.z * (W.x * W.y)};
  turn = {R.xx * root.x, R.xy * root.y, R.xz * root.z, R.yx * root.x, R.yy * root.y,
          R.yz * root.z, R.zx * root.x, R.zy * root.y, R.zz * root.z};
}

/// Sums over the points of rotation, which leave their slopes, torques and turns in scratch.
template <class S, class P>
void sum_rotations(const Node& node, const double* t, const S* q, const S* dq, const typename Space<P>::Ang& w,
                   Parts<Space<P>> parts, P* scratch, Moments<Space<P>>& sums) {
  using Pt = Space<P>;
  const int first = 3 * node.passes, apart = static_cast<int>(node.quadratic.rotary_numbers) * Lanes<P>::width;
  P *slopes = scratch + parts.slopes + first, *forces = scratch + parts.forces + first;
  P* b = scratch + parts.turns + 6 * node.rotary;  // where no turn is written before it is read
  typename Pt::Rot* turns = view<typename Pt::Rot>(scratch + parts.turns);
  add_turns(node, t, apart, q, dq, slopes, parts.rows, forces, b);
  typename Pt::Lin n = Pt::zero();
  typename Pt::Sym J = Pt::none();
  for (int a = 0; a < node.rotary; ++a, t += apart) {
    typename Pt::Lin torque;
    typename Pt::Rot B;
    turn_section(node, t, dq, w, slopes + 3 * a, parts.rows, vector_at(forces + 3 * a), vector_at(b + 3 * a), torque,
                 B);
    put_vector(forces + 3 * a, torque);
    turns[a] = B;
    const typename Pt::Rot BB = Pt::times_transposed(B, B);
    Pt::add(J, typename Pt::Sym{BB.xx, BB.yy, BB.zz, BB.xy, BB.xz, BB.yz});
    n += Pt::rotate(B, torque);
  }
  sums.J_turn = J;
  sums.n_turn = n;
}

/// Sums over the columns that all points left, of C coordinates from k on: their force and coupling.
template <int C, class P>
void sum_columns_of(const Node& node, Parts<Space<P>> parts, const P* scratch, int k, Sums<Space<P>> sums) {
  using Pt = Space<P>;
  using Lin = typename Pt::Lin;
  const P *column = scratch + parts.slopes + k * parts.rows, *forces = scratch + parts.forces;
  const Position<P>* place = view<const Position<P>>(scratch + parts.positions);
  const typename Pt::Rot* turns = view<const typename Pt::Rot>(scratch + parts.turns);
  P e[C];
  Lin linear[C], angular[C];
  for (int c = 0; c < C; ++c) {
    e[c] = P{};
    linear[c] = angular[c] = Pt::zero();
  }
  for (int r = 0; r < parts.rows; ++r)
    for (int c = 0; c < C; ++c) e[c] += column[c * parts.rows + r] * forces[r];
  for (int a = 0; a < node.passes; ++a, column += 3)
    for (int c = 0; c < C; ++c) {
      const Lin slope = vector_at(column + c * parts.rows);
      linear[c] += place[a].one * slope;
      angular[c] += Pt::cross(place[a].x, slope);
    }
  for (int a = 0; a < node.rotary; ++a, column += 3)
    for (int c = 0; c < C; ++c) angular[c] += Pt::rotate(turns[a], vector_at(column + c * parts.rows));
  for (int c = 0; c < C; ++c) {
    sums.e[k + c] = e[c];
    sums.M_linear[k + c] = linear[c];
    sums.M_angular[k + c] = angular[c];
  }
}
/// Of all coordinates, and inertia of each pair.
template <class P>
void sum_columns(const Node& node, Parts<Space<P>> parts, const P* scratch, Sums<Space<P>> sums) {
  int k = 0;
  for (; k + 2 <= node.ne; k += 2) sum_columns_of<2>(node, parts, scratch, k, sums);
  if (k < node.ne) sum_columns_of<1>(node, parts, scratch, k, sums);
  for (k = 0; k < packed(node.ne, 0); ++k) sums.M[k] = P{};
  add_products<3>(scratch + parts.slopes, scratch + parts.slopes, node.ne, parts.rows, sums.M);
}

/// The body without the turning of its sections.
template <class Sp>
struct Whole {
  typename Sp::Lin c, c_rate;   ///< first moment and its rate
  typename Sp::Sym xx;          ///< the integral of x x^T
  typename Sp::Lin Px, Py, Pz;  ///< integrals of x times the linear parts of dx/dt, dy/dt, dz/dt
};

/// Adds the remainder, not in the points, of functions linear in q: displacements of slices along x, y and z.
template <class S>
void add_linear(const Node& node, const double*& p, const S* q, const S* dq, const typename Space<S>::Ang& w,
                Whole<Space<S>>& whole, Elastic<Space<S>>& out) {
  using Sp = Space<S>;
  const bool stretches = node.stretching > 0;
  for (int d = 0; d < node.quadratic.directed; ++d) {
    const int k = node.quadratic.which[d];
    const auto [cl, rest] = read<records::SpaceCoordinate<Sp>>(p);
    S mx{}, my{}, mz{}, mx_dot{}, my_dot{}, mz_dot{};  // l_k is paired with x, y and z here
    for (int g = 0; g < node.quadratic.directed; ++g) {
      const S L = next<S>(p), Lq = L * q[node.quadratic.which[g]], Ld = L * dq[node.quadratic.which[g]];
      if (node.quadratic.direction[g] == 1) {
        my += Lq;
        my_dot += Ld;
      } else if (!stretches || node.quadratic.direction[g] == 2) {
        mz += Lq;
        mz_dot += Ld;
      } else {
        mx += Lq;
        mx_dot += Ld;
      }
    }
    typename Sp::Lin mk{rest.x, rest.y + my, rest.z + mz};
    if (stretches) mk.x += mx;
    if (node.quadratic.direction[d] == 0) {
      whole.c.x += cl * q[k];
      whole.c_rate.x += cl * dq[k];
      whole.xx.xx += q[k] * (rest.x + mk.x);
      whole.xx.xy += q[k] * rest.y;
      whole.xx.xz += q[k] * rest.z;
      whole.Px += dq[k] * mk;
      const S along = w.x * Sp::dot(w, mk) - Sp::dot(w, w) * mk.x;
      out.e[k] += along + 2.0 * (w.y * mz_dot - w.z * my_dot);
      out.M_er[k].force.x += cl;
      out.M_er[k].moment.y += mk.z;
      out.M_er[k].moment.z -= mk.y;
    } else if (node.quadratic.direction[d] == 1) {
      whole.c.y += cl * q[k];
      whole.c_rate.y += cl * dq[k];
      whole.xx.xy += q[k] * mk.x;
      whole.xx.yy += q[k] * (rest.y + mk.y);
      whole.xx.yz += q[k] * mk.z;
      whole.Py += dq[k] * mk;
      const S across = w.y * Sp::dot(w, mk) - Sp::dot(w, w) * mk.y;
      out.e[k] += across - 2.0 * w.x * mz_dot;
      if (stretches) out.e[k] += 2.0 * w.z * mx_dot;
      out.M_er[k].force.y += cl;
      out.M_er[k].moment.x -= mk.z;
      out.M_er[k].moment.z += mk.x;
    } else {
      whole.c.z += cl * q[k];
      whole.c_rate.z += cl * dq[k];
      whole.xx.xz += q[k] * mk.x;
      whole.xx.zz += q[k] * (rest.z + mk.z);
      whole.xx.yz += q[k] * rest.y;
      whole.Pz += dq[k] * mk;
      const S across = w.z * Sp::dot(w, mk) - Sp::dot(w, w) * mk.z;
      out.e[k] += across + 2.0 * w.x * my_dot;
      if (stretches) out.e[k] -= 2.0 * w.y * mx_dot;
      out.M_er[k].force.z += cl;
      out.M_er[k].moment.x += mk.y;
      out.M_er[k].moment.y -= mk.x;
    }
  }
}

/// Adds the parts linear in q, and the body that does not bend, to the sums (Eq. 80, 81).
template <class S>
void finish(const Node& node, const double* p, const S* q, const S* dq, const typename Space<S>::Ang& w,
            Sums<Space<S>> sums, typename Space<S>::Rigid& M, Force<Space<S>>& F, Elastic<Space<S>>& out) {
  using Sp = Space<S>;
  using Lin = typename Sp::Lin;
  const Moments<Sp>& body = *sums.body;
  for (int k = 0; k < node.ne; ++k) {
    out.e[k] = sums.e[k];
    out.M_er[k].force = sums.M_linear[k];
    out.M_er[k].moment = sums.M_angular[k];
  }
  const auto [m, c, J_rest] = read<records::Body<Sp>>(p);
  Whole<Sp> whole{c + body.c, body.c_rate, body.xx, Sp::zero(), Sp::zero(), Sp::zero()};
  add_linear(node, p, q, dq, w, whole, out);
  const typename Sp::Sym& xx = whole.xx;
  const S trace = xx.xx + xx.yy + xx.zz;
  typename Sp::Sym J{J_rest.xx + trace - xx.xx, J_rest.yy + trace - xx.yy, J_rest.zz + trace - xx.zz,
                     J_rest.xy - xx.xy,         J_rest.xz - xx.xz,         J_rest.yz - xx.yz};
  // the sections' turns have gyroscopic moments of their own: only J of the carried masses goes into w x J w
  const Lin h = Sp::apply(J, w);
  const S tr = whole.Py.y + whole.Pz.z;
  F.moment = Sp::cross(w, h) + body.n + body.n_turn +
             number<S>(2.0) * (tr * w - Lin{S{}, Sp::dot(whole.Py, w), Sp::dot(whole.Pz, w)});
  if (node.stretching > 0) F.moment += number<S>(2.0) * (whole.Px.x * w - Lin{Sp::dot(whole.Px, w), S{}, S{}});
  F.force = Sp::cross(w, Sp::cross(w, whole.c)) + number<S>(2.0) * Sp::cross(w, whole.c_rate) + body.bias;
  Sp::add(J, body.J_turn);
  M = {m, whole.c, J};
  finish_elastic(node, p, sums.M, q, dq, out);
}

}  // namespace quadratic
}  // namespace
