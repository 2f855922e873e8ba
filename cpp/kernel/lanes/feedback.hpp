// Feedback laws without memory, u = offset - by_q . q - by_v . v within -limit .. limit, whose generalised force is
// column u: in the forces, and in the matrix of an implicit step, S + sum column slopes^T, by Woodbury's formula. Rates
// whose motor has a limit get no more than that of the laws and of what is given beside them.
#pragma once

#include "lanes/layout.hpp"
#include "lanes/room.hpp"
#include "lanes/scalar.hpp"
#include "lanes/small.hpp"

namespace {

template <class S>
struct FeedbackLaws {
  using L = Lanes<S>;
  using Mask = typename L::Mask;

  int laws = 0, nq = 0, nv = 0;
  const double *column = nullptr, *by_q = nullptr, *by_v = nullptr, *limit = nullptr;  ///< law by law: nv, nq, nv, 1
  int limits = 0;  ///< rates with a limit; which, and the most of each
  const int* limited = nullptr;
  const double* most = nullptr;
  const S* given = nullptr;                ///< forces beside the laws now (nv)
  S* offset = nullptr;                     ///< of each law, now
  S *slopes = nullptr, *solved = nullptr;  ///< nv each; S^-1 column
  S *G = nullptr, *y = nullptr;            ///< 1 + slopes^T S^-1 column, factored; scratch
  S* r = nullptr;                          ///< scratch (nv)
  S* asked = nullptr;                      ///< of the rates with a limit

  void lay_out(Room& room) {
    room.take_zeros(laws, offset);
    room.take(laws * nv, slopes, solved);
    room.take(laws * laws, G);
    room.take(laws, y);
    room.take(nv, r);
    room.take(limits, asked);
  }
  static S of(const double* table, int i) { return L::load(table + i * L::width); }

  /// A law's u, and where it is at its limit.
  S value(int law, const S* q, const S* v, Mask& at_limit) const {
    S u = offset[law];
    for (int i = 0; i < nq; ++i) u -= of(by_q, law * nq + i) * q[i];
    for (int i = 0; i < nv; ++i) u -= of(by_v, law * nv + i) * v[i];
    const S bound = of(limit, law);
    at_limit = L::size(u) >= bound;
    return L::smaller(bound, L::larger(-bound, u));  // in this order, what is not a number stays so
  }
  /// Adds sign times the laws' forces, and what limits take off them and what is given.
  void add(const S* q, const S* v, double sign, S* tau) const {
    for (int l = 0; l < laws; ++l) {
      Mask at_limit;
      const S u = sign * value(l, q, v, at_limit);
      for (int i = 0; i < nv; ++i) tau[i] += u * of(column, l * nv + i);
    }
    ask(q, v);
    for (int c = 0; c < limits; ++c) tau[limited[c]] += sign * (within(c, asked[c]) - asked[c]);
  }
  void ask(const S* q, const S* v) const {
    for (int c = 0; c < limits; ++c) asked[c] = given[limited[c]];
    for (int l = 0; limits > 0 && l < laws; ++l) {
      Mask at_limit;
      const S u = value(l, q, v, at_limit);
      for (int c = 0; c < limits; ++c) asked[c] += u * of(column, l * nv + limited[c]);
    }
  }
  /// A force within limit c.
  S within(int c, const S& force) const {
    const S bound = of(most, c);
    return L::smaller(bound, L::larger(-bound, force));
  }
  /// Takes the rates that are at their limits out of a column, behind `ask`.
  void mask(S* entries) const {
    for (int c = 0; c < limits; ++c)
      entries[limited[c]] = L::select(L::size(asked[c]) > of(most, c), S{}, entries[limited[c]]);
  }
  /// After S, without the laws, was factored at q and v: solve(r, x) gives x = S^-1 r.
  /// @param free        rates that are not prescribed
  /// @param coordinate  of a rate, or -1
  /// @param mask        takes the rates that are at their limits out of a column
  template <class Coordinate, class Limits, class Solve>
  void factor(const flexarm::lanes::Shift& shift, const S* q, const S* v, const int* free, int free_count,
              const Coordinate& coordinate, const Limits& mask, const Solve& solve) {
    for (int l = 0; l < laws; ++l) {
      Mask at_limit;
      value(l, q, v, at_limit);
      S* s = slopes + l * nv;
      for (int i = 0; i < nv; ++i) s[i] = S{};
      for (int k = 0; k < free_count; ++k) {
        const int i = free[k], c = coordinate(i);
        S slope = shift.damping * of(by_v, l * nv + i);
        if (c >= 0) slope += shift.stiffness * of(by_q, l * nq + c);
        s[i] = L::select(at_limit, S{}, slope);
      }
      for (int i = 0; i < nv; ++i) r[i] = of(column, l * nv + i);
      mask(r);
      solve(r, solved + l * nv);
    }
    for (int i = 0; i < laws; ++i)
      for (int j = 0; j < laws; ++j) {
        S sum = number<S>(i == j ? 1.0 : 0.0);
        for (int k = 0; k < nv; ++k) sum += slopes[i * nv + k] * solved[j * nv + k];
        G[i * laws + j] = sum;
      }
    factor_small(G, laws);
  }
  /// x = S^-1 r, without the laws, becomes that with them.
  void correct(S* x) const {
    for (int i = 0; i < laws; ++i) {
      y[i] = S{};
      for (int k = 0; k < nv; ++k) y[i] += slopes[i * nv + k] * x[k];
    }
    solve_small(G, laws, y);
    for (int i = laws; i-- > 0;)
      for (int k = 0; k < nv; ++k) x[k] -= solved[i * nv + k] * y[i];
  }
};

}  // namespace
