// The elastic body at order 1 and 2: what a link's M_rfr and N_rfr (Eq. 80, 81) are made of.
//
// A slice is at x = e + l q + s, with e the beam at rest, l q what is linear in the elastic coordinates and s what is
// quadratic. All integrals over the beam are of products of two such functions of X. What is linear leaves constant
// matrices, made at set-up. For the rest, set-up has chosen functions of X, orthonormal in the beam's mass, that span
// every s (beam_points.cpp): a "point" is the projection of x on one of them. Points are far fewer than Gauss points,
// and integrals are plain sums over them.
#pragma once

#include "lanes/elastic.hpp"

namespace {

/// A rotation vector theta, which takes its slopes through the left Jacobian I + b t~ + c t~^2 (or through the right
/// one: sign -1), and its second rate likewise (Eq. 35, 39, 40).
template <class S>
struct Turned {
  typename Space<S>::Lin t;
  Turn<S> k;
  explicit Turned(const typename Space<S>::Lin& t_) : t(t_), k(Space<S>::dot(t_, t_)) {}
  typename Space<S>::Lin jacobian(const typename Space<S>::Lin& y, double sign) const {
    const auto ty = Space<S>::cross(t, y);
    return y + (sign * k.b) * ty + k.c * Space<S>::cross(t, ty);
  }
  typename Space<S>::Lin bias(const typename Space<S>::Lin& rate, const typename Space<S>::Lin& second,
                              double sign) const {
    const auto tt = Space<S>::cross(t, rate);
    const S s_dot = 2.0 * Space<S>::dot(t, rate);
    return jacobian(second, sign) + (sign * (k.db * s_dot)) * tt + (k.dc * s_dot) * Space<S>::cross(t, tt) +
           k.c * Space<S>::cross(rate, tt);
  }
  typename Space<S>::Rot rotation() const {
    const S xx = t.x * t.x, yy = t.y * t.y, zz = t.z * t.z, xy = k.b * t.x * t.y, xz = k.b * t.x * t.z,
            yz = k.b * t.y * t.z, x = k.a * t.x, y = k.a * t.y, z = k.a * t.z;
    return {1.0 - k.b * (yy + zz), xy - z, xz + y, xy + z, 1.0 - k.b * (xx + zz), yz - x, xz - y, yz + x,
            1.0 - k.b * (xx + yy)};
  }
};

namespace quadratic {

/// Sums over the points, of the body alone. In the plane, y has no quadratic part: the pairings with x need points.
template <class Sp>
struct Moments;
template <class T>
struct Moments<Plane<T>> {
  using Linear = T;   ///< what points know of a coordinate's first moment: its part along x
  T c, c_rate, bias;  ///< first moment along x, its rate, and the convective part of its second rate
  T J, n;             ///< second moment; moment of the accelerations that velocities give
};
template <class T>
struct Moments<Space<T>> {
  using Linear = typename Space<T>::Lin;
  typename Space<T>::Lin c, c_rate, bias;
  typename Space<T>::Sym xx;  ///< the integral of x x^T
  typename Space<T>::Lin n;
  typename Space<T>::Sym J_turn;  ///< of sections that turn: their own inertia,
  typename Space<T>::Lin n_turn;  ///< and the moment that turns them
};

/// All sums over the points: first packs, and then, in the same place, the sums of their lanes. Functions take it by
/// value: packs may alias anything, and so also pointers that lie in memory.
template <class Sp>
struct Sums {
  using T = typename Sp::Scalar;
  using Body = Moments<Sp>;
  using Linear = typename Body::Linear;
  using Ang = typename Sp::Ang;
  Body* body;
  T* e;              ///< of each coordinate: its force,
  Linear* M_linear;  ///< its coupling with forces
  Ang* M_angular;    ///< and with moments;
  T* M;              ///< of each pair, packed
  int size;          ///< numbers T of all this,
  int forces;        ///< and of what comes before the couplings

