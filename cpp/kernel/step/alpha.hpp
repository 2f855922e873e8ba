// The generalised-alpha method (Chung & Hulbert 1993), with dry friction in its equations. See methods.hpp for its
// engine and its interface.
#pragma once

#include <limits>

#include "door/kernels.hpp"
#include "door/layout.hpp"
#include "step/joint_friction.hpp"
#include "step/newton.hpp"
#include "wide/scalar.hpp"

namespace {

using flexarm::lanes::MethodOptions;
using flexarm::lanes::MethodTraits;
using flexarm::lanes::Work;

constexpr double kBest = 1e-4;       // contraction that is believed without having been measured in the same step
constexpr double kRounding = 1e-14;  // parts of the applied forces: a residual below is noise
constexpr double kFloor = 1e-7;      // parts of the motion: an iteration that stalls below is at the end of its digits
constexpr double kGrown = 1.5;       // ratio of a step to the one before, above which nothing is extrapolated
constexpr double kSame = 1e-9;       // of that ratio to 1
constexpr int kParts = 256;          // of a step whose equations cannot be solved, at most
constexpr double kNear = 0.1;        // parts of the speed by which twice as many parts may change it

/// The matrix is made at the first iteration, and anew at the fourth and every second one after it: by number, not by
/// how an iteration goes, so that arms in the lanes of a pack do not disturb one another.
inline bool new_matrix(int iteration) { return iteration == 1 || (iteration >= 4 && iteration % 2 == 0); }

/// Coefficients of the method, by its spectral radius.
struct AlphaNumbers {
  double alpha_m, alpha_f, beta, gamma;
  AlphaNumbers() = default;
  explicit AlphaNumbers(double radius)
      : alpha_m((2.0 * radius - 1.0) / (radius + 1.0)),
        alpha_f(radius / (radius + 1.0)),
        gamma(0.5 - alpha_m + alpha_f) {
    beta = 0.25 * (gamma + 0.5) * (gamma + 0.5);
  }
  /// Derivative of the auxiliary acceleration by the true one.
  double by_a() const { return (1.0 - alpha_f) / (1.0 - alpha_m); }
};

template <class Engine>
struct GeneralisedAlpha : AlphaNumbers {
  using S = typename Engine::Scalar;
  using L = Lanes<S>;
  using Mask = typename L::Mask;
  static constexpr flexarm::lanes::Ending unsolved = flexarm::lanes::not_converged;

  double rtol;
  int max_iterations;
  int nq = 0, nv = 0;
  double h_before = 0.0;
  Newton<S> newton;
  S scale;
  // of nq; of nv
  S* q0;
  S *v0, *a0, *a_before, *alpha0, *lagged, *alpha, *a, *u, *r, *turn, *tau_own;  // lagged: alpha0 as this step has it
  S *closed_q, *closed_v;  // displacement and rates that keep loops closed, in this step
  S *part_q, *part_v, *part_a, *part_alpha, *part_closed_q, *part_closed_v, *none;  // of `divide`; none: zeros
  S *kept_q, *kept_v, *coarse_q, *coarse_v, *end_v;
  int iterations = 0;
  Work work;
  Mask divided = L::everywhere(false), met = divided;  // the last step; contacts touched or let go in it
  S parts{};                                           // of the last step that was divided
  int parts_again = 0;                                 // of a step that is taken again: not 0 if it was divided
  S divisions{}, doubt{};  // how many were; the largest change of an end by twice as many parts, in parts of the speed
  JointFriction<Engine> joints;

  void lay_out(Arena& arena, int nq_, int nv_, const int* rubbing, int rubbing_count, const MethodOptions& options) {
    static_cast<AlphaNumbers&>(*this) = AlphaNumbers(options.spectral_radius);
    rtol = options.rtol;
    max_iterations = options.max_iterations;
    nq = nq_;
    nv = nv_;
    arena.take_zeros(nq, q0, part_q, coarse_q, kept_q);
    arena.take_zeros(nv, v0, a0, a_before, alpha0, lagged, alpha, a, u, r, turn, tau_own);
    arena.take_zeros(nv, part_v, part_a, part_alpha, none, coarse_v, end_v, kept_v);
    arena.take_zeros(nv, closed_q, closed_v, part_closed_q, part_closed_v);
    joints.lay_out(arena, rubbing, rubbing_count, nv);
    forget();
  }
  JointFriction<Engine>& friction() { return joints; }

