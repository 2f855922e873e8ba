// The sampled body in the plane: sections turn by b, which is linear in q, and shear by p; the axis stretches by e;
// x' = [f, g](b, p, e).
#pragma once

#include "beam/sampled_sums.hpp"

namespace {
namespace sampled {

/// Fields over the points, in scratch.
template <class P>
struct PlaneSeries {
  using Sp = Plane<P>;
  Field<Sp> tangent, tangent_bias;  ///< x' and the convective part of its second rate
  Field<Sp> by_turn, by_shear;      ///< dx'/db, dx'/dp
  Field<Sp> by_stretch;             ///< dx'/de, where some coordinate stretches
  Jet<Sp> place;                    ///< x, at the stations
  P* end;
  PlaneSeries(const Node& node, P* at) {
    Columns<Sp> columns{at, stride_of(node)};
    tangent = columns.field();
    tangent_bias = columns.field();
    by_turn = columns.field();
    by_shear = columns.field();
    if (node.stretching > 0) by_stretch = columns.field();
    place = columns.jet(node.ne);
    end = columns.at;
  }
  /// dx' by the strain, or the turn, of coordinate k.
  const Field<Sp>& by(const Node& node, int k) const {
    return k < node.sampled.turning ? by_turn : k < node.ne - node.stretching ? by_shear : by_stretch;
  }
};

/// x' = [f, g] of slope b and shear p, and its slopes; `stretch` adds the part of a stretch e.
template <class P>
struct PlanarTangent {
  P f, g, f_b, g_b, f_p, g_p, f_bb, g_bb, f_bp, g_bp;

  PlanarTangent(bool exact, const P& b, const P& p) {
    if (exact) {
      P s, c;
      sine_cosine(b, s, c);
      f = c - p * s;
      g = s + p * c;
      f_p = -s;
      g_p = c;
      f_b = -g;
      g_b = f;
      f_bb = -f;
      g_bb = -g;
      f_bp = -c;
      g_bp = -s;
      return;
    }
    const P bb = b * b, half = 1.0 - 0.5 * bb;  // to third order in all (Eq. 24-27)
    f = half - p * b;
    g = b * (1.0 - bb * (1.0 / 6.0)) + p * half;
    f_p = -b;
    g_p = half;
    f_b = -b - p;
    g_b = f;
    f_bb = number<P>(-1.0);
    g_bb = f_b;
    f_bp = number<P>(-1.0);
    g_bp = -b;
  }