  Sums(T* at, int ne) : body(reinterpret_cast<Body*>(at)) {
    e = at + sizeof(Body) / sizeof(T);
    M_linear = reinterpret_cast<Linear*>(e + ne);
    M_angular = reinterpret_cast<Ang*>(M_linear + ne);
    M = reinterpret_cast<T*>(M_angular + ne);
    size = size_of(ne);
    forces = static_cast<int>(sizeof(Body) / sizeof(T)) + ne;
  }
  static int size_of(int ne) {
    return static_cast<int>((sizeof(Body) + static_cast<std::size_t>(ne) * (sizeof(T) + sizeof(Linear) + sizeof(Ang))) /
                            sizeof(T)) +
           packed(ne, 0);
  }
};

/// Where a position was found: what the constant 1 is there, and x.
template <class P>
struct Position {
  P one;
  typename Space<P>::Lin x;
};

/// How scratch is divided: where each part begins, in numbers P, and how many these are in all.
template <class Sp>
struct Parts {
  int rows;       ///< of a coordinate's column of slopes
  int slopes;     ///< columns by coordinate, after the sums
  int forces;     ///< in space: by row, what the accelerations that velocities give ask for;
  int positions;  ///< a Position of each point of position,
  int turns;      ///< and for each of rotation, R times the root of its inertia
  int size;

