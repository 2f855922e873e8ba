// The generalised-alpha method (Chung & Hulbert 1993) on any engine: one arm's workspace, or a pack of arms. What an
// engine offers:
//   Scalar, Mask, nv, free (count, and the rates that are not prescribed)
//   place(q0, u, q)          coordinates q0 displaced by u, rates times time
//   inverse(q, v, a, tau)    inverse dynamics; keeps what `factor` needs
//   factor(shift, twice)     of M + shift: where it is positive definite; and v^T M v
//   solve(r, x)
#pragma once

#include "lanes/contact.hpp"
#include "lanes/layout.hpp"
#include "lanes/scalar.hpp"

namespace {

struct AlphaOptions {
  double rtol, alpha_m, alpha_f, beta, gamma;
  int max_iterations;

  static AlphaOptions of(double radius, double rtol, int max_iterations) {
    AlphaOptions o{};
    o.rtol = rtol;
    o.max_iterations = max_iterations;
    o.alpha_m = (2.0 * radius - 1.0) / (radius + 1.0);
    o.alpha_f = radius / (radius + 1.0);
    o.gamma = 0.5 - o.alpha_m + o.alpha_f;
    o.beta = 0.25 * (o.gamma + 0.5) * (o.gamma + 0.5);
    return o;
  }
};

constexpr double kBest = 1e-4;       // contraction that is believed without having been measured in the same step
constexpr double kRounding = 1e-14;  // parts of the applied forces: a residual below is noise
constexpr double kFloor = 1e-7;      // parts of the motion: an iteration that stalls below is at the end of its digits
constexpr double kGrown = 1.5;       // ratio of a step to the one before, above which nothing is extrapolated
constexpr double kSame = 1e-9;       // of that ratio to 1
constexpr double kForget = 0.99;     // per step, of the motion's scale

/// The matrix is made at the first iteration, and anew at the fourth and every second one after it: by number, not by
/// how an iteration goes, so that arms in the lanes of a pack do not disturb one another.
inline bool new_matrix(int iteration) { return iteration == 1 || (iteration >= 4 && iteration % 2 == 0); }

template <class Engine>
struct Alpha {
  using S = typename Engine::Scalar;
  using L = Lanes<S>;
  using Mask = typename L::Mask;

  AlphaOptions o;
  int nq = 0, nv = 0;
  double h_before = 0.0;
  S contraction, scale, weight;  ///< the last: mass of the arm times gravity squared
  // of nq; of nv
  S* q0;
  S *v0, *a0, *a_before, *alpha0, *alpha, *a, *u, *r, *turn, *tau_own;
  int iterations = 0;
  long evaluations = 0, factorisations = 0, solves = 0;
  Contacts<Engine> contacts;

  static std::size_t own_scalars(int nq, int nv) { return static_cast<std::size_t>(nq + 10 * nv); }
  static std::size_t scalars(int nq, int nv, int rubbing) {
    return own_scalars(nq, nv) + Contacts<Engine>::scalars(nv, rubbing);
  }
  /// @param rubbing  rates with dry friction that are not prescribed
  void lay_out(S* at, int nq_, int nv_, const int* rubbing, int rubbing_count) {
    nq = nq_;
    nv = nv_;
    for (std::size_t i = 0; i < own_scalars(nq, nv); ++i) at[i] = S{};
    contacts.lay_out(at + own_scalars(nq, nv), rubbing, rubbing_count, nv);
    q0 = at;
    S** all[] = {&v0, &a0, &a_before, &alpha0, &alpha, &a, &u, &r, &turn, &tau_own};
    at += nq;
    for (S** p : all) {
      *p = at;
      at += nv;
    }
  }

  /// Begins where accelerations are x, in some lanes.
  void begin(const S* x, const Mask& where) {
    for (int i = 0; i < nv; ++i) {
      a0[i] = L::select(where, x[i], a0[i]);
      a_before[i] = L::select(where, x[i], a_before[i]);
      alpha0[i] = L::select(where, x[i], alpha0[i]);
    }
  }

  /// Accelerations under dry friction, of which what does not move takes what holds it, as far as it may.
  /// @param x  the prescribed ones; gets all
  /// @return where the mass matrix is positive definite; `contacts` has the forces of friction
  Mask settle(Engine& engine, const S* q, const S* v, const S* tau, S* x, const Mask& where) {
    for (int k = 0; k < engine.free_count; ++k) x[engine.free[k]] = S{};
    engine.inverse(q, v, x, tau_own, true);
    S twice;
    const Mask good = engine.factor(flexarm::lanes::Shift{}, twice);
    contacts.refactored();
    contacts.begin_instant(v);
    contacts.take_from(tau_own);
    for (int k = 0; k < engine.free_count; ++k) r[engine.free[k]] = tau[engine.free[k]] - tau_own[engine.free[k]];
    if (L::all(L::none_of(good))) return good;
    engine.solve(r, turn);
    contacts.resolve(engine, turn, nullptr, nullptr, 1.0, 1.0, where & good, tau_own);
    for (int k = 0; k < engine.free_count; ++k) x[engine.free[k]] = turn[engine.free[k]];
    return good;
  }

