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

/// Numbers P that `bend` needs to work on.
inline std::size_t quadratic_scratch(const Node& node) {
  const std::size_t ne = static_cast<std::size_t>(node.ne),
                    points = static_cast<std::size_t>(node.passes + node.rotary);
  return 32 + 8 * ne + ne * (ne + 1) / 2 + points * (3 * ne + 12);
}

// --- In the plane: y has no quadratic part, so that only the pairings with x need points. ---

template <class S, class P>
void bend(const Node& node, const double* constants, const double* points, const S* q, const S* dq,
          const typename Plane<S>::Ang& spin, typename Plane<S>::Rigid& M, typename Plane<S>::Lin& f,
          typename Plane<S>::Ang& n, Elastic<Plane<S>>& out, P* scratch) {
  using Sp = Plane<S>;
  const int ne = node.ne, pairs = ne * (ne + 1) / 2;
  const S w = spin.z;
  const double* p = constants;
  // sums over points: c, its rate, b; J; n; then e, Mre (linear x, angular), Mee
  enum { at_c, at_rate, at_b, at_J, at_n, at_lists };
  P* sums = scratch;
  S* sum = reinterpret_cast<S*>(scratch);
  const int n_sums = at_lists + 3 * ne + pairs;
  if (node.passes > 0) {
    P* g = sums + n_sums;  // slopes, all points
    const P wp = widen(w, P{});
    P c{}, rate{}, b_sum{}, J{}, n_sum{};
    for (int k = 0; k < 3 * ne; ++k) sums[at_lists + k] = P{};
    const double* t = points;
    for (int a = 0; a < node.passes; ++a) {
      P* ga = g + a;  // by coordinates, in strides of the number of points
      for (int k = 0; k < ne; ++k) ga[k * node.passes] = P{};
      const P one = next<P>(t), X = next<P>(t), Y = next<P>(t);
      const double* l = t;
      P y = Y, y_dot{};
      for (int k = 0; k < ne; ++k) {
        const P lk = next<P>(t);
        y += lk * widen(q[k], P{});
        y_dot += lk * widen(dq[k], P{});
      }
      P s{}, b{}, s_dot{};
      for (int k = 0; k < node.position_blocks; ++k) add_block(node.block[k], t, q, dq, s, b, ga, node.passes);
      for (int k = 0; k < ne; ++k) s_dot += ga[k * node.passes] * widen(dq[k], P{});
      const P x = X + s, push = 2.0 * (wp * s_dot);
      const P acc = b - wp * (wp * x + 2.0 * y_dot);
      c += one * s;
      rate += one * s_dot;
      b_sum += one * b;
      J += (X + x) * s;
      n_sum += x * push - y * b;
      for (int k = 0; k < ne; ++k) {
        const P lk = next<P>(l);
        const P gk = ga[k * node.passes];
        sums[at_lists + k] += gk * acc + lk * push;
        sums[at_lists + ne + k] += one * gk;
        sums[at_lists + 2 * ne + k] += s * lk - y * gk;
      }
    }
    sums[at_c] = c;
    sums[at_rate] = rate;
    sums[at_b] = b_sum;
    sums[at_J] = J;
    sums[at_n] = n_sum;
    products(g, ne, node.passes, sums + at_lists + 3 * ne);
    sum_lanes(sums, n_sums, sum);
  } else {
    for (int k = 0; k < n_sums; ++k) sum[k] = S{};
  }
  const S* lists = sum + at_lists;
  const S m = next<S>(p);
  typename Sp::Lin c = Sp::read(p);
  typename Sp::Sym J = Sp::read_symmetric(p);
  c.x += sum[at_c];
  J.zz += sum[at_J];
  S c_y_rate{}, swirl{};
  // linear in q: c_y, and the matrix of y with y
  for (int k = 0; k < ne; ++k) {
    const S cl = next<S>(p), ex = next<S>(p), ey = next<S>(p), rotary = next<S>(p);
    S my = ey, my_dot{};
    for (int j = 0; j < ne; ++j) {
      const S L = next<S>(p);
      my += L * q[j];
      my_dot += L * dq[j];
    }
    c.y += cl * q[k];
    c_y_rate += cl * dq[k];
    J.zz += q[k] * (ey + my);
    swirl += dq[k] * my;
    out.e[k] = lists[k] - w * w * my;
    out.M_linear[k] = {lists[ne + k], cl};
    out.M_angular[k] = {ex + rotary + lists[2 * ne + k]};
  }
  for (int k = 0; k < pairs; ++k) out.M[k] = next<S>(p) + lists[3 * ne + k];
  out.constants = p;
  M = {m, c, J};
  const S ww = w * w, w2 = 2.0 * w;
  f = {sum[at_b] - ww * c.x - w2 * c_y_rate, w2 * sum[at_rate] - ww * c.y};
  n = {w2 * swirl + sum[at_n]};
  add_elastic_forces(node, p, q, dq, out.e);
}

