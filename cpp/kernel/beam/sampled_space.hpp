// The sampled body in space. Exact: R' = R K~ (Eq. 25), x' = R (e1 + phi) (Eq. 24). Lengths of integrals are parts of
// the beam's: K is the turn over the whole length.
#pragma once

#include "beam/third_order.hpp"

namespace {
namespace sampled {

// --- Exact. ---

/// J_R' = R dK/dq, and with Omega = J_R dq its convective part Omega x R dK (Eq. 39, 40).
template <class S, class P>
void turn_jacobians(const Node& node, const Rows<Space<P>>& rows, const Integral<S, P>& integral, const S* dq,
                    const SpaceSeries<P>& s) {
  using Sp = Space<P>;
  integral(
      3 * node.sampled.turning,
      [&](int c) {
        const P* axis = s.R[node.about[c / 3]].column(c % 3);
        return [=, &rows](int i) { return rows.shape(c / 3, i) * axis[i]; };
      },
      s.turned.first.at, s.turned.first.stride);
  for (int k = node.sampled.turning; k < node.ne; ++k) s.turned.by(k).clear(0, rows.points);
  for (int i = 0; i < rows.points; ++i) {
    auto spin = Sp::zero();
    for (int k = 0; k < node.sampled.turning; ++k) spin += widen(dq[k], P{}) * s.turned.by(k)(i);
    const auto K = s.K_rate(i);
    s.spin.set(i, spin);
    s.spin_bias_slope.set(i, Sp::cross(spin, K.x * s.R[0](i) + K.y * s.R[1](i) + K.z * s.R[2](i)));
  }
  integral(3, columns_of(s.spin_bias_slope), s.turned.bias.at, s.turned.bias.stride);
}

/// x' = R (e1 + phi), and the convective part of its second rate.
template <class P>
void exact_tangent(const Node& node, const Rows<Space<P>>& rows, const SpaceSeries<P>& s) {
  using Sp = Space<P>;
  const bool shears = node.sampled.turning < node.ne;  // or stretches
  for (int i = 0; i < rows.points; ++i) {
    const auto w = s.spin(i);
    auto t = rows.span.length * s.R[0](i), rate = Sp::zero();
    if (shears) {
      const auto g = s.shear(i), g_rate = s.shear_rate(i);
      t += g.y * s.R[1](i) + g.z * s.R[2](i);
      rate = g_rate.y * s.R[1](i) + g_rate.z * s.R[2](i);
      if (node.stretching > 0) {
        t += g.x * s.R[0](i);
        rate += g_rate.x * s.R[0](i);
      }
    }
    s.tangent.value.set(i, t);
    s.tangent.bias.set(i, Sp::cross(s.turned.bias(i), t) + Sp::cross(w, Sp::cross(w, t) + number<P>(2.0) * rate));
  }
}

/// Places at the points and their Jacobians: J_X' = J_R x x' + R dphi/dq (Eq. 37).
template <class S, class P>
void exact_places(const Node& node, const Rows<Space<P>>& rows, const Integral<S, P>& integral,
                  const SpaceSeries<P>& s) {
  const int stride = s.place.value.stride;
  integral(6, columns_of(s.tangent.value), s.place.value.at, stride);  // and of the bias
  integral(
      3 * node.sampled.turning,
      [&](int c) {
        const int d = (c + 1) % 3, e = (c + 2) % 3;
        const Field<Space<P>> J = s.turned.by(c / 3);
        const P *Jd = J.column(d), *Je = J.column(e), *td = s.tangent.value.column(d), *te = s.tangent.value.column(e);
        return [=](int i) { return Jd[i] * te[i] - Je[i] * td[i]; };
      },
      s.place.first.at, stride);
  integral(
      3 * (node.ne - node.sampled.turning),
      [&](int c) {
        const int k = node.sampled.turning + c / 3;
        const P* axis = s.R[node.about[k]].column(c % 3);
        return [=, &rows](int i) { return rows.shape(k, i) * axis[i]; };
      },
      s.place.by(node.sampled.turning).at, stride);
}

// --- Both. ---

/// Adds the curvature at rest to K, and starts the rotation there: R = P R_rest, with P' P^-1 of R_rest
/// K.
template <class P>
void add_rest(const Node& node, const Rows<Space<P>>& rows, const SpaceSeries<P>& s) {
  if (node.sampled.uniaxial) {
    for (int i = 0; i < rows.points; ++i) s.theta.column(node.about[0])[i] += rows.at_rest(0, i);
    return;
  }
  using Sp = Space<P>;
  const Field<Sp> D{s.term.at, s.term.stride};
  for (int i = 0; i < rows.points; ++i) {
    const Quaternion<P> p{1.0 + rows.at_rest(3, i), {rows.at_rest(4, i), rows.at_rest(5, i), rows.at_rest(6, i)}};
    s.p.set(i, p);
    D.set(i, number<P>(0.5) * Sp::rotate(rotation_of(p), s.K(i)));
    s.K.set(i, s.K(i) + typename Sp::Lin{rows.at_rest(0, i), rows.at_rest(1, i), rows.at_rest(2, i)});
  }
}

/// Fills the series that slices are sums of.
template <class S, class P>
void sample(Space<S>, const Node& node, const double* points, const S* q, const S* dq, P* scratch) {
  SpaceSeries<P> s(node, scratch);
  const Rows<Space<P>> rows(node, points);
  const Integral<S, P> integral(node.sampled.table, node.sampled.half, node.passes, s.end);
  add_strains(node, rows, q, dq, s);
  if (!node.sampled.exact) return sample_order_3(node, rows, integral, dq, s);
  if (node.sampled.curved) add_rest(node, rows, s);
  if (node.sampled.uniaxial)
    turn_about_axis(s.theta, node.about[0], rows.points, s.p);
  else
    solve_rotation(s.K, s.theta, rows.points, integral, node.sampled.curved, s.p, s.term, s.factor);
  for (int i = 0; i < rows.points; ++i) {
    const auto R = rotation_of(s.p(i));
    s.R[0].set(i, {R.xx, R.yx, R.zx});
    s.R[1].set(i, {R.xy, R.yy, R.zy});
    s.R[2].set(i, {R.xz, R.yz, R.zz});
  }
  turn_jacobians(node, rows, integral, dq, s);
  exact_tangent(node, rows, s);
}

/// Places at the points and their Jacobians; and at order 3 rotations.
template <class S, class P>
void place_points(const Node& node, const Rows<Space<P>>& rows, const S* dq, const SpaceSeries<P>& s, P* work) {
  const Integral<S, P> integral(node.sampled.table, node.sampled.half, node.passes, work);
  if (node.sampled.exact)
    exact_places(node, rows, integral, s);
  else
    third_order_places(node, rows, integral, dq, s);
  for (int i = 0; i < rows.points; ++i) s.place.value.set(i, rows.span.origin + s.place.value(i));
}

/// The slice at the end, after `place_points`.
template <class S, class P>
void end_slice(const Node& node, const Rows<Space<P>>&, const S*, const S* dq, const SpaceSeries<P>& s,
               Slice<Space<S>>& out) {
  using Sp = Space<S>;
  const int end = end_point<S, P>(node);
  out.frame.r = get_lane(Sp{}, s.place.value, end);
  out.bias.linear = get_lane(Sp{}, s.place.bias, end);
  out.rate.angular = get_lane(Sp{}, s.spin, end);
  out.bias.angular = get_lane(Sp{}, s.turned.bias, end);
  out.rate.linear = Sp::zero();
  for (int k = 0; k < node.ne; ++k) {
    out.J[k].linear = get_lane(Sp{}, s.place.by(k), end);
    out.J[k].angular = get_lane(Sp{}, s.turned.by(k), end);
    out.rate.linear += dq[k] * out.J[k].linear;
  }
  const auto x = get_lane(Sp{}, s.R[0], end), y = get_lane(Sp{}, s.R[1], end), z = get_lane(Sp{}, s.R[2], end);
  out.frame.R = {x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z};
}

/// Puts a slice where the sums read it, as station `i`.
template <class S, class P>
void put_slice(const Slice<Space<S>>& slice, int ne, int i, const SpaceSeries<P>& s) {
  using Lin = typename Space<S>::Lin;
  const auto& R = slice.frame.R;
  put_lane(Space<S>{}, s.place.value, i, slice.frame.r);
  put_lane(Space<S>{}, s.place.bias, i, slice.bias.linear);
  put_lane(Space<S>{}, s.spin, i, slice.rate.angular);
  put_lane(Space<S>{}, s.turned.bias, i, slice.bias.angular);
  put_lane(Space<S>{}, s.R[0], i, Lin{R.xx, R.yx, R.zx});
  put_lane(Space<S>{}, s.R[1], i, Lin{R.xy, R.yy, R.zy});
  put_lane(Space<S>{}, s.R[2], i, Lin{R.xz, R.yz, R.zz});
  for (int k = 0; k < ne; ++k) {
    put_lane(Space<S>{}, s.place.by(k), i, slice.J[k].linear);
    put_lane(Space<S>{}, s.turned.by(k), i, slice.J[k].angular);
  }
}
template <class P>
void clear_stations(const Node& node, int from, int to, const SpaceSeries<P>& s) {
  for (const auto& f : s.R) f.clear(from, to);
  s.spin.clear(from, to);
  clear_stations(s.place, node.ne, from, to);
  clear_stations(s.turned, node.ne, from, to);
}

/// A slice of which `p` are the numbers, after `sample`; goes on beyond them.
template <class S, class P>
void move_slice(const Node& node, const double*& p, const double* points, const S* q, const S* dq, P* scratch,
                Slice<Space<S>>& out) {
  using Sp = Space<S>;
  using Lin = typename Space<P>::Lin;
  const SpaceSeries<P> s(node, scratch);
  const Rows<Space<P>> rows(node, points);
  const int ne = node.ne;
  out.frame.r = Sp::read(p);
  // sums by the weights of the integral from 0 to X: of x' and its bias, theta' (or the quaternion's slope) and its
  // bias, then of derivatives of x' and theta'
  Lin* sum = view<Lin>(s.end);
  for (int k = 0; k < 5 + 2 * ne; ++k) sum[k] = Space<P>::zero();
  for (int i = 0; i < rows.points; ++i) {
    const P w = next<P>(p);
    const Lin t = w * s.tangent.value(i);
    sum[0] += t;
    sum[1] += w * s.tangent.bias(i);
    if (!node.sampled.exact) {
      sum[2] += w * s.twist.value(i);
      sum[3] += w * s.twist.bias(i);
      for (int k = 0; k < ne; ++k) {
        sum[5 + k] += w * s.tangent.by(k)(i);
        sum[5 + ne + k] += w * s.twist.by(k)(i);
      }
      continue;
    }
    const Quaternion<P> slope = slope_of(s.p(i), s.K(i));
    sum[2] += w * slope.v;
    sum[4].x += w * slope.w;
    sum[3] += w * s.spin_bias_slope(i);
    for (int k = 0; k < ne; ++k) {
      const Lin turn = (w * rows.shape(k, i)) * s.R[node.about[k]](i);
      if (k < node.sampled.turning) {
        sum[5 + k] += Space<P>::cross(s.turned.by(k)(i), t);
        sum[5 + ne + k] += turn;
      } else {
        sum[5 + k] += turn;
      }
    }
  }
  S* total = view<S>(s.end);
  sum_lanes(s.end, 3 * (5 + 2 * ne), total);
  const auto of = [&](int k) { return typename Sp::Lin{total[3 * k], total[3 * k + 1], total[3 * k + 2]}; };
  out.frame.r += of(0);
  out.bias.linear = of(1);
  out.rate.linear = out.rate.angular = Sp::zero();
  for (int k = 0; k < ne; ++k) {
    out.J[k].linear = of(5 + k);
    out.J[k].angular = of(5 + ne + k);
    out.rate.linear += dq[k] * out.J[k].linear;
    out.rate.angular += dq[k] * out.J[k].angular;
  }
  out.bias.angular = of(3);
  if (!node.sampled.exact) {
    const Turned<S> turned(of(2));
    out.frame.R = turned.rotation();
    out.bias.angular = turned.bias(out.rate.angular, out.bias.angular, 1.0);
    out.rate.angular = turned.jacobian(out.rate.angular, 1.0);
    for (int k = 0; k < ne; ++k) out.J[k].angular = turned.jacobian(out.J[k].angular, 1.0);
  } else if (node.sampled.uniaxial) {
    S turn{}, sine, cosine;
    if (node.sampled.curved) turn = next<S>(p);
    for (int k = 0; k < node.sampled.turning; ++k) turn += next<S>(p) * q[k];
    sine_cosine(turn, sine, cosine);
    out.frame.R = Sp::turn(node.about[0], sine, cosine);
  } else {
    out.frame.R = rotation_of(Quaternion<S>{1.0 + total[12], of(2)});
  }
}

}  // namespace sampled
}  // namespace