  void forget() {
    h_before = 0.0;
    newton.contraction = number<S>(1.0);
    scale = S{};
  }
  Mask begin(Engine& engine, const S* q, const S* v, const S* tau, S* x, const Mask& where) {
    ++work.evaluations;
    Mask good = accelerate(engine, q, v, tau, x, where);
    for (int i = 0; i < nv; ++i) good = good & L::finite(x[i]);
    const Mask now = where & good;
    for (int i = 0; i < nv; ++i) {
      a0[i] = L::select(now, x[i], a0[i]);
      a_before[i] = L::select(now, x[i], a_before[i]);
      alpha0[i] = L::select(now, x[i], alpha0[i]);
    }
    joints.end_instant(v, now);
    return good;
  }
  /// Arms without friction get the same numbers as in a pack without friction.
  Mask accelerate(Engine& engine, const S* q, const S* v, const S* tau, S* x, const Mask& where, bool between = false) {
    const Mask rubs = joints.anywhere();
    if (!L::any(rubs)) return engine.accelerate(q, v, tau, x);
    Mask good = joints.accelerate(engine, q, v, tau, x, where, tau_own, r, turn, between);
    if (L::all(rubs)) return good;
    for (int i = 0; i < nv; ++i) turn[i] = x[i];
    good = (good & rubs) | (engine.accelerate(q, v, tau, turn) & L::none_of(rubs));
    for (int i = 0; i < nv; ++i) x[i] = L::select(rubs, x[i], turn[i]);
    return good;
  }

  template <class Given>
  Mask step(Engine& engine, double h, S* q, S* v, const S* tau, S* x, const Given& given, const Mask& skip) {
    for (int i = 0; i < nv; ++i) v0[i] = v[i];
    given(1.0);
    for (int i = 0; i < nq; ++i) q0[i] = q[i];  // free ones are still those of the beginning
    predict(engine, h, x);
    return iterate(engine, h, q, v, tau, skip);
  }
  /// Whether the engine was last asked at the end of the step, up to the last correction.
  bool asked_at_end() const { return !L::any(divided); }
  Mask accept(double h, S* v, S* x, const Mask& where) {
    for (int i = 0; i < nv; ++i) {
      a_before[i] = L::select(where, a0[i], a_before[i]);
      x[i] = a0[i] = L::select(where, a[i], a0[i]);
      alpha0[i] = L::select(where, alpha[i], alpha0[i]);
    }
    h_before = h;
    return joints.end_step(v, where) | ((divided | met) & where);
  }

  bool changed(double h) const { return !(h <= h_before * (1.0 + kSame) && h >= h_before * (1.0 - kSame)); }
  double continued(double h) const { return h_before > 0.0 && h <= kGrown * h_before ? h / h_before : 0.0; }
  /// The remainder of alpha0 - a0 where a step of h begins.
  double lag(double h) const { return changed(h) ? continued(h) : 1.0; }

  /// Accelerations extrapolated, and the auxiliary ones that follow:
  ///   (1 - alpha_m) alpha + alpha_m alpha0 = (1 - alpha_f) a + alpha_f a0
  /// The auxiliary ones lag the true ones by (alpha_f - alpha_m) h: where h changes, so does the lag. Where it grows
  /// much, as behind a short pulse, they begin anew.
  void predict(const Engine& engine, double h, const S* given) {
    const double ahead = continued(h);
    const bool changed = this->changed(h);
    for (int i = 0; i < nv; ++i) {
      a[i] = given[i];  // where prescribed
      u[i] = S{};
    }
    for (int k = 0; k < engine.free_count; ++k) {
      const int i = engine.free[k];
      lagged[i] = changed ? a0[i] + ahead * (alpha0[i] - a0[i]) : alpha0[i];
      a[i] = a0[i] + ahead * (a0[i] - a_before[i]);
      alpha[i] = ((1.0 - alpha_f) * a[i] + alpha_f * a0[i] - alpha_m * lagged[i]) * (1.0 / (1.0 - alpha_m));
    }
  }