  /// Adds the part of a stretch e: e times [c, s], where p has [-s, c].
  void stretch(bool exact, const P& e) {
    f += e * g_p;
    g -= e * f_p;
    f_b += e * g_bp;
    g_b -= e * f_bp;
    f_bb += e * f_bp;
    if (exact) g_bb += e * g_bp;
  }
};

/// Fills the series: x' and its derivatives at the points.
template <class S, class P>
void sample(Plane<S>, const Node& node, const double* points, const S* q, const S* dq, P* scratch) {
  const PlaneSeries<P> s(node, scratch);
  const Rows<Plane<P>> rows(node, points);
  const int sheared = node.ne - node.stretching;
  for (int i = 0; i < rows.points; ++i) {
    P b{}, p{}, e{}, b_dot{}, p_dot{}, e_dot{};
    if (node.sampled.curved) b = rows.at_rest(0, i);
    for (int k = 0; k < node.sampled.turning; ++k) {
      const P shape = rows.shape(k, i);
      b += shape * widen(q[k], P{});
      b_dot += shape * widen(dq[k], P{});
    }
    for (int k = node.sampled.turning; k < sheared; ++k) {
      const P shape = rows.shape(k, i);
      p += shape * widen(q[k], P{});
      p_dot += shape * widen(dq[k], P{});
    }
    for (int k = sheared; k < node.ne; ++k) {
      const P shape = rows.shape(k, i);
      e += shape * widen(q[k], P{});
      e_dot += shape * widen(dq[k], P{});
    }
    PlanarTangent<P> t(node.sampled.exact, b, p);
    const P& L = rows.span.length;
    if (node.stretching > 0) {
      t.stretch(node.sampled.exact, e);
      s.by_stretch.set(i, {L * t.g_p, -L * t.f_p});
    }
    s.tangent.set(i, {L * t.f, L * t.g});
    s.by_turn.set(i, {L * t.f_b, L * t.g_b});
    s.by_shear.set(i, {L * t.f_p, L * t.g_p});
    const P rate = L * b_dot, twice = 2.0 * p_dot;
    typename Plane<P>::Lin bias{rate * (t.f_bb * b_dot + t.f_bp * twice), rate * (t.g_bb * b_dot + t.g_bp * twice)};
    if (node.stretching > 0) {
      const P swept = 2.0 * (rate * e_dot);
      bias += {swept * t.g_bp, -swept * t.f_bp};
    }
    s.tangent_bias.set(i, bias);
  }
}

/// Places at the points and their Jacobians.
template <class S, class P>
void place_points(const Node& node, const Rows<Plane<P>>& rows, const S*, const PlaneSeries<P>& s, P* work) {
  const Integral<S, P> integral(node.sampled.table, node.sampled.half, node.passes, work);
  const int stride = s.place.value.stride;
  integral(4, columns_of(s.tangent), s.place.value.at, stride);  // and of the bias
  integral(
      2 * node.ne,
      [&](int c) {
        const P* slope = s.by(node, c / 2).column(c % 2);
        return [=, &rows](int i) { return rows.shape(c / 2, i) * slope[i]; };
      },
      s.place.first.at, stride);
  for (int i = 0; i < rows.points; ++i) s.place.value.set(i, rows.span.origin + s.place.value(i));
}

/// Turns a slice by an angle, at its rate.
template <class S>
void turn_slice(const S& turn, const S& rate, Slice<Plane<S>>& out) {
  S sine, cosine;
  sine_cosine(turn, sine, cosine);
  out.frame.R = {cosine, sine};
  out.rate.angular = {rate};
  out.bias.angular = Plane<S>::zero_angular();
}

/// The slice at the end, after `place_points`.
template <class S, class P>
void end_slice(const Node& node, const Rows<Plane<P>>& rows, const S* q, const S* dq, const PlaneSeries<P>& s,
               Slice<Plane<S>>& out) {
  using Sp = Plane<S>;
  const int end = end_point<S, P>(node);
  out.frame.r = get_lane(Sp{}, s.place.value, end);
  out.bias.linear = get_lane(Sp{}, s.place.bias, end);
  out.rate.linear = Sp::zero();
  S turn{}, rate{};
  if (node.sampled.curved) turn = rows.template rest_in_lane<S>(end);
  for (int k = 0; k < node.ne; ++k) {
    out.J[k].linear = get_lane(Sp{}, s.place.by(k), end);
    out.rate.linear += dq[k] * out.J[k].linear;
    out.J[k].angular = Sp::zero_angular();
    if (k >= node.sampled.turning) continue;
    const S t = rows.template shape_in_lane<S>(k, end);
    turn += t * q[k];
    rate += t * dq[k];
    out.J[k].angular = {t};
  }
  turn_slice(turn, rate, out);
}

/// Puts a slice where the sums read it, as station `i`.
template <class S, class P>
void put_slice(const Slice<Plane<S>>& slice, int ne, int i, const PlaneSeries<P>& s) {
  put_lane(Plane<S>{}, s.place.value, i, slice.frame.r);
  put_lane(Plane<S>{}, s.place.bias, i, slice.bias.linear);
  for (int k = 0; k < ne; ++k) put_lane(Plane<S>{}, s.place.by(k), i, slice.J[k].linear);
}
template <class P>
void clear_stations(const Node& node, int from, int to, const PlaneSeries<P>& s) {
  clear_stations(s.place, node.ne, from, to);
}

/// A slice of which `p` are the numbers, after `sample`; goes on beyond them.
template <class S, class P>
void move_slice(const Node& node, const double*& p, const double* points, const S* q, const S* dq, P* scratch,
                Slice<Plane<S>>& out) {
  using Sp = Plane<S>;
  using Lin = typename Plane<P>::Lin;
  const PlaneSeries<P> s(node, scratch);
  const Rows<Plane<P>> rows(node, points);
  out.frame.r = Sp::read(p);
  // sums of x', its bias, and its derivatives, by the weights of the integral from 0 to X (Eq. 24)
  Lin* sum = view<Lin>(s.end);
  for (int k = 0; k < 2 + node.ne; ++k) sum[k] = Plane<P>::zero();
  for (int i = 0; i < rows.points; ++i) {
    const P w = next<P>(p);
    sum[0] += w * s.tangent(i);
    sum[1] += w * s.tangent_bias(i);
    const Lin by_turn = w * s.by_turn(i), by_shear = w * s.by_shear(i);
    const int sheared = node.ne - node.stretching;
    for (int k = 0; k < sheared; ++k) sum[2 + k] += rows.shape(k, i) * (k < node.sampled.turning ? by_turn : by_shear);
    for (int k = sheared; k < node.ne; ++k) sum[2 + k] += rows.shape(k, i) * (w * s.by_stretch(i));
  }
  S* total = view<S>(s.end);
  sum_lanes(s.end, 2 * (2 + node.ne), total);
  const auto of = [&](int k) { return typename Sp::Lin{total[2 * k], total[2 * k + 1]}; };
  out.frame.r += of(0);
  out.bias.linear = of(1);
  out.rate.linear = Sp::zero();
  S turn{}, rate{};
  if (node.sampled.curved) turn = next<S>(p);
  for (int k = 0; k < node.ne; ++k) {
    out.J[k].linear = of(2 + k);
    out.rate.linear += dq[k] * out.J[k].linear;
    const S t = next<S>(p);
    turn += t * q[k];
    rate += t * dq[k];
    out.J[k].angular = {t};
  }
  turn_slice(turn, rate, out);
}

}  // namespace sampled
}  // namespace
