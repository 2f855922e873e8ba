// Dry friction of joints within a step, on any engine (see alpha.hpp): of one arm, or of a pack of arms.
//
// A step knows of each freedom how it began: sliding, or at rest. It ends sliding, or at rest, held by an unknown force
// (Moreau 1988; Acary & Brogliato 2008). The second order is kept by the force between: where the rate passes
// through zero within the step, or the hold gives way, that instant is estimated, and the force at the step's end is
// chosen such that its mean over the step, in the method's own weights, is that of the law. Which freedoms end at rest
// is found by pivoting in the equations that Newton's iteration solves, condensed to the freedoms with friction.
#pragma once

#include "door/layout.hpp"
#include "wide/arena.hpp"
#include "wide/scalar.hpp"
#include "wide/small.hpp"

namespace {

constexpr double kLeast = 1e-30;  // least acceleration by a unit force: at a dead centre it is rounding, or negative
constexpr double kShared = 1e-9;  // parts of it by which a joint gives way that others hold, too

template <class Engine>
struct JointFriction {
  using S = typename Engine::Scalar;
  using L = Lanes<S>;
  using Mask = typename L::Mask;

  int count = 0, nv = 0;
  const int* at = nullptr;      ///< their rates
  S *coulomb, *stiction;        ///< zero where an arm of the pack has no friction
  S* sense;                     ///< at the step's beginning: 1 or -1: it slides; 0: it rests, or has no friction
  S *before, *force;            ///< at the step's beginning, and at its end; `force` of resting ones is an unknown
  S *kept_sense, *kept_before;  ///< `sense` and `before` of a step that is taken in parts
  // of this step, by number: held at its end; gone over to sliding along `way`; share of the step before that
  S *held, *over, *way, *share;
  S *end, *pull, *burden;  ///< rate at its end; holding force, and in parts of the stiction
  S *turn, *rhs;           ///< changes of the forces; given forces
  S *W, *G, *columns;      ///< S^-1 of the contacts (count^2); the equations of `turn`; its columns (count nv)
  S* column;               ///< one that is being made (nv)
  S* made;                 ///< whether a column of W is of the last factorisation
  S left;                  ///< rounds of pivoting that are left

  void lay_out(Arena& arena, const int* at_, int count_, int nv_) {
    at = at_;
    count = count_;
    nv = nv_;
    arena.take_zeros(count, coulomb, stiction, sense, before, force, held, over, way);
    arena.take_zeros(count, share, end, pull, burden, turn, rhs, made);
    arena.take_zeros(count, kept_sense, kept_before);
    arena.take_zeros(count * count, W, G);
    arena.take_zeros(count * nv, columns);
    arena.take_zeros(nv, column);
    left = S{};
  }

  static S yes(const Mask& m) { return L::select(m, number<S>(1.0), S{}); }
  static Mask is(const S& x) { return x > 0.5; }
  static S sign(const S& x) { return L::select(x > 0.0, number<S>(1.0), L::select(x < 0.0, number<S>(-1.0), S{})); }
  static S part(const S& x) { return L::larger(S{}, L::smaller(number<S>(1.0), x)); }

  /// Where there is friction at all.
  Mask anywhere() const {
    Mask found = L::everywhere(false);
    for (int c = 0; c < count; ++c) found = found | (stiction[c] > 0.0);
    return found;
  }