  /// q and v at the step's end from the auxiliary accelerations.
  void place(Engine& engine, double h, S* q, S* v) {
    for (int k = 0; k < engine.free_count; ++k) {
      const int i = engine.free[k];
      u[i] = h * v0[i] + (h * h) * ((0.5 - beta) * lagged[i] + beta * alpha[i]);
      v[i] = v0[i] + h * ((1.0 - gamma) * lagged[i] + gamma * alpha[i]);
    }
    if (engine.closes())
      for (int k = 0; k < engine.free_count; ++k) {
        const int i = engine.free[k];
        u[i] += closed_q[i];
        v[i] += closed_v[i];
      }
    engine.place(q0, u, q);
  }

  /// Adds to the displacement that keeps the loops closed, and to their forces, of arms that are `open`.
  /// @param most  gets its largest displacement
  /// @return the square of its size as accelerations, in the norm of M + shift
  S close(Engine& engine, const flexarm::lanes::Shift& shift, const Mask& open, S& most) {
    engine.hold_change(open);
    S* const more = u;
    const auto add = [&](S* to, double time) {
      for (int i = 0; i < nv; ++i) {
        most = L::larger(most, time * L::size(more[i]));
        to[i] += L::select(open, more[i], S{});
        more[i] = S{};
      }
    };
    for (int i = 0; i < nv; ++i) more[i] = S{};
    const S places = engine.close_places(shift, more);
    add(closed_q, 1.0);
    const S rates = engine.close_rates(shift, more);
    add(closed_v, shift.stiffness / shift.damping);
    return (1.0 / (shift.stiffness * shift.stiffness)) * places + (1.0 / (shift.damping * shift.damping)) * rates;
  }

  /// Where the last correction is below the digits of the coordinates: at rest, in balance, there is no motion to
  /// compare it with.
  /// @param by_turn  of the coordinates by the accelerations (s^2)
  Mask lost(const Engine& engine, double by_turn, const S* q) const {
    S most{}, place{};
    for (int k = 0; k < engine.free_count; ++k) most = L::larger(most, L::size(turn[engine.free[k]]));
    for (int i = 0; i < nq; ++i) place = L::larger(place, L::size(q[i]));
    return by_turn * most <= kVanishing * place;
  }

  /// Where it and `most`, a displacement, are below the digits of coordinates of size 1: closed loops at rest.
  Mask still(const Engine& engine, double by_turn, S most) const {
    for (int k = 0; k < engine.free_count; ++k) most = L::larger(most, by_turn * L::size(turn[engine.free[k]]));
    return most <= number<S>(kVanishing);
  }

  /// Newton's iteration on the residual of inverse dynamics at the step's end. Where it does not converge, the step is
  /// divided.
  /// @param skip  lanes that are not asked
  /// @return where it converged; elsewhere q and v are of no use
  Mask iterate(Engine& engine, double h, S* q, S* v, const S* tau, const Mask& skip) {
    const S scale0 = scale, contraction0 = newton.contraction;
    newton.begin(kBest);
    joints.begin_step(L::everywhere(true));
    iterations = 0;
    divided = L::everywhere(false);
    Mask good = L::everywhere(false);
    engine.step_contacts(gamma * by_a());
    converge(engine, h, q, v, tau, skip, good);
    if (parts_again > 0) good = L::everywhere(false);
    if (engine.closes()) engine.let_go();
    met = engine.met() & good;
    engine.step_contacts(-1.0);
    scale = L::select(good, scale, scale0);  // an iteration that fails is forgotten
    newton.contraction = L::select(good, newton.contraction, contraction0);
    place(engine, h, q, v);
    if (engine.closes()) engine.shut(q, v, turn);
    if (L::all(good | skip)) return good;
    for (int i = 0; i < nq; ++i) kept_q[i] = q[i];
    for (int i = 0; i < nv; ++i) kept_v[i] = v[i];
    divide(engine, h, q, v, tau, L::none_of(good | skip));
    for (int i = 0; i < nq; ++i) q[i] = L::select(divided, coarse_q[i], kept_q[i]);
    for (int i = 0; i < nv; ++i) v[i] = L::select(divided, coarse_v[i], kept_v[i]);
    return good | divided;
  }

