// Order 3 in space: the series of R and x to third order in all (Eq. 24-27), and Magnus' of the rotation vector.
#pragma once

#include "beam/space_series.hpp"

namespace {
namespace sampled {

/// A number along one direction: value and derivative.
template <class P>
struct Along {
  P x, d;
  friend Along operator+(const Along& a, const Along& b) { return {a.x + b.x, a.d + b.d}; }
  friend Along operator-(const Along& a, const Along& b) { return {a.x - b.x, a.d - b.d}; }
  friend Along operator*(const Along& a, const Along& b) { return {a.x * b.x, a.x * b.d + a.d * b.x}; }
};
/// A number in motion: value, rate, and second rate without accelerations.
template <class P>
struct Moving {
  P x, d, b;
  friend Moving operator+(const Moving& a, const Moving& b) { return {a.x + b.x, a.d + b.d, a.b + b.b}; }
  friend Moving operator-(const Moving& a, const Moving& b) { return {a.x - b.x, a.d - b.d, a.b - b.b}; }
  friend Moving operator*(const Moving& a, const Moving& b) {
    return {a.x * b.x, a.x * b.d + a.d * b.x, a.x * b.b + a.b * b.x + 2.0 * (a.d * b.d)};
  }
};

/// The series at one point, of vectors of such numbers.
template <class T, class P>
struct ThirdOrder {
  using Sp = Space<T>;
  using V = typename Sp::Lin;
  V K, theta, shear, theta_2, third;
  P length;