/// A slice of which `p` are the numbers; without `rates`, its place and Jacobian alone.
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

// --- In space. ---

template <class S>
struct Turned {  // theta, its slopes taken through the left Jacobian I + b t~ + c t~^2 (or the right one: sign -1)
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

template <class S, class P>
void bend(const Node& node, const double* constants, const double* points, const S* q, const S* dq,
          const typename Space<S>::Ang& w, typename Space<S>::Rigid& M, typename Space<S>::Lin& f,
          typename Space<S>::Ang& n, Elastic<Space<S>>& out, P* scratch) {
  using Sp = Space<S>;
  using Pt = Space<P>;
  using PLin = typename Pt::Lin;
  const int ne = node.ne, pairs = ne * (ne + 1) / 2, rows = 3 * (node.passes + node.rotary);
  // sums: c, its rate, b; second moments (xx yy zz xy xz yz); n; J and n of rotation; then e, Mre (linear, angular),
  // Mee
  enum { at_c = 0, at_rate = 3, at_b = 6, at_x = 9, at_n = 15, at_J = 18, at_turn = 24, at_lists = 27 };
  const int n_sums = at_lists + 7 * ne + pairs;
  P* sums = scratch;
  S* sum = reinterpret_cast<S*>(scratch);
  P* F = sums + n_sums;    // slopes by row and coordinate
  P* acc = F + rows * ne;  // accelerations by row
  P* place = acc + rows;   // of a position: one, x; of a rotation: R times the root of the inertia
  const PLin wp{widen(w.x, P{}), widen(w.y, P{}), widen(w.z, P{})};
  PLin c = Pt::zero(), rate = c, b_sum = c, n_sum = c, turn_sum = c;
  typename Pt::Sym xx = Pt::none(), J_turn = xx;
  const double* t = points;
  for (int a = 0; a < node.passes; ++a) {
    P* Fa = F + 3 * a;
    for (int k = 0; k < ne; ++k)
      for (int r = 0; r < 3; ++r) Fa[k * rows + r] = P{};
    const P one = next<P>(t);
    P x[3], b[3] = {P{}, P{}, P{}}, u[3] = {P{}, P{}, P{}};
    for (P& xi : x) xi = next<P>(t);
    for (int d = 0; d < node.directed; ++d) {
      const P l = next<P>(t);
      const int k = node.which[d], row = node.direction[d];
      x[row] += l * widen(q[k], P{});
      Fa[k * rows + row] = l;
    }
    for (int k = 0; k < node.position_blocks; ++k) {
      const Block& block = node.block[k];
      add_block(block, t, q, dq, x[block.row], b[block.row], Fa + block.row, rows);
    }
    for (int k = 0; k < ne; ++k)
      for (int r = 0; r < 3; ++r) u[r] += Fa[k * rows + r] * widen(dq[k], P{});
    const PLin at{x[0], x[1], x[2]}, u_dot{u[0], u[1], u[2]}, u_bias{b[0], b[1], b[2]};
    const PLin drift = number<P>(2.0) * Pt::cross(wp, u_dot) + u_bias;
    const PLin field = Pt::cross(wp, Pt::cross(wp, at)) + drift;
    acc[3 * a] = field.x;
    acc[3 * a + 1] = field.y;
    acc[3 * a + 2] = field.z;
    P* pl = place + 9 * a;
    pl[0] = one;
    pl[1] = at.x;
    pl[2] = at.y;
    pl[3] = at.z;
    c += one * at;
    rate += one * u_dot;
    b_sum += one * u_bias;
    xx.xx += at.x * at.x;
    xx.yy += at.y * at.y;
    xx.zz += at.z * at.z;
    xx.xy += at.x * at.y;
    xx.xz += at.x * at.z;
    xx.yz += at.y * at.z;
    n_sum += Pt::cross(at, drift);
  }
  for (int a = 0; a < node.rotary; ++a) {
    const int row = 3 * (node.passes + a);
    P* Fa = F + row;
    const PLin root = Pt::read(t), gyro = Pt::read(t);
    P th[3] = {P{}, P{}, P{}}, b[3] = {P{}, P{}, P{}}, d[3] = {P{}, P{}, P{}};
    for (int k = 0; k < ne; ++k) {
      const P l = next<P>(t);
      P* Fk = Fa + k * rows;
      Fk[0] = Fk[1] = Fk[2] = P{};
      Fk[node.about[k]] = l;
      th[node.about[k]] += l * widen(q[k], P{});
    }
    for (int k = node.position_blocks; k < node.blocks; ++k) {
      const Block& block = node.block[k];
      const int r = block.row - 3;
      add_block(block, t, q, dq, th[r], b[r], Fa + r, rows);
    }
    const Turned<P> turned(PLin{th[0], th[1], th[2]});
    for (int k = 0; k < ne; ++k) {
      const P qd = widen(dq[k], P{});
      P* Fk = Fa + k * rows;
      for (int r = 0; r < 3; ++r) d[r] += Fk[r] * qd;
      const PLin j = turned.jacobian({Fk[0], Fk[1], Fk[2]}, -1.0);
      Fk[0] = root.x * j.x;
      Fk[1] = root.y * j.y;
      Fk[2] = root.z * j.z;
    }
    const PLin th_dot{d[0], d[1], d[2]};
    const typename Pt::Rot R = turned.rotation();
    // in slice axes: carried and own angular velocity, and the rate of their sum with accelerations left out
    const PLin carried = Pt::unrotate(R, wp), own = turned.jacobian(th_dot, -1.0), W = carried + own;
    const PLin W_dot = Pt::cross(carried, own) + turned.bias(th_dot, {b[0], b[1], b[2]}, -1.0);
    const PLin tau{root.x * W_dot.x + gyro.x * (W.y * W.z), root.y * W_dot.y + gyro.y * (W.z * W.x),
                   root.z * W_dot.z + gyro.z * (W.x * W.y)};
    const typename Pt::Rot B{R.xx * root.x, R.xy * root.y, R.xz * root.z, R.yx * root.x, R.yy * root.y,
                             R.yz * root.z, R.zx * root.x, R.zy * root.y, R.zz * root.z};
    acc[row] = tau.x;
    acc[row + 1] = tau.y;
    acc[row + 2] = tau.z;
    P* pl = place + 9 * (node.passes + a);
    __builtin_memcpy(pl, &B, sizeof(B));
    const typename Pt::Rot BB = Pt::times_transposed(B, B);
    J_turn.xx += BB.xx;
    J_turn.yy += BB.yy;
    J_turn.zz += BB.zz;
    J_turn.xy += BB.xy;
    J_turn.xz += BB.xz;
    J_turn.yz += BB.yz;
    turn_sum += Pt::rotate(B, tau);
  }
  const auto keep = [&](int i, const auto& x) { __builtin_memcpy(sums + i, &x, sizeof(x)); };
  keep(at_c, c);
  keep(at_rate, rate);
  keep(at_b, b_sum);
  keep(at_x, xx);
  keep(at_n, n_sum);
  keep(at_J, J_turn);
  keep(at_turn, turn_sum);
  for (int k = 0; k < ne; ++k) {
    const P* Fk = F + k * rows;
    P e{};
    PLin ml = Pt::zero(), ma = Pt::zero();
    for (int r = 0; r < rows; ++r) e += Fk[r] * acc[r];
    for (int a = 0; a < node.passes; ++a) {
      const P *pl = place + 9 * a, *f3 = Fk + 3 * a;
      const PLin slope{f3[0], f3[1], f3[2]};
      ml += pl[0] * slope;
      ma += Pt::cross({pl[1], pl[2], pl[3]}, slope);
    }
    for (int a = node.passes; a < node.passes + node.rotary; ++a) {
      const P *B = place + 9 * a, *f3 = Fk + 3 * a;
      ma += PLin{B[0] * f3[0] + B[1] * f3[1] + B[2] * f3[2], B[3] * f3[0] + B[4] * f3[1] + B[5] * f3[2],
                 B[6] * f3[0] + B[7] * f3[1] + B[8] * f3[2]};
    }
    sums[at_lists + k] = e;
    keep(at_lists + ne + 3 * k, ml);
    keep(at_lists + 4 * ne + 3 * k, ma);
  }
  products(F, ne, rows, sums + at_lists + 7 * ne);
  sum_lanes(sums, n_sums, sum);

  // what is left over of the functions linear in q, and the body that does not bend
  const double* p = constants;
  const S m = next<S>(p);
  typename Sp::Lin centre = Sp::read(p) + typename Sp::Lin{sum[0], sum[1], sum[2]};
  typename Sp::Lin centre_rate{sum[3], sum[4], sum[5]};
  typename Sp::Sym J = Sp::read_symmetric(p);
  typename Sp::Sym Q{sum[9], sum[10], sum[11], sum[12], sum[13], sum[14]};  // second moments
  for (int k = 0; k < ne; ++k) {
    __builtin_memcpy(&out.M_linear[k], sum + at_lists + ne + 3 * k, sizeof(typename Sp::Lin));
    __builtin_memcpy(&out.M_angular[k], sum + at_lists + 4 * ne + 3 * k, sizeof(typename Sp::Lin));
    out.e[k] = sum[at_lists + k];
  }
  typename Sp::Lin Py = Sp::zero(), Pz = Sp::zero();
  for (int d = 0; d < node.directed; ++d) {
    const int k = node.which[d];
    const S cl = next<S>(p);
    const typename Sp::Lin rest = Sp::read(p);
    S my{}, mz{}, my_dot{}, mz_dot{};
    for (int g = 0; g < node.directed; ++g) {
      const S L = next<S>(p), Lq = L * q[node.which[g]], Ld = L * dq[node.which[g]];
      if (node.direction[g] == 1) {
        my += Lq;
        my_dot += Ld;
      } else {
        mz += Lq;
        mz_dot += Ld;
      }
    }
    const typename Sp::Lin mk{rest.x, rest.y + my, rest.z + mz};
    if (node.direction[d] == 1) {
      centre.y += cl * q[k];
      centre_rate.y += cl * dq[k];
      Q.xy += q[k] * rest.x;
      Q.yy += q[k] * (rest.y + mk.y);
      Q.yz += q[k] * mk.z;
      Py += dq[k] * mk;
      const S across = w.y * Sp::dot(w, mk) - Sp::dot(w, w) * mk.y;
      out.e[k] += across - 2.0 * w.x * mz_dot;
      out.M_linear[k].y += cl;
      out.M_angular[k].x -= mk.z;
      out.M_angular[k].z += mk.x;
    } else {
      centre.z += cl * q[k];
      centre_rate.z += cl * dq[k];
      Q.xz += q[k] * rest.x;
      Q.zz += q[k] * (rest.z + mk.z);
      Q.yz += q[k] * rest.y;
      Pz += dq[k] * mk;
      const S across = w.z * Sp::dot(w, mk) - Sp::dot(w, w) * mk.z;
      out.e[k] += across + 2.0 * w.x * my_dot;
      out.M_linear[k].z += cl;
      out.M_angular[k].x += mk.y;
      out.M_angular[k].y -= mk.x;
    }
  }
  for (int k = 0; k < pairs; ++k) out.M[k] = next<S>(p) + sum[at_lists + 7 * ne + k];
  out.constants = p;
  const S trace = Q.xx + Q.yy + Q.zz;
  J = {J.xx + trace - Q.xx, J.yy + trace - Q.yy, J.zz + trace - Q.zz, J.xy - Q.xy, J.xz - Q.xz, J.yz - Q.yz};
  // the turning of slices brings its own gyroscopic moments: J of what is carried alone goes into w x J w
  const typename Sp::Lin h = Sp::apply(J, w);
  const S tr = Py.y + Pz.z;
  n = Sp::cross(w, h) + typename Sp::Lin{sum[15], sum[16], sum[17]} + typename Sp::Lin{sum[24], sum[25], sum[26]} +
      number<S>(2.0) * (tr * w - typename Sp::Lin{S{}, Sp::dot(Py, w), Sp::dot(Pz, w)});
  f = Sp::cross(w, Sp::cross(w, centre)) + number<S>(2.0) * Sp::cross(w, centre_rate) +
      typename Sp::Lin{sum[6], sum[7], sum[8]};
  Sp::add(J, typename Sp::Sym{sum[18], sum[19], sum[20], sum[21], sum[22], sum[23]});
  M = {m, centre, J};
  add_elastic_forces(node, p, q, dq, out.e);
}

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