  /// Takes the step in 1, 2, 4 .. parts by Euler's implicit method, until twice as many parts lead to nearly the same
  /// motion; both are extrapolated to second order. It remembers no accelerations, and damps all vibration too fast for
  /// its parts: a vibration so loud that it made the iteration fail dies out. Forces are those of the step's end.
  /// A step that is taken again has as many parts as it had.
  /// @param asked  lanes; `divided`: where that was possible, whose state is in coarse_q and coarse_v
  void divide(Engine& engine, double h, S* q, S* v, const S* tau, const Mask& asked) {
    const AlphaNumbers own = *this;
    const S scale0 = scale, contraction0 = newton.contraction;
    for (int i = 0; i < nv; ++i) end_v[i] = v[i];
    joints.keep_beginning();
    S *const begin_q = q0, *const begin_v = v0, *const own_a = a, *const own_alpha = alpha, *const own_lagged = lagged;
    S *const own_closed_q = closed_q, *const own_closed_v = closed_v;
    q0 = part_q;
    v0 = part_v;
    a = part_a;
    alpha = part_alpha;
    lagged = none;
    closed_q = part_closed_q;
    closed_v = part_closed_v;
    alpha_m = alpha_f = 0.0;
    beta = gamma = 1.0;
    Mask known = L::everywhere(false);  // coarse_q, coarse_v, of half as many parts
    for (int count = parts_again > 1 ? parts_again / 2 : 1; count <= kParts && !L::all(divided | L::none_of(asked));
         count *= 2) {
      const Mask open = asked & L::none_of(divided);
      scale = scale0;
      const Mask solved = take_parts(engine, h, count, begin_q, begin_v, own_a, q, v, tau, open);
      for (int i = 0; i < nv; ++i) turn[i] = L::select(solved & known, v[i] - coarse_v[i], S{});
      const S off = speed(engine, q, turn), size = speed(engine, q, v);
      const S part = L::root(off / L::larger(size + (h * h) * engine.weight, kForget * scale0));
      const double most = count == parts_again ? std::numeric_limits<double>::max() : kNear;
      const Mask near = solved & known & (part <= most);
      for (int i = 0; i < nq; ++i) {
        const S better = 2.0 * q[i] - coarse_q[i];
        coarse_q[i] = L::select(near, better, L::select(solved, q[i], coarse_q[i]));
      }
      for (int i = 0; i < nv; ++i) {
        const S better = 2.0 * v[i] - coarse_v[i];
        coarse_v[i] = L::select(near, better, L::select(solved, v[i], coarse_v[i]));
      }
      divisions += L::select(near, number<S>(1.0), S{});
      doubt = L::select(near, L::larger(doubt, part), doubt);
      divided = divided | near;
      parts = L::select(near, number<S>(count), parts);
      known = solved;
    }
    engine.normalise(coarse_q);
    if (engine.closes()) {
      engine.let_go();
      for (int i = 0; i < nq; ++i) coarse_q[i] = L::select(divided, coarse_q[i], begin_q[i]);
      for (int i = 0; i < nv; ++i) coarse_v[i] = L::select(divided, coarse_v[i], begin_v[i]);
      engine.project({0.0, h * h}, coarse_q, coarse_v, turn);
    }
    q0 = begin_q;
    v0 = begin_v;
    a = own_a;
    alpha = own_alpha;
    lagged = own_lagged;
    closed_q = own_closed_q;
    closed_v = own_closed_v;
    static_cast<AlphaNumbers&>(*this) = own;
    scale = scale0;
    newton.contraction = contraction0;
    for (int i = 0; i < nq; ++i) q[i] = q0[i];
    for (int i = 0; i < nv; ++i) v[i] = end_v[i];
    joints.go_back(L::everywhere(true));
  }

  /// v^T M v
  S speed(Engine& engine, const S* q, const S* v) {
    S twice;
    engine.inverse(q, v, none, tau_own, true);
    engine.factor(flexarm::lanes::Shift{}, twice);
    return twice;
  }