  static T constant(const P& x) {
    T out{};
    out.x = x;
    return out;
  }
  static V times(double k, const V& v) { return constant(number<P>(k)) * v; }
  /// R_2 y, with R_2 = theta~^2 / 2 + theta_2~
  V second(const V& y) const { return times(0.5, Sp::cross(theta, Sp::cross(theta, y))) + Sp::cross(theta_2, y); }
  V e1() const { return {constant(number<P>(1.0)), T{}, T{}}; }
  V theta_2_slope() const { return times(0.5, Sp::cross(theta, K)); }
  /// R_3' e1 = R_2 K~ e1 (Eq. 27)
  V third_slope() const { return second(Sp::cross(K, e1())); }
  /// x' = (I + R_1 + R_2 + R_3) e1 + (I + R_1 + R_2) phi, times L (Eq. 22-24)
  V tangent() const {
    const V straight = e1() + Sp::cross(theta, e1()) + second(e1()) + third;
    return constant(length) * straight + shear + Sp::cross(theta, shear) + second(shear);
  }
  /// theta' = K + theta_1 x K / 2 + theta_2 x K / 2 + theta_1 x (theta_1 x K) / 12
  V twist() const {
    const V turned = Sp::cross(theta, K);
    return K + times(0.5, turned) + times(0.5, Sp::cross(theta_2, K)) + times(1.0 / 12.0, Sp::cross(theta, turned));
  }
};

/// A vector function of the series into a jet.
template <class S, class P, class F>
void put_jet(const Node& node, const Rows<Space<P>>& rows, const S* dq, const SpaceSeries<P>& s,
             const Jet<Space<P>>& out, const F& f) {
  using Lin = typename Space<P>::Lin;
  const auto rate_of = [&](const Jet<Space<P>>& jet, int i) {
    Lin rate = Space<P>::zero();
    for (int k = 0; k < node.ne; ++k) rate += widen(dq[k], P{}) * jet.by(k)(i);
    return rate;
  };
  for (int i = 0; i < rows.points; ++i) {
    const Lin K = s.K(i), theta = s.theta(i), shear = s.shear(i), theta_2 = s.theta_2.value(i),
              third = s.third.value(i);
    using M = Moving<P>;
    const auto moving = [](const Lin& x, const Lin& d, const Lin& b) {
      return typename Space<M>::Lin{{x.x, d.x, b.x}, {x.y, d.y, b.y}, {x.z, d.z, b.z}};
    };
    const Lin zero = Space<P>::zero();
    Lin theta_rate = zero;
    for (int k = 0; k < node.sampled.turning; ++k)
      Space<P>::component(theta_rate, node.about[k]) += rows.turned(k, i) * widen(dq[k], P{});
    const ThirdOrder<M, P> all{moving(K, s.K_rate(i), zero),
                               moving(theta, theta_rate, zero),
                               moving(shear, s.shear_rate(i), zero),
                               moving(theta_2, rate_of(s.theta_2, i), s.theta_2.bias(i)),
                               moving(third, rate_of(s.third, i), s.third.bias(i)),
                               rows.span.length};
    const auto y = f(all);
    out.value.set(i, {y.x.x, y.y.x, y.z.x});
    out.bias.set(i, {y.x.b, y.y.b, y.z.b});
    using A = Along<P>;
    const auto along = [](const Lin& x, const Lin& d) {
      return typename Space<A>::Lin{{x.x, d.x}, {x.y, d.y}, {x.z, d.z}};
    };
    for (int k = 0; k < node.ne; ++k) {
      Lin dK = zero, dtheta = zero, dshear = zero;
      const bool bends = k < node.sampled.turning;
      Space<P>::component(bends ? dK : dshear, node.about[k]) = rows.shape(k, i);
      if (bends) Space<P>::component(dtheta, node.about[k]) = rows.turned(k, i);
      const ThirdOrder<A, P> one{along(K, dK),
                                 along(theta, dtheta),
                                 along(shear, dshear),
                                 along(theta_2, s.theta_2.by(k)(i)),
                                 along(third, s.third.by(k)(i)),
                                 rows.span.length};
      const auto z = f(one);
      out.by(k).set(i, {z.x.d, z.y.d, z.z.d});
    }
  }
}

template <class S, class P>
void sample_order_3(const Node& node, const Rows<Space<P>>& rows, const Integral<S, P>& integral, const S* dq,
                    const SpaceSeries<P>& s) {
  const int columns = 3 * (2 + node.ne);
  clear_stations(s.theta_2, node.ne, 0, rows.points);
  clear_stations(s.third, node.ne, 0, rows.points);
  put_jet(node, rows, dq, s, s.theta_2, [](const auto& a) { return a.theta_2_slope(); });
  integral(s.theta_2.value.at, s.theta_2.value.stride, columns);
  put_jet(node, rows, dq, s, s.third, [](const auto& a) { return a.third_slope(); });
  integral(s.third.value.at, s.third.value.stride, columns);
  put_jet(node, rows, dq, s, s.tangent, [](const auto& a) { return a.tangent(); });
  put_jet(node, rows, dq, s, s.twist, [](const auto& a) { return a.twist(); });
}

/// Places at the points, and turns: of the rotation vector theta (Eq. 35, 39, 40).
template <class S, class P>
void third_order_places(const Node& node, const Rows<Space<P>>& rows, const Integral<S, P>& integral, const S* dq,
                        const SpaceSeries<P>& s) {
  using Lin = typename Space<P>::Lin;
  const int stride = s.place.value.stride, columns = 3 * (2 + node.ne);
  integral(columns, columns_of(s.tangent.value), s.place.value.at, stride);
  integral(columns, columns_of(s.twist.value), s.turned.value.at, stride);
  for (int i = 0; i < rows.points; ++i) {
    const Turned<P> t(s.turned.value(i));
    const auto R = t.rotation();
    s.R[0].set(i, {R.xx, R.yx, R.zx});
    s.R[1].set(i, {R.xy, R.yy, R.zy});
    s.R[2].set(i, {R.xz, R.yz, R.zz});
    Lin rate = Space<P>::zero();
    for (int k = 0; k < node.ne; ++k) {
      const Lin d = s.turned.by(k)(i);
      rate += widen(dq[k], P{}) * d;
      s.turned.by(k).set(i, t.jacobian(d, 1.0));
    }
    s.turned.bias.set(i, t.bias(rate, s.turned.bias(i), 1.0));
    s.spin.set(i, t.jacobian(rate, 1.0));
  }
}

}  // namespace sampled
}  // namespace