  /// For a step that is taken in parts, more than once.
  void keep_beginning() {
    for (int c = 0; c < count; ++c) {
      kept_sense[c] = sense[c];
      kept_before[c] = before[c];
    }
  }
  void go_back(const Mask& where) {
    for (int c = 0; c < count; ++c) {
      sense[c] = L::select(where, kept_sense[c], sense[c]);
      before[c] = L::select(where, kept_before[c], before[c]);
    }
  }
  /// At the beginning of a step.
  void begin_step(const Mask& where) {
    left = L::select(where, number<S>(4.0 + 6.0 * count), left);
    for (int c = 0; c < count; ++c) {
      held[c] = L::select(where, yes((stiction[c] > 0.0) & (sense[c] == 0.0)), held[c]);
      over[c] = L::select(where, S{}, over[c]);
      way[c] = L::select(where, S{}, way[c]);
      share[c] = L::select(where, S{}, share[c]);
      force[c] = L::select(where, before[c], force[c]);
    }
  }
  /// At a state where joints at rest may stick: forces at an instant. Sliding joints keep their direction.
  void begin_instant(const S* v) {
    left = number<S>(4.0 + 6.0 * count);
    for (int c = 0; c < count; ++c) {
      const S way_now = sign(v[at[c]]);
      held[c] = yes((stiction[c] > 0.0) & (way_now == 0.0));
      over[c] = way[c] = share[c] = S{};
      force[c] = -coulomb[c] * way_now;
    }
  }
  /// At a state between two switches: sticking joints stay so, by any force, and sliding ones keep their direction.
  void begin_between() {
    left = S{};
    for (int c = 0; c < count; ++c) {
      held[c] = yes((stiction[c] > 0.0) & (sense[c] == 0.0));
      over[c] = way[c] = share[c] = S{};
      force[c] = -coulomb[c] * sense[c];
    }
  }

  /// Accelerations under dry friction. `between`: see begin_between; else those at rest get a force that holds them, as
  /// far as it may.
  /// @param own, rest, turned  memory (nv each)
  /// @return where the mass matrix is positive definite; `force` has the forces of friction
  Mask accelerate(Engine& engine, const S* q, const S* v, const S* tau, S* x, const Mask& where, S* own, S* rest,
                  S* turned, bool between) {
    for (int k = 0; k < engine.free_count; ++k) x[engine.free[k]] = S{};
    engine.inverse(q, v, x, own, true);
    S twice;
    const Mask good = engine.factor(flexarm::lanes::Shift{}, twice);
    refactored(L::everywhere(true));
    if (between)
      begin_between();
    else
      begin_instant(v);
    take_from(own);
    for (int k = 0; k < engine.free_count; ++k) rest[engine.free[k]] = tau[engine.free[k]] - own[engine.free[k]];
    if (L::all(L::none_of(good))) return good;
    engine.solve(rest, turned);
    if (engine.closes()) engine.close_accelerations(turned);
    resolve(engine, turned, nullptr, nullptr, 1.0, 1.0, where & good, own);
    for (int k = 0; k < engine.free_count; ++k) x[engine.free[k]] = turned[engine.free[k]];
    return good;
  }

  /// Forces of friction out of those that a motion needs. @return the largest
  S take_from(S* needed) const {
    S largest{};
    for (int c = 0; c < count; ++c) {
      needed[at[c]] -= force[c];
      largest = L::larger(largest, L::size(force[c]));
    }
    return largest;
  }

  /// Column c of W in the arms that need it and have not got it since the last factorisation; the others' is left as it
  /// is, so that an arm's digits do not depend on when its partners need theirs. Joints that slide on need none.
  void make_column(Engine& engine, int c, const Mask& need, S* unit) {
    const Mask now = need & L::none_of(is(made[c]));
    if (!L::any(now)) return;
    made[c] = L::select(now, number<S>(1.0), made[c]);
    for (int i = 0; i < nv; ++i) unit[i] = S{};
    unit[at[c]] = number<S>(1.0);
    engine.solve(unit, column);
    for (int i = 0; i < nv; ++i) columns[c * nv + i] = L::select(now, column[i], columns[c * nv + i]);
    for (int k = 0; k < count; ++k) W[k * count + c] = columns[c * nv + at[k]];
    W[c * count + c] = L::larger(W[c * count + c], number<S>(kLeast));  // at a dead centre of a loop it is rounding
  }
  /// To be called when a matrix has been factored.
  void refactored(const Mask& where) {
    for (int c = 0; c < count; ++c) made[c] = L::select(where, S{}, made[c]);
  }