  /// The step in `count` parts. Prescribed rates go evenly to those of its end.
  /// @return the lanes of `open` whose parts all converged
  Mask take_parts(Engine& engine, double h, int count, const S* begin_q, const S* begin_v, const S* given, S* q, S* v,
                  const S* tau, Mask open) {
    const double part = h / count;
    for (int i = 0; i < nq; ++i) q0[i] = begin_q[i];
    for (int i = 0; i < nv; ++i) v0[i] = begin_v[i];
    joints.go_back(open);
    for (int k = 1; k <= count && L::any(open); ++k) {
      const double left = h * (1.0 - static_cast<double>(k) / count);
      for (int i = 0; i < nv; ++i) {
        a[i] = left > 0.0 ? (end_v[i] - begin_v[i]) * (1.0 / h) : given[i];
        v[i] = end_v[i] - left * a[i];
        if (const int at = engine.coordinate(i); at >= 0) q[at] = begin_q[at] - 0.5 * left * (v[i] + end_v[i]);
      }
      for (int n = 0; n < engine.free_count; ++n) a[engine.free[n]] = alpha[engine.free[n]] = S{};
      newton.again(open);
      joints.begin_step(open);
      Mask good = L::everywhere(false);
      converge(engine, part, q, v, tau, L::none_of(open), good);
      place(engine, part, q, v);
      open = open & good;
      joints.end_step(v, open);
      for (int i = 0; i < nq; ++i) q0[i] = q[i];
      for (int i = 0; i < nv; ++i) v0[i] = v[i];
    }
    return open;
  }

  /// The iterations from one start.
  /// @param good  where it has converged, before and after
  void converge(Engine& engine, double h, S* q, S* v, const S* tau, const Mask& skip, Mask& good) {
    const double by_a = this->by_a();
    const flexarm::lanes::Shift shift{h * gamma * by_a, h * h * beta * by_a};
    const S fall = (h * h) * engine.weight;
    S size{};
    Mask bad = skip;
    for (int i = 0; i < nv; ++i) closed_q[i] = closed_v[i] = S{};
    if (engine.closes()) engine.let_go();
    for (int n = 1; n <= max_iterations && !L::all(good | bad); ++n) {
      ++iterations;
      place(engine, h, q, v);
      const bool anew = new_matrix(n);
      engine.inverse(q, v, a, tau_own, anew);
      ++work.evaluations;
      if (anew) {
        S twice;
        bad = bad | (L::none_of(good) & L::none_of(engine.factor(shift, twice)));
        ++work.factorisations;
        joints.refactored(L::everywhere(true));
        scale = L::select(good, scale, L::larger(twice, kForget * scale));
        size = L::select(good, size, L::root(scale + fall));
        if (L::all(good | bad)) return;  // an engine that could not factor has nothing to solve with
      }
      S released{}, residual{}, shut_by{}, force = joints.take_from(tau_own);
      for (int k = 0; k < engine.free_count; ++k) {
        const int i = engine.free[k];
        r[i] = tau[i] - tau_own[i];
        force = L::larger(force, L::size(tau[i]));
      }
      joints.refactored(engine.correction(r, turn));
      ++work.solves;
      if (engine.closes()) released = close(engine, shift, L::none_of(good | bad), shut_by);
      for (int k = 0; k < engine.free_count; ++k) residual = L::larger(residual, L::size(r[engine.free[k]]));
      const Mask switching = joints.count == 0 ? L::everywhere(false)
                                               : joints.resolve(engine, turn, v, v0, shift.damping, gamma * by_a,
                                                                L::none_of(good | bad), tau_own);
      for (int c = 0; c < joints.count; ++c) released += joints.turn[c] * turn[joints.at[c]];
      for (int k = 0; k < engine.free_count; ++k)
        released += r[engine.free[k]] * turn[engine.free[k]];  // turn^T S turn
      bad = bad | (L::none_of(good) & L::none_of(L::finite(released) & L::finite(size)));
      const S moved = shift.damping * L::root(L::size(released));  // of the velocities, in the norm of energy
      const Mask open = L::none_of(good | bad);
      for (int k = 0; k < engine.free_count; ++k) {
        const int i = engine.free[k];
        const S now = L::select(open, turn[i], S{});
        a[i] += now;
        alpha[i] += by_a * now;
      }
      newton.correct(n, moved, open);
      Mask stalled = newton.stalls(n);
      if (L::any(stalled)) stalled = stalled & ((moved <= kFloor * size) | lost(engine, shift.stiffness, q));
      Mask end = (newton.left() <= rtol * size) | (residual <= kRounding * force) | stalled;
      if (engine.closes()) end = (end | still(engine, shift.stiffness, shut_by)) & engine.closed();
      good = good | (open & end & L::none_of(switching));
    }
  }
};

struct Implicit {
  static constexpr MethodTraits traits{"implicit", true, true, true, 0.0};
  template <class Engine>
  using On = GeneralisedAlpha<Engine>;
};

}  // namespace
