// Feedback laws without memory, u = offset - by_q . q - by_v . v within -limit .. limit, whose generalised force is
// column u: in the forces, and in the matrix of an implicit step, S + sum column slopes^T, by Woodbury's formula. Rates
// whose motor has a limit get no more than that of the laws and the given forces together. Arrays of laws and limits
// have those of the laws first.
#pragma once

#include "door/layout.hpp"
#include "wide/arena.hpp"
#include "wide/scalar.hpp"
#include "wide/small.hpp"

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
  S* slopes = nullptr;                     ///< of each law (nv)
  S* acts = nullptr;                       ///< entries of a law's column at each rate with a limit
  S* solved = nullptr;                     ///< S^-1 of the rest of each column, and of each rate with a limit
  S *H = nullptr, *G = nullptr;            ///< 1 + slopes^T solved; of those below their limit now, factored
  S *wanted = nullptr, *linear = nullptr;  ///< before the limits; 0: beyond its own, 1: not
  S *rise = nullptr, *turn = nullptr, *ahead = nullptr;  ///< see follow; of those that act; see to_kink
  S* r = nullptr;                                        ///< scratch (nv)
  S* asked = nullptr;                                    ///< of the rates with a limit

  void lay_out(Arena& arena) {
    arena.take_zeros(laws, offset);
    arena.take(laws * nv, slopes);
    arena.take(laws * limits, acts);
    arena.take((laws + limits) * nv, solved);
    arena.take(laws * (laws + limits), H);
    arena.take(laws * laws, G);
    arena.take(laws + limits, wanted, linear, rise, turn, ahead);
    arena.take(nv, r);
    arena.take(limits, asked);
  }
  static S of(const double* table, int i) { return L::load(table + i * L::width); }

  S unlimited(int law, const S* q, const S* v) const {
    S u = offset[law];
    for (int i = 0; i < nq; ++i) u -= of(by_q, law * nq + i) * q[i];
    for (int i = 0; i < nv; ++i) u -= of(by_v, law * nv + i) * v[i];
    return u;
  }
  static S within(const S& x, const S& bound) {
    return L::smaller(bound, L::larger(-bound, x));  // in this order, nan stays nan
  }
  /// A law's u.
  S value(int law, const S* q, const S* v) const { return within(unlimited(law, q, v), of(limit, law)); }
  /// Adds sign times the laws' forces, less the part of these and of the given ones beyond a limit.
  void add(const S* q, const S* v, double sign, S* tau) const {
    for (int l = 0; l < laws; ++l) {
      const S u = sign * value(l, q, v);
      for (int i = 0; i < nv; ++i) tau[i] += u * of(column, l * nv + i);
    }
    ask(q, v);
    for (int c = 0; c < limits; ++c) tau[limited[c]] += sign * (within(c, asked[c]) - asked[c]);
  }
  void ask(const S* q, const S* v) const {
    for (int c = 0; c < limits; ++c) asked[c] = given[limited[c]];
    for (int l = 0; limits > 0 && l < laws; ++l) {
      const S u = value(l, q, v);
      for (int c = 0; c < limits; ++c) asked[c] += u * of(column, l * nv + limited[c]);
    }
  }
  /// A force within limit c.
  S within(int c, const S& force) const { return within(force, of(most, c)); }
  /// After S, without the laws, was factored at q and v: solve(r, x) gives x = S^-1 r.
  /// @param free        rates that are not prescribed
  /// @param coordinate  of a rate, or -1
  /// @param rate        that a limit is of
  /// @param beside      of a limit: the motor's force now, without the laws
  template <class Coordinate, class Rate, class Beside, class Solve>
  void factor(const flexarm::lanes::Shift& shift, const S* q, const S* v, const int* free, int free_count,
              const Coordinate& coordinate, const Rate& rate, const Beside& beside, const Solve& solve) {
    for (int l = 0; l < laws; ++l) {
      S* s = slopes + l * nv;
      for (int i = 0; i < nv; ++i) s[i] = S{};
      for (int k = 0; k < free_count; ++k) {
        const int i = free[k], c = coordinate(i);
        s[i] = shift.damping * of(by_v, l * nv + i);
        if (c >= 0) s[i] += shift.stiffness * of(by_q, l * nq + c);
      }
      for (int i = 0; i < nv; ++i) r[i] = of(column, l * nv + i);
      for (int c = 0; c < limits; ++c) {
        acts[l * limits + c] = r[rate(c)];
        r[rate(c)] = S{};
      }
      solve_column(solve, solved + l * nv);
    }
    for (int c = 0; c < limits; ++c) {
      for (int i = 0; i < nv; ++i) r[i] = S{};
      for (int l = 0; l < laws; ++l)
        if (L::any(acts[l * limits + c] != 0.0)) r[rate(c)] = number<S>(1.0);
      solve_column(solve, solved + (laws + c) * nv);
    }
    for (int i = 0; i < laws; ++i)
      for (int j = 0; j < laws + limits; ++j) {
        S sum = number<S>(i == j ? 1.0 : 0.0);
        for (int k = 0; k < nv; ++k) sum += slopes[i * nv + k] * solved[j * nv + k];
        H[i * (laws + limits) + j] = sum;
      }
    look(q, v, beside);
    make_equations();
  }
  /// x = S^-1 r, without the laws, becomes that with them, each at its limit or not as it was last.
  void correct(S* x) {
    follow(x);
    for (int k = 0; k < laws + limits; ++k) turn[k] = linear[k] * rise[k];
    add_turn(x);
  }
  /// The same for a step of Newton's iteration from q and v, along which laws come to their limits and leave them:
  /// where limits only hold as they did at its beginning, it would jump from one limit to the other, and back. The
  /// solution for a growing part of r is followed from kink to kink (Katzenelson 1965).
  /// @return where other limits hold than in the call before
  template <class Beside>
  Mask correct_within(const S* q, const S* v, const Beside& beside, S* x) {
    if (!bounded()) {
      correct(x);
      return L::everywhere(false);
    }
    Mask other = look(q, v, beside);
    if (L::any(other)) make_equations();
    const int all = laws + limits, rounds = 4 * all + 4;
    for (int k = 0; k < all; ++k) turn[k] = S{};
    S left = number<S>(1.0);
    for (int round = 0; round <= rounds; ++round) {
      follow(x);
      S least = left;
      for (int k = 0; k < all && round < rounds; ++k) {
        ahead[k] = to_kink(k);
        least = L::smaller(ahead[k], least);
      }
      const Mask kink = least < left;
      left -= least;
      for (int k = 0; k < all; ++k) {
        turn[k] += least * linear[k] * rise[k];
        wanted[k] += least * rise[k];
        linear[k] = L::select(kink & (ahead[k] <= least), 1.0 - linear[k], linear[k]);
      }
      if (!L::any(kink)) break;
      other = other | kink;
      make_equations();
    }
    add_turn(x);
    return other;
  }

 private:
  bool bounded() const {
    bool found = limits > 0;
    for (int l = 0; l < laws; ++l) found = found || L::any(of(limit, l) < __builtin_inf());
    return found;
  }
  S bound(int k) const { return k < laws ? of(limit, k) : of(most, k - laws); }
  template <class Solve>
  void solve_column(const Solve& solve, S* x) const {
    Mask there = L::everywhere(false);
    for (int i = 0; i < nv; ++i) there = there | (r[i] != 0.0);
    for (int i = 0; i < nv; ++i) x[i] = S{};
    if (L::any(there)) solve(r, x);
  }
  /// Values before their limits at q and v. @return where not the same ones are beyond as before
  template <class Beside>
  Mask look(const S* q, const S* v, const Beside& beside) {
    Mask other = L::everywhere(false);
    for (int c = 0; c < limits; ++c) wanted[laws + c] = beside(c);
    for (int k = 0; k < laws + limits; ++k) {
      if (k < laws) {
        wanted[k] = unlimited(k, q, v);
        const S u = within(wanted[k], bound(k));
        for (int c = 0; c < limits; ++c) wanted[laws + c] += u * acts[k * limits + c];
      }
      const S now = L::select(L::size(wanted[k]) > bound(k), S{}, number<S>(1.0));
      other = other | (now != linear[k]);
      linear[k] = now;
    }
    return other;
  }
  /// G, of the laws' values before their limits.
  void make_equations() {
    for (int i = 0; i < laws; ++i)
      for (int j = 0; j < laws; ++j) {
        S sum = H[i * (laws + limits) + j];
        for (int c = 0; c < limits; ++c)
          sum += H[i * (laws + limits) + laws + c] * linear[laws + c] * acts[j * limits + c];
        G[i * laws + j] = L::select(linear[j] > 0.5, sum, number<S>(i == j ? 1.0 : 0.0));
      }
    factor_small(G, laws);
  }
  /// Changes of the values before their limits, where without laws the change is x.
  void follow(const S* x) {
    for (int i = 0; i < laws; ++i) {
      rise[i] = S{};
      for (int k = 0; k < nv; ++k) rise[i] -= slopes[i * nv + k] * x[k];
    }
    solve_small(G, laws, rise);
    for (int c = 0; c < limits; ++c) {
      rise[laws + c] = S{};
      for (int l = 0; l < laws; ++l) rise[laws + c] += linear[l] * rise[l] * acts[l * limits + c];
    }
  }
  /// Part of `rise` up to where a value comes to its limit, or back to it; 2: it does not.
  S to_kink(int k) const {
    const Mask free = linear[k] > 0.5;
    const S side = L::select(L::select(free, rise[k], wanted[k]) > 0.0, bound(k), -bound(k));
    const S part = L::larger((side - wanted[k]) / rise[k], S{});
    return L::select((free & (rise[k] != 0.0)) | (rise[k] * wanted[k] < 0.0), part, number<S>(2.0));
  }
  void add_turn(S* x) const {
    for (int i = laws + limits; i-- > 0;)
      for (int k = 0; k < nv; ++k) x[k] += solved[i * nv + k] * turn[i];
  }
};

}  // namespace