  explicit Parts(const Node& node) : rows(Sp::planar ? node.passes : 3 * (node.passes + node.rotary)) {
    slopes = Sums<Sp>::size_of(node.ne);
    forces = slopes + rows * node.ne;
    positions = forces + (Sp::planar ? 0 : rows);
    turns = positions + (Sp::planar ? 0 : 4 * node.passes);
    size = turns + (Sp::planar ? 0 : 9 * node.rotary);
  }
};

// --- In the plane. ---

/// Sums over the points of position. Here and below, `again` is for other rates where the body is: what these do not
/// change is left as it is in scratch, and not summed.
template <bool again, class S, class P>
void sum_positions(const Node& node, const double* t, const S* q, const S* dq, const S& w, P* slopes,
                   Sums<Plane<P>> sums) {
  const int ne = node.ne, points = node.passes;
  const P wp = widen(w, P{});
  P c{}, c_rate{}, bias{}, J{}, n{};
  for (int k = 0; k < ne; ++k) sums.e[k] = P{};
  for (int k = 0; k < ne && !again; ++k) sums.M_linear[k] = sums.M_angular[k].z = P{};
  for (int a = 0; a < points; ++a) {
    P* slope = slopes + a;  // by coordinates, in strides of the number of points
    for (int k = 0; k < ne && !again; ++k) slope[k * points] = P{};
    const P one = next<P>(t), X = next<P>(t), Y = next<P>(t);
    const double* l = t;
    P y = Y, y_dot{};
    for (int k = 0; k < ne; ++k) {
      const P lk = next<P>(t);
      y += lk * widen(q[k], P{});
      y_dot += lk * widen(dq[k], P{});
    }
    P s{}, b{}, s_dot{};
    if constexpr (again) {
      for (int k = 0; k < node.position_blocks; ++k) move_block(node.block[k], t, q, dq, s, s_dot, b);
    } else {
      for (int k = 0; k < node.position_blocks; ++k) add_block(node.block[k], t, q, dq, s, b, slope, points);
      for (int k = 0; k < ne; ++k) s_dot += slope[k * points] * widen(dq[k], P{});
    }
    // acceleration along x, and what s adds to it along y (Eq. 45)
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
      if constexpr (again) continue;
      sums.M_linear[k] += one * gk;
      sums.M_angular[k].z += s * lk - y * gk;
    }
  }
  *sums.body = {c, c_rate, bias, J, n};
  if constexpr (!again) products(slopes, ne, points, sums.M);
}

/// Adds what is linear in q, and the body that does not bend, to the sums (Eq. 80, 81).
template <bool again, class S>
void finish(const Node& node, const double* p, const S* q, const S* dq, const S& w, Sums<Plane<S>> sums,
            typename Plane<S>::Rigid& M, typename Plane<S>::Lin& f, typename Plane<S>::Ang& n, Elastic<Plane<S>>& out) {
  using Sp = Plane<S>;
  const Moments<Sp>& body = *sums.body;
  const S m = next<S>(p);
  typename Sp::Lin c = Sp::read(p);
  typename Sp::Sym J = Sp::read_symmetric(p);
  c.x += body.c;
  J.zz += body.J;
  S c_y_rate{}, swirl{};  // the swirl is the integral of y dy/dt
  for (int k = 0; k < node.ne; ++k) {
    const S cl = next<S>(p), ex = next<S>(p), ey = next<S>(p), rotary = next<S>(p);
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
    if constexpr (again) continue;
    out.M_linear[k] = {sums.M_linear[k], cl};
    out.M_angular[k] = {ex + rotary + sums.M_angular[k].z};
  }
  M = {m, c, J};
  const S ww = w * w, w2 = 2.0 * w;
  f = {body.bias - ww * c.x - w2 * c_y_rate, w2 * body.c_rate - ww * c.y};
  n = {w2 * swirl + body.n};
  if constexpr (again) return;
  for (int k = 0; k < packed(node.ne, 0); ++k) out.M[k] = next<S>(p) + sums.M[k];
  out.constants = p;
  add_elastic_forces(node, p, q, dq, out.e);  // Eq. 62
}

// --- In space. ---

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
template <bool again, class S, class P>
void sum_positions(const Node& node, const double*& t, const S* q, const S* dq, const typename Space<P>::Ang& w,
                   Parts<Space<P>> parts, P* scratch, Moments<Space<P>>& sums) {
  using Pt = Space<P>;
  using Lin = typename Pt::Lin;
  const int rows = parts.rows;
  P *slopes = scratch + parts.slopes, *forces = scratch + parts.forces;
  Position<P>* place = reinterpret_cast<Position<P>*>(scratch + parts.positions);
  Lin c = Pt::zero(), c_rate = c, bias = c, n = c;
  typename Pt::Sym xx = Pt::none();
  for (int a = 0; a < node.passes; ++a) {
    P* slope = slopes + 3 * a;
    for (int k = 0; k < node.ne && !again; ++k) put_vector(slope + k * rows, Pt::zero());
    const P one = next<P>(t);
    P x[3], b[3] = {P{}, P{}, P{}}, u[3] = {P{}, P{}, P{}};
    for (P& xi : x) xi = next<P>(t);
    for (int d = 0; d < node.directed; ++d) {
      const P l = next<P>(t);
      const int k = node.which[d], row = node.direction[d];
      x[row] += l * widen(q[k], P{});
      if constexpr (again)
        u[row] += l * widen(dq[k], P{});
      else
        slope[k * rows + row] = l;
    }
    for (int k = 0; k < node.position_blocks; ++k) {
      const Block& block = node.block[k];
      if constexpr (again)
        move_block(block, t, q, dq, x[block.row], u[block.row], b[block.row]);
      else
        add_block(block, t, q, dq, x[block.row], b[block.row], slope + block.row, rows);
    }
    for (int k = 0; k < node.ne && !again; ++k)
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

/// A point of rotation: what it takes to turn the section there, and R times the root of its inertia, from the slopes
/// of its rotation vector, in place of which it leaves the root of its inertia times J_R. All but R is in section axes.
template <bool again, class S, class P>
void turn_section(const Node& node, const double*& t, const S* q, const S* dq, const typename Space<P>::Ang& w,
                  P* slope, int rows, typename Space<P>::Lin& torque, typename Space<P>::Rot& turn) {
  using Pt = Space<P>;
  using Lin = typename Pt::Lin;
  const Lin root = Pt::read(t), gyro = Pt::read(t);
  P theta[3] = {P{}, P{}, P{}}, b[3] = {P{}, P{}, P{}}, d[3] = {P{}, P{}, P{}};
  for (int k = 0; k < node.ne; ++k) {
    const P l = next<P>(t);
    P* column = slope + k * rows;
    theta[node.about[k]] += l * widen(q[k], P{});
    if constexpr (again) {
      d[node.about[k]] += l * widen(dq[k], P{});
    } else {
      put_vector(column, Pt::zero());
      column[node.about[k]] = l;
    }
  }
  for (int k = node.position_blocks; k < node.blocks; ++k) {
    const Block& block = node.block[k];
    const int r = block.row - 3;
    if constexpr (again)
      move_block(block, t, q, dq, theta[r], d[r], b[r]);
    else
      add_block(block, t, q, dq, theta[r], b[r], slope + r, rows);
  }
  const Turned<P> turned(vector_at(theta));
  for (int k = 0; k < node.ne && !again; ++k) {
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
  const Lin W_dot = Pt::cross(carried, own) + turned.bias(theta_dot, vector_at(b), -1.0);
  torque = {root.x * W_dot.x + gyro.x * (W.y * W.z), root.y * W_dot.y + gyro.y * (W.z * W.x),
            root.z * W_dot.z + gyro.z * (W.x * W.y)};
  turn = {R.xx * root.x, R.xy * root.y, R.xz * root.z, R.yx * root.x, R.yy * root.y,
          R.yz * root.z, R.zx * root.x, R.zy * root.y, R.zz * root.z};
}

/// Sums over the points of rotation, which leave their slopes, torques and turns in scratch.
template <bool again, class S, class P>
void sum_rotations(const Node& node, const double* t, const S* q, const S* dq, const typename Space<P>::Ang& w,
                   Parts<Space<P>> parts, P* scratch, Moments<Space<P>>& sums) {
  using Pt = Space<P>;
  typename Pt::Rot* turns = reinterpret_cast<typename Pt::Rot*>(scratch + parts.turns);
  typename Pt::Lin n = Pt::zero();
  typename Pt::Sym J = Pt::none();
  for (int a = 0; a < node.rotary; ++a) {
    const int row = 3 * (node.passes + a);
    typename Pt::Lin torque;
    typename Pt::Rot B;
    turn_section<again>(node, t, q, dq, w, scratch + parts.slopes + row, parts.rows, torque, B);
    put_vector(scratch + parts.forces + row, torque);
    turns[a] = B;
    const typename Pt::Rot BB = Pt::times_transposed(B, B);
    Pt::add(J, typename Pt::Sym{BB.xx, BB.yy, BB.zz, BB.xy, BB.xz, BB.yz});
    n += Pt::rotate(B, torque);
  }
  sums.J_turn = J;
  sums.n_turn = n;
}

/// Sums over the columns that all points left: force and coupling of each coordinate, and inertia of each pair.
template <bool again, class P>
void sum_columns(const Node& node, Parts<Space<P>> parts, const P* scratch, Sums<Space<P>> sums) {
  using Pt = Space<P>;
  using Lin = typename Pt::Lin;
  const P *slopes = scratch + parts.slopes, *forces = scratch + parts.forces;
  const Position<P>* place = reinterpret_cast<const Position<P>*>(scratch + parts.positions);
  const typename Pt::Rot* turns = reinterpret_cast<const typename Pt::Rot*>(scratch + parts.turns);
  for (int k = 0; k < node.ne; ++k) {
    const P *column = slopes + k * parts.rows, *of_turns = column + 3 * node.passes;
    P e{};
    Lin linear = Pt::zero(), angular = linear;
    for (int r = 0; r < parts.rows; ++r) e += column[r] * forces[r];
    sums.e[k] = e;
    if constexpr (again) continue;
    for (int a = 0; a < node.passes; ++a) {
      const Lin slope = vector_at(column + 3 * a);
      linear += place[a].one * slope;
      angular += Pt::cross(place[a].x, slope);
    }
    for (int a = 0; a < node.rotary; ++a) angular += Pt::rotate(turns[a], vector_at(of_turns + 3 * a));
    sums.M_linear[k] = linear;
    sums.M_angular[k] = angular;
  }
  if constexpr (!again) products(slopes, node.ne, parts.rows, sums.M);
}

/// The body without the turning of its sections.
template <class Sp>
struct Whole {
  typename Sp::Lin c, c_rate;   ///< first moment and its rate
  typename Sp::Sym xx;          ///< the integral of x x^T
  typename Sp::Lin Px, Py, Pz;  ///< integrals of x times what is linear in dx/dt, dy/dt, dz/dt
};

/// Adds what points leave over of the functions linear in q: those that displace slices along x, y and z.
template <bool again, class S>
void add_linear(const Node& node, const double*& p, const S* q, const S* dq, const typename Space<S>::Ang& w,
                Whole<Space<S>>& whole, Elastic<Space<S>>& out) {
  using Sp = Space<S>;
  const bool stretches = node.stretching > 0;
  for (int d = 0; d < node.directed; ++d) {
    const int k = node.which[d];
    const S cl = next<S>(p);
    const typename Sp::Lin rest = Sp::read(p);
    S mx{}, my{}, mz{}, mx_dot{}, my_dot{}, mz_dot{};  // l_k is paired with x, y and z here
    for (int g = 0; g < node.directed; ++g) {
      const S L = next<S>(p), Lq = L * q[node.which[g]], Ld = L * dq[node.which[g]];
      if (node.direction[g] == 1) {
        my += Lq;
        my_dot += Ld;
      } else if (!stretches || node.direction[g] == 2) {
        mz += Lq;
        mz_dot += Ld;
      } else {
        mx += Lq;
        mx_dot += Ld;
      }
    }
    typename Sp::Lin mk{rest.x, rest.y + my, rest.z + mz};
    if (stretches) mk.x += mx;
    if (node.direction[d] == 0) {
      whole.c.x += cl * q[k];
      whole.c_rate.x += cl * dq[k];
      whole.xx.xx += q[k] * (rest.x + mk.x);
      whole.xx.xy += q[k] * rest.y;
      whole.xx.xz += q[k] * rest.z;
      whole.Px += dq[k] * mk;
      const S along = w.x * Sp::dot(w, mk) - Sp::dot(w, w) * mk.x;
      out.e[k] += along + 2.0 * (w.y * mz_dot - w.z * my_dot);
      if constexpr (again) continue;
      out.M_linear[k].x += cl;
      out.M_angular[k].y += mk.z;
      out.M_angular[k].z -= mk.y;
    } else if (node.direction[d] == 1) {
      whole.c.y += cl * q[k];
      whole.c_rate.y += cl * dq[k];
      whole.xx.xy += q[k] * mk.x;
      whole.xx.yy += q[k] * (rest.y + mk.y);
      whole.xx.yz += q[k] * mk.z;
      whole.Py += dq[k] * mk;
      const S across = w.y * Sp::dot(w, mk) - Sp::dot(w, w) * mk.y;
      out.e[k] += across - 2.0 * w.x * mz_dot;
      if (stretches) out.e[k] += 2.0 * w.z * mx_dot;
      if constexpr (again) continue;
      out.M_linear[k].y += cl;
      out.M_angular[k].x -= mk.z;
      out.M_angular[k].z += mk.x;
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
      if constexpr (again) continue;
      out.M_linear[k].z += cl;
      out.M_angular[k].x += mk.y;
      out.M_angular[k].y -= mk.x;
    }
  }
}

/// Adds what is linear in q, and the body that does not bend, to the sums (Eq. 80, 81).
template <bool again, class S>
void finish(const Node& node, const double* p, const S* q, const S* dq, const typename Space<S>::Ang& w,
            Sums<Space<S>> sums, typename Space<S>::Rigid& M, typename Space<S>::Lin& f, typename Space<S>::Ang& n,
            Elastic<Space<S>>& out) {
  using Sp = Space<S>;
  using Lin = typename Sp::Lin;
  const Moments<Sp>& body = *sums.body;
  for (int k = 0; k < node.ne; ++k) {
    out.e[k] = sums.e[k];
    if constexpr (again) continue;
    out.M_linear[k] = sums.M_linear[k];
    out.M_angular[k] = sums.M_angular[k];
  }
  const S m = next<S>(p);
  const Lin c = Sp::read(p);
  const typename Sp::Sym J_rest = Sp::read_symmetric(p);
  Whole<Sp> whole{c + body.c, body.c_rate, body.xx, Sp::zero(), Sp::zero(), Sp::zero()};
  add_linear<again>(node, p, q, dq, w, whole, out);
  const typename Sp::Sym& xx = whole.xx;
  const S trace = xx.xx + xx.yy + xx.zz;
  typename Sp::Sym J{J_rest.xx + trace - xx.xx, J_rest.yy + trace - xx.yy, J_rest.zz + trace - xx.zz,
                     J_rest.xy - xx.xy,         J_rest.xz - xx.xz,         J_rest.yz - xx.yz};
  // the turning of sections brings its own gyroscopic moments: J of what is carried alone goes into w x J w
  const Lin h = Sp::apply(J, w);
  const S tr = whole.Py.y + whole.Pz.z;
  n = Sp::cross(w, h) + body.n + body.n_turn +
      number<S>(2.0) * (tr * w - Lin{S{}, Sp::dot(whole.Py, w), Sp::dot(whole.Pz, w)});
  if (node.stretching > 0) n += number<S>(2.0) * (whole.Px.x * w - Lin{Sp::dot(whole.Px, w), S{}, S{}});
  f = Sp::cross(w, Sp::cross(w, whole.c)) + number<S>(2.0) * Sp::cross(w, whole.c_rate) + body.bias;
  Sp::add(J, body.J_turn);
  M = {m, whole.c, J};
  if constexpr (again) return;
  for (int k = 0; k < packed(node.ne, 0); ++k) out.M[k] = next<S>(p) + sums.M[k];
  out.constants = p;
  add_elastic_forces(node, p, q, dq, out.e);  // Eq. 62
}

}  // namespace quadratic

/// Numbers P that `bend` needs to work on in space; in the plane it needs fewer, and so do loads (loads.hpp).
inline std::size_t quadratic_scratch(const Node& node) {
  return static_cast<std::size_t>(quadratic::Parts<Space<double>>(node).size);
}

/// Inertia and inertial force of the body, in a link that turns at w and does not accelerate (Eq. 80, 81). With
/// `again`, of other rates where the body is: forces without the elastic ones, and nothing that rates do not change.
template <bool again = false, class S, class P>
void bend(const Node& node, const double* constants, const double* points, const S* q, const S* dq,
          const typename Plane<S>::Ang& w, typename Plane<S>::Rigid& M, typename Plane<S>::Lin& f,
          typename Plane<S>::Ang& n, Elastic<Plane<S>>& out, P* scratch) {
  const quadratic::Parts<Plane<P>> parts(node);
  const quadratic::Sums<Plane<P>> packs(scratch, node.ne);
  S* lanes = reinterpret_cast<S*>(scratch);
  if (node.passes > 0) {
    quadratic::sum_positions<again>(node, points, q, dq, w.z, scratch + parts.slopes, packs);
    sum_lanes(scratch, again ? packs.forces : packs.size, lanes);
  } else {
    for (int k = 0; k < packs.size; ++k) lanes[k] = S{};
  }
  quadratic::finish<again>(node, constants, q, dq, w.z, quadratic::Sums<Plane<S>>(lanes, node.ne), M, f, n, out);
}

/// The same in space.
template <bool again = false, class S, class P>
void bend(const Node& node, const double* constants, const double* points, const S* q, const S* dq,
          const typename Space<S>::Ang& w, typename Space<S>::Rigid& M, typename Space<S>::Lin& f,
          typename Space<S>::Ang& n, Elastic<Space<S>>& out, P* scratch) {
  const quadratic::Parts<Space<P>> parts(node);
  const quadratic::Sums<Space<P>> packs(scratch, node.ne);
  const typename Space<P>::Ang wp{widen(w.x, P{}), widen(w.y, P{}), widen(w.z, P{})};
  quadratic::sum_positions<again>(node, points, q, dq, wp, parts, scratch, *packs.body);
  quadratic::sum_rotations<again>(node, points, q, dq, wp, parts, scratch, *packs.body);
  quadratic::sum_columns<again>(node, parts, scratch, packs);
  S* lanes = reinterpret_cast<S*>(scratch);
  sum_lanes(scratch, again ? packs.forces : packs.size, lanes);
  quadratic::finish<again>(node, constants, q, dq, w, quadratic::Sums<Space<S>>(lanes, node.ne), M, f, n, out);
}

/// Moves a slice of which `p` are the numbers (Eq. 24, 37, 38; in the plane turns add, so that Eq. 35, 39 are linear);
/// without `rates`, it makes its place and Jacobian alone.
template <bool rates = true, class S>
void move_slice(const Node& node, const double* p, const S* q, const S* dq, Slice<Plane<S>>& out) {
  using Sp = Plane<S>;
  out.x = Sp::read(p);
  S turn{}, rate{}, y_dot{}, slope[kMostElastic], bias{};
  for (int k = 0; k < node.ne; ++k) {
    const S l = next<S>(p), t = next<S>(p);
    slope[k] = S{};
    out.x.y += l * q[k];
    y_dot += l * dq[k];
    turn += t * q[k];
    rate += t * dq[k];
    out.J_linear[k].y = l;
    out.J_angular[k] = {t};
  }
  for (int k = 0; k < node.position_blocks; ++k) add_block<rates>(node.block[k], p, q, dq, out.x.x, bias, slope, 1);
  S x_dot{};
  for (int k = 0; k < node.ne; ++k) {
    out.J_linear[k].x = slope[k];
    x_dot += slope[k] * dq[k];
  }
  S s, c;
  sine_cosine(turn, s, c);
  out.R = {c, s};
  if constexpr (!rates) return;
  out.u_dot = {x_dot, y_dot};
  out.u_bias = {bias, S{}};
  out.turning = {rate};
  out.turn_bias = {S{}};
}

/// The same in space: rows 0 to 2 make the place (Eq. 24, 37, 38), rows 3 to 5 the rotation vector (Eq. 35, 39, 40).
template <bool rates = true, class S>
void move_slice(const Node& node, const double* p, const S* q, const S* dq, Slice<Space<S>>& out) {
  using Sp = Space<S>;
  const int ne = node.ne;
  S slope[6 * kMostElastic], value[6] = {}, bias[6] = {}, rate[6] = {};
  for (int k = 0; k < 6 * ne; ++k) slope[k] = S{};
  for (int r = 0; r < 3; ++r) value[r] = next<S>(p);
  for (int d = 0; d < node.directed; ++d) {
    const S l = next<S>(p);
    slope[node.direction[d] * ne + node.which[d]] = l;
    value[node.direction[d]] += l * q[node.which[d]];
  }
  for (int k = 0; k < ne; ++k) {
    const S l = next<S>(p);
    const int r = 3 + node.about[k];
    slope[r * ne + k] = l;
    value[r] += l * q[k];
  }
  for (int k = 0; k < node.blocks; ++k) {
    const Block& b = node.block[k];
    add_block<rates>(b, p, q, dq, value[b.row], bias[b.row], slope + b.row * ne, 1);
  }
  const Turned<S> turned({value[3], value[4], value[5]});
  out.x = {value[0], value[1], value[2]};
  out.R = turned.rotation();
  if constexpr (rates) {
    for (int r = 0; r < 6; ++r)
      for (int k = 0; k < ne; ++k) rate[r] += slope[r * ne + k] * dq[k];
    const typename Sp::Lin th_dot{rate[3], rate[4], rate[5]};
    out.u_dot = {rate[0], rate[1], rate[2]};
    out.u_bias = {bias[0], bias[1], bias[2]};
    out.turning = turned.jacobian(th_dot, 1.0);
    out.turn_bias = turned.bias(th_dot, {bias[3], bias[4], bias[5]}, 1.0);
  }
  for (int k = 0; k < ne; ++k) {
    out.J_linear[k] = {slope[k], slope[ne + k], slope[2 * ne + k]};
    out.J_angular[k] = turned.jacobian({slope[3 * ne + k], slope[4 * ne + k], slope[5 * ne + k]}, 1.0);
  }
}

}  // namespace
