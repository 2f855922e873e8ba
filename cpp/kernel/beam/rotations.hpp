// R' = R K~ (Eq. 25) at Gauss points, as a unit quaternion: p' = p (0, K) / 2.
#pragma once

#include "beam/sampled_sums.hpp"

namespace {
namespace sampled {

template <class P>
struct Quaternion {
  using Sp = Space<P>;
  P w;
  typename Sp::Lin v;
  friend Quaternion operator*(const Quaternion& a, const Quaternion& b) {
    return {a.w * b.w - Sp::dot(a.v, b.v), a.w * b.v + b.w * a.v + Sp::cross(a.v, b.v)};
  }
  friend Quaternion operator+(const Quaternion& a, const Quaternion& b) { return {a.w + b.w, a.v + b.v}; }
};

template <class P>
struct Quaternions {
  P* at;
  int stride;
  Quaternion<P> operator()(int i) const { return {at[i], {at[stride + i], at[2 * stride + i], at[3 * stride + i]}}; }
  void set(int i, const Quaternion<P>& p) const {
    at[i] = p.w;
    at[stride + i] = p.v.x;
    at[2 * stride + i] = p.v.y;
    at[3 * stride + i] = p.v.z;
  }
};

template <class P>
P square_of(const Quaternion<P>& p) {
  return p.w * p.w + Space<P>::dot(p.v, p.v);
}

/// R of a quaternion of any length.
template <class P>
typename Space<P>::Rot rotation_of(const Quaternion<P>& p) {
  const auto& v = p.v;
  const P scale = 2.0 / square_of(p), x = scale * v.x, y = scale * v.y, z = scale * v.z;
  const P xx = x * v.x, yy = y * v.y, zz = z * v.z, xy = x * v.y, xz = x * v.z, yz = y * v.z;
  const P wx = p.w * x, wy = p.w * y, wz = p.w * z;
  return {1.0 - (yy + zz), xy - wz, xz + wy, xy + wz, 1.0 - (xx + zz), yz - wx, xz - wy, yz + wx, 1.0 - (xx + yy)};
}

template <class P>
Quaternion<P> slope_of(const Quaternion<P>& p, const typename Space<P>::Lin& K) {
  return p * Quaternion<P>{P{}, number<P>(0.5) * K};
}

/// Where all sections turn about one axis, by theta.
template <class P>
void turn_about_axis(const Field<Space<P>>& theta, int axis, int points, const Quaternions<P>& p) {
  for (int i = 0; i < points; ++i) {
    Quaternion<P> turn{P{}, Space<P>::zero()};
    sine_cosine(P(0.5 * theta.column(axis)[i]), Space<P>::component(turn.v, axis), turn.w);
    p.set(i, turn);
  }
}

template <class P>
Quaternion<P> zero_where(const typename Lanes<P>::Mask& mask, const Quaternion<P>& p) {
  using L = Lanes<P>;
  const P o{};
  return {L::select(mask, o, p.w), {L::select(mask, o, p.v.x), L::select(mask, o, p.v.y), L::select(mask, o, p.v.z)}};
}

/// Starts the rotation as a product P of unit turns, (1 + v) over its length each. The rest turns by the rate
/// D, the vector of p' p^-1 - P' P^-1. The next turn is v = int D; behind it the rate is the vector of v D (1 + v)^-1,
/// so that each turn squares the error. Where turns are large, that does not converge, and p starts at 1. The product
/// begins at 1, or, of a beam that is curved at rest, at p, with its D.
template <class S, class P>
void start_rotation(const Field<Space<P>>& K, const Field<Space<P>>& theta, int points, const Integral<S, P>& integral,
                    bool curved, const Quaternions<P>& p, const Field<Space<P>>& D, const Field<Space<P>>& v) {
  using Sp = Space<P>;
  using L = Lanes<P>;
  using Lin = typename Sp::Lin;
  constexpr double kNear = 9.0;    // square of the largest turn (rad) to begin with
  constexpr double kLarge = 0.5;   // square of a v that leads nowhere
  constexpr double kDone = 1e-17;  // and of one that is the last
  constexpr int kRounds = 7;
  const P half = number<P>(0.5), one = number<P>(1.0);
  const auto zero_at = [](const typename L::Mask& mask, const Lin& x) {
    return Lin{L::select(mask, P{}, x.x), L::select(mask, P{}, x.y), L::select(mask, P{}, x.z)};
  };
  const typename L::Mask none = L::everywhere(false);
  typename L::Mask far = none;
  if (curved) integral(3, columns_of(D), v.at, v.stride);
  for (int i = 0; i < points; ++i) {
    if (!curved) v.set(i, half * theta(i));
    far = far | ((curved ? 4.0 * Sp::dot(v(i), v(i)) : Sp::dot(theta(i), theta(i))) > kNear);
  }
  far = of_arm<S, P>(far);
  typename L::Mask done = far;
  for (int i = 0; i < points; ++i) {
    const Lin first = zero_at(far, v(i));
    v.set(i, first);
    if (!curved) D.set(i, half * K(i));
    p.set(i, curved ? Quaternion<P>{one, first} * p(i) : Quaternion<P>{one, first});
  }
  for (int round = 0; round < kRounds && !L::all(done); ++round) {
    for (int i = 0; i < points; ++i) {
      const Lin by = v(i), d = D(i);
      const P square = Sp::dot(by, by), along = 2.0 * Sp::dot(by, d), over = 1.0 / (1.0 + square);
      D.set(i, over * (Sp::cross(by, d) + along * by - square * d));
    }
    integral(3, columns_of(D), v.at, v.stride);
    typename L::Mask open = none;
    for (int i = 0; i < points; ++i) {
      const Lin by = zero_at(done, v(i));
      const P square = Sp::dot(by, by);
      v.set(i, by);
      p.set(i, Quaternion<P>{one, by} * p(i));
      far = far | (square > kLarge);
      open = open | (square > kDone);
    }
    far = of_arm<S, P>(far);
    done = done | far | L::none_of(of_arm<S, P>(open));
  }
  for (int i = 0; i < points; ++i) {
    const Quaternion<P> all = p(i);
    const P over = 1.0 / L::root(square_of(all));
    p.set(i, {L::select(far, one, over * all.w), zero_at(far, over * all.v)});
  }
}

/// Solves p = 1 + int p (0, K) / 2 by repeated integrals (Picard): the residual, integrated, converges like
/// (|theta|/2)^i / i!, from anywhere. Terms of both signs grow as large as exp(|theta|/2) on the way; the digits that
/// this costs come back when the residual is integrated again. Beyond some 60 rad none is left, and the result
/// is not a number.
template <class S, class P>
void solve_rotation(const Field<Space<P>>& K, const Field<Space<P>>& theta, int points, const Integral<S, P>& integral,
                    bool curved, const Quaternions<P>& p, const Quaternions<P>& term, const Quaternions<P>& factor) {
  using Mask = typename Lanes<P>::Mask;
  // squares: of a term behind which nothing comes; of one that costs digits; of one of which the sum, of size 1, keeps
  // four digits
  constexpr double kSmall = 4e-30, kRough = 1e2, kLost = 1e24;
  constexpr int kTimes = 5, kRounds = 400;
  start_rotation(K, theta, points, integral, curved, p, Field<Space<P>>{term.at, term.stride},
                 Field<Space<P>>{factor.at, factor.stride});
  const Mask none = Lanes<P>::everywhere(false);
  P reach{};  // of the square of a term, the most that the next one's is
  for (int i = 0; i < points; ++i) reach = Lanes<P>::larger(reach, P(0.25 * Space<P>::dot(K(i), K(i))));
  reach = Lanes<P>::smaller(number<P>(1.0), most_of_arm<S>(reach));
  Mask over = none, lost = none;
  for (int time = 0; time < kTimes && !Lanes<P>::all(over); ++time) {
    Mask done = over, rough = none;
    int later = Lanes<S>::lag;
    for (int round = 0; round < kRounds; ++round) {
      for (int i = 0; i < points; ++i) {
        const Quaternion<P> next = slope_of(round == 0 ? p(i) : term(i), K(i));
        term.set(i, Lanes<S>::lag == 0 ? zero_where(done, next) : next);
      }
      integral(term.at, term.stride, 4);
      Mask open = none;
      for (int i = 0; i < points; ++i) {
        Quaternion<P> next = term(i);
        const Quaternion<P> sum = p(i);
        if (round == 0) {
          next = zero_where(done, Quaternion<P>{next.w + (1.0 - sum.w), next.v - sum.v});
          term.set(i, next);
        }
        p.set(i, sum + next);
        const P square = square_of(next);
        open = open | (square * reach > kSmall);
        rough = rough | (square > kRough);
        lost = lost | (square > kLost);
      }
      lost = of_arm<S, P>(lost);
      done = done | lost | Lanes<P>::none_of(of_arm<S, P>(open));
      if (Lanes<P>::all(done) && later-- == 0) break;
    }
    over = over | lost | Lanes<P>::none_of(of_arm<S, P>(rough));
  }
  for (int i = 0; i < points; ++i) p.set(i, {Lanes<P>::select(lost, number<P>(__builtin_nan("")), p(i).w), p(i).v});
}

}  // namespace sampled
}  // namespace