  /// Changes of the forces under which all that is held comes to rest: rows of W, and known forces elsewhere.
  /// @param tied  whether loops tie joints together: then their forces, when all of them hold, are not unique
  void find_turn(const S* x, const S* rate, double d, bool tied) {
    for (int c = 0; c < count; ++c) {
      const Mask holds = is(held[c]);
      for (int k = 0; k < count; ++k)
        G[c * count + k] = L::select(holds, W[c * count + k], number<S>(c == k ? 1.0 : 0.0));
      if (tied) G[c * count + c] += L::select(holds, kShared * W[c * count + c], S{});
      const S y = rate ? rate[at[c]] * (1.0 / d) : S{};
      turn[c] = L::select(holds, -y - x[at[c]], rhs[c] - force[c]);
    }
    factor_small(G, count);
    solve_small(G, count, turn);
  }

  /// One round, in each arm one of three things: all that has turned back comes to rest; or that one is let go whose
  /// is held by the largest force allowed, or more; or one let go, that would move the wrong way, is held again, and in
  /// later rounds only the first of them (Murty's rule).
  /// @param weight  of the force at the step's end in its mean; @param v0  rates at its beginning; null: an instant
  Mask pivot(const S* x, const S* rate, const S* v0, double d, double weight, const Mask& open, bool late) {
    const S one = number<S>(1.0);
    S worst{}, mark{};  // mark: the share of the step before the last switch
    Mask arresting = L::everywhere(false), marked = arresting, wrong = arresting, changed = arresting;
    for (int c = 0; c < count; ++c) {
      const S s = v0 ? sense[c] : S{};
      S y = x[at[c]];
      for (int k = 0; k < count; ++k) y += W[c * count + k] * turn[k];
      end[c] = d * y + (rate ? rate[at[c]] : S{});
      arresting = arresting | (open & L::none_of(is(held[c]) | is(over[c])) & (s * end[c] < 0.0));
      const Mask switched = (is(held[c]) | is(over[c])) & (s * s > 0.5);
      marked = marked | switched;
      mark = L::select(switched, L::larger(mark, share[c]), mark);
    }
    for (int c = 0; c < count; ++c) {  // holding force since it came to rest, or since the last switch
      const S s = v0 ? sense[c] : S{}, f = force[c] + turn[c], mean = weight * f + (1.0 - weight) * before[c];
      const Mask slides = s * s > 0.5;
      pull[c] = L::select(slides, mean + s * share[c] * coulomb[c], L::select(marked, mean - mark * before[c], f));
      const S most = stiction[c] * L::select(slides, one - share[c], L::select(marked, one - mark, one));
      const Mask beyond = is(held[c]) & (L::size(pull[c]) > most);
      burden[c] = S{};
      if (L::any(open & beyond)) burden[c] = L::select(beyond & (most > 0.0), L::size(pull[c]) / most, S{});
      worst = L::larger(worst, burden[c]);
      wrong = wrong | (is(over[c]) & (way[c] * end[c] < 0.0));
    }
    const Mask releasing = open & L::none_of(arresting) & (left > 0.0) & (worst > 0.0);
    const Mask holding = open & wrong & L::none_of(arresting | releasing);
    if (!L::any(arresting | releasing | holding)) return changed;
    for (int c = 0; c < count; ++c) {
      const S s = v0 ? sense[c] : S{}, f = force[c] + turn[c], p = sign(pull[c]);
      const Mask holds = is(held[c]), gone = is(over[c]), slides = s * s > 0.5;
      const Mask stops = arresting & L::none_of(holds | gone) & (s * end[c] < 0.0);
      const Mask back = holding & gone & (way[c] * end[c] < 0.0) & (late ? L::none_of(changed) : open);
      const Mask go = releasing & holds & (burden[c] >= worst) & L::none_of(changed);
      const Mask turns = go & slides & (s * p > 0.0), breaks = go & L::none_of(slides);
      const S start = v0 ? v0[at[c]] : S{};
      share[c] = L::select(stops, part(start / (start - end[c])), share[c]);
      // forces at the step's end from their means
      const S turned = s * coulomb[c] * ((2.0 - weight) * (1.0 / weight) - (2.0 / weight) * share[c]);
      const S when = L::select(marked, mark, part((p * stiction[c] - before[c]) / (f - before[c])));
      const S held_so_far = L::select(marked, before[c], 0.5 * (before[c] + p * stiction[c]));
      const S mean = when * held_so_far + (one - when) * p * coulomb[c];
      const S broken = v0 ? (mean - (1.0 - weight) * before[c]) * (1.0 / weight) : p * coulomb[c];
      rhs[c] = L::select(go, L::select(turns, turned, L::select(breaks, broken, -s * coulomb[c])), rhs[c]);
      way[c] = L::select(turns | breaks, -p, way[c]);
      over[c] = yes((gone & L::none_of(back)) | turns | breaks);
      held[c] = yes((holds & L::none_of(go)) | stops | back);
      changed = changed | stops | back | go;
    }
    left = left - yes(changed);
    return changed;
  }