  /// Accelerations extrapolated, and the auxiliary ones that follow:
  ///   (1 - alpha_m) alpha + alpha_m alpha0 = (1 - alpha_f) a + alpha_f a0
  /// The auxiliary ones lag the true ones by (alpha_f - alpha_m) h: where h changes, so does the lag. Where it grows
  /// much, as behind a short pulse, they begin anew.
  void predict(const Engine& engine, double h, const S* given) {
    const double ratio = h_before > 0.0 ? h / h_before : 0.0, ahead = ratio > kGrown ? 0.0 : ratio;
    const bool changed = ratio - 1.0 > kSame || ratio - 1.0 < -kSame;
    for (int i = 0; i < nv; ++i) {
      a[i] = given[i];  // where prescribed
      u[i] = S{};
    }
    for (int k = 0; k < engine.free_count; ++k) {
      const int i = engine.free[k];
      if (changed) alpha0[i] = a0[i] + ahead * (alpha0[i] - a0[i]);
      a[i] = a0[i] + ahead * (a0[i] - a_before[i]);
      alpha[i] = ((1.0 - o.alpha_f) * a[i] + o.alpha_f * a0[i] - o.alpha_m * alpha0[i]) * (1.0 / (1.0 - o.alpha_m));
    }
  }

  /// q and v at the step's end from the auxiliary accelerations.
  void place(Engine& engine, double h, S* q, S* v) {
    for (int k = 0; k < engine.free_count; ++k) {
      const int i = engine.free[k];
      u[i] = h * v0[i] + (h * h) * ((0.5 - o.beta) * alpha0[i] + o.beta * alpha[i]);
      v[i] = v0[i] + h * ((1.0 - o.gamma) * alpha0[i] + o.gamma * alpha[i]);
    }
    engine.place(q0, u, q);
  }

  /// Newton's iteration on the residual of inverse dynamics at the step's end.
  /// @param skip  lanes that are not asked
  /// @return where it converged; elsewhere q and v are of no use
  Mask iterate(Engine& engine, double h, S* q, S* v, const S* tau, const Mask& skip) {
    const double by_a = (1.0 - o.alpha_f) / (1.0 - o.alpha_m);  // d alpha / d a
    const flexarm::lanes::Shift shift{h * o.gamma * by_a, h * h * o.beta * by_a};
    const S fall = (h * h) * weight;
    // old knowledge, doubted more with every step
    contraction = L::larger(number<S>(kBest), L::root(contraction) * L::root(L::root(contraction)));
    S last{}, size{}, one = number<S>(1.0);
    contacts.begin_step();
    Mask good = L::everywhere(false), bad = skip;
    for (iterations = 1; iterations <= o.max_iterations; ++iterations) {
      place(engine, h, q, v);
      const bool anew = new_matrix(iterations);
      engine.inverse(q, v, a, tau_own, anew);
      ++evaluations;
      if (anew) {
        S twice;
        bad = bad | (L::none_of(good) & L::none_of(engine.factor(shift, twice)));
        ++factorisations;
        contacts.refactored();
        scale = L::select(good, scale, L::larger(twice, kForget * scale));
        size = L::select(good, size, L::root(scale + fall));
        if (L::all(good | bad)) break;  // an engine that could not factor has nothing to solve with
      }
      S work{}, residual{}, force = contacts.take_from(tau_own);
      for (int k = 0; k < engine.free_count; ++k) {
        const int i = engine.free[k];
        r[i] = tau[i] - tau_own[i];
        residual = L::larger(residual, L::size(r[i]));
        force = L::larger(force, L::size(tau[i]));
      }
      engine.solve(r, turn);
      ++solves;
      const Mask switching = contacts.count == 0 ? L::everywhere(false)
                                                 : contacts.resolve(engine, turn, v, v0, shift.damping, o.gamma * by_a,
                                                                    L::none_of(good | bad), tau_own);
      for (int c = 0; c < contacts.count; ++c) work += contacts.turn[c] * turn[contacts.at[c]];
      for (int k = 0; k < engine.free_count; ++k) work += r[engine.free[k]] * turn[engine.free[k]];  // turn^T S turn
      bad = bad | (L::none_of(good) & L::none_of(L::finite(work) & L::finite(size)));
      const S moved = shift.damping * L::root(L::size(work));  // of the velocities, in the norm of energy
      const Mask open = L::none_of(good | bad);
      for (int k = 0; k < engine.free_count; ++k) {
        const int i = engine.free[k];
        const S now = L::select(open, turn[i], S{});
        a[i] += now;
        alpha[i] += by_a * now;
      }
      if (iterations > 1) {
        const S seen = L::select(moved < last, moved / last, one);
        contraction = L::select(open, seen, contraction);
      }
      const Mask stalled = (contraction > 0.5) & (moved <= kFloor * size) & L::everywhere(iterations > 2);
      last = L::select(open, moved, last);
      const S left = L::smaller(one, contraction / L::larger(1.0 - contraction, number<S>(1e-3))) * moved;
      const Mask end = (left <= o.rtol * size) | (residual <= kRounding * force) | stalled;
      good = good | (open & end & L::none_of(switching));
      if (L::all(good | bad)) break;
    }
    if (iterations > o.max_iterations) iterations = o.max_iterations;
    place(engine, h, q, v);
    return good;
  }

  /// After a step that converged in some lanes.
  void end(double h, const Mask& where) {
    for (int i = 0; i < nv; ++i) {
      a_before[i] = L::select(where, a0[i], a_before[i]);
      a0[i] = L::select(where, a[i], a0[i]);
      alpha0[i] = L::select(where, alpha[i], alpha0[i]);
    }
    h_before = h;
  }
};

}  // namespace