  /// Forces of friction for the linear equations of an iteration, of which x is the solution with those of before.
  /// @param rate  at the present iterate, of which d x is the change; null: zero, and x are accelerations
  /// @return where anything was held or let go; `turn` is the change of the forces
  Mask resolve(Engine& engine, S* x, const S* rate, const S* v0, double d, double weight, const Mask& open, S* unit) {
    Mask changed = L::everywhere(false), need = changed;
    for (int c = 0; c < count; ++c) {
      const S y = d * x[at[c]] + (rate ? rate[at[c]] : S{});
      const S along = L::select(is(over[c]), way[c], v0 ? sense[c] : S{});
      rhs[c] = force[c];
      turn[c] = S{};
      need = need | is(held[c]) | (along * y < 0.0);
    }
    if (!L::any(need & open)) return changed;
    for (int round = 0; round < 12 * (count + 1); ++round) {
      for (int c = 0; c < count; ++c) make_column(engine, c, open & (is(held[c]) | (rhs[c] != force[c])), unit);
      find_turn(x, rate, d, engine.closes());
      const Mask now = pivot(x, rate, v0, d, weight, open, round > 2 * count);
      if (!L::any(now)) break;
      changed = changed | now;
    }
    for (int c = 0; c < count; ++c) {
      turn[c] = L::select(open, turn[c], S{});
      force[c] += turn[c];
      if (!L::any(turn[c] != 0.0)) continue;
      for (int i = 0; i < nv; ++i) x[i] += columns[c * nv + i] * turn[c];
    }
    for (int c = 0; c < count; ++c) {  // to the last bit
      const S stop = rate ? -rate[at[c]] * (1.0 / d) : S{};
      x[at[c]] = L::select(is(held[c]), stop, x[at[c]]);
    }
    return changed;
  }

  /// Whether the step that was taken holds, lets go or turns anything, of one arm.
  bool switches() const {
    bool found = false;
    for (int c = 0; c < count; ++c) found = found || is(over[c]) || (is(held[c]) && sense[c] != 0.0);
    return found;
  }
  /// Behind a step, or `begin_instant`: joints at rest are exactly still.
  /// @return where a freedom has come to rest, has been torn loose or has turned
  Mask end_step(S* v, const Mask& where) {
    Mask switched = L::everywhere(false);
    for (int c = 0; c < count; ++c) {
      const Mask holds = is(held[c]), gone = is(over[c]);
      switched = switched | (where & (gone | (holds & (sense[c] != 0.0))));
      v[at[c]] = L::select(where & holds, S{}, v[at[c]]);
      keep(c, where, L::select(holds, S{}, L::select(gone, way[c], sense[c])));
    }
    return switched;
  }
  void end_instant(const S* v, const Mask& where) {
    for (int c = 0; c < count; ++c) keep(c, where, L::select(is(over[c]), way[c], sign(v[at[c]])));
  }
  void keep(int c, const Mask& where, const S& now) {
    sense[c] = L::select(where, L::select(stiction[c] > 0.0, now, S{}), sense[c]);
    before[c] = L::select(where, force[c], before[c]);
  }
};

}  // namespace
