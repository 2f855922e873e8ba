// Scenarios in fixed steps: side by side, one in each lane, or one alone with the points of its beams across the lanes.
#pragma once

#include "arm/elimination.hpp"
#include "door/kernels.hpp"
#include "step/feedback.hpp"
#include "step/methods.hpp"

namespace {

using flexarm::lanes::Roll;

/// A chain, with feedback, as the methods see it (methods.hpp).
template <class C>
struct Rolled {
  using Sp = typename C::Space;
  using Scalar = typename C::S;
  using S = Scalar;
  using L = Lanes<S>;
  using Mask = typename L::Mask;

  const Roll& job;
  C chain;
  typename Sp::Lin base;
  const int* free;
  int free_count, nq, nv;
  FeedbackLaws<S> laws;
  S weight;
  S* total;  // nv
  const S *q_now = nullptr, *v_now = nullptr;

  Rolled(const Roll& j, Arena& arena)
      : job(j),
        chain(*j.layout, j.numbers, arena),
        free(j.free),
        free_count(j.free_count),
        nq(j.layout->nq),
        nv(j.layout->nv),
        laws{j.laws, nq, nv, j.column, j.by_q, j.by_v, j.limit, j.limits, j.limited, j.most},
        weight(L::load(j.weight)) {
    base = chain.base();
    arena.take(nv, total);
    laws.lay_out(arena);
  }
  static S of(const double* table, int i) { return L::load(table + i * L::width); }

  void place(const S* q0, const S* u, S* q) const { displace(chain.layout, q0, u, q); }
  void rates(const S* q, const S* v, S* dq) const { coordinate_rates(chain.layout, q, v, dq); }
  void normalise(S* q) const { ::normalise(chain.layout, q); }
  int coordinate(int i) const { return job.coordinate[i]; }
  void inverse(const S* q, const S* v, const S* a, S* tau, bool) {
    chain.move(q, v);
    chain.forces(base, a, tau);
    accelerate_loops(chain, base, a);
    laws.add(q, v, -1.0, tau);
    q_now = q;
    v_now = v;
  }
  Mask factor(const Shift& shift, S& twice) {
    twice = chain.twice_kinetic(v_now);
    const Mask good = ::factor(chain, shift);
    laws.factor(
        shift, q_now, v_now, free, free_count, [&](int i) { return job.coordinate[i]; },
        [&](int c) { return job.limited[c]; }, [&](int c) { return laws.given[job.limited[c]]; },
        [&](const S* r, S* x) { ::solve(chain, r, x); });
    return good;
  }
  void solve(const S* r, S* x) {
    ::solve(chain, r, x);
    laws.correct(x);
  }
  Mask correction(S* r, S* x) {
    solve_step(chain, r, x);
    return laws.correct_within(q_now, v_now, [&](int c) { return laws.given[job.limited[c]]; }, x);
  }
  bool closes() const { return chain.layout.rigid_rows > 0; }
  S close_places(const Shift& shift, S* w) {
    return chain.by_state->loops.close_places(chain.layout, w, shift.stiffness);
  }
  void close_accelerations(S* x) { chain.by_state->loops.close_accelerations(chain.layout, x); }
  S close_rates(const Shift& shift, S* z) { return chain.by_state->loops.close_rates(chain.layout, z, shift.damping); }
  void hold_change(const Mask& open) { chain.by_state->loops.hold_change(chain.layout, open); }
  void let_go() { chain.by_state->loops.let_go(chain.layout); }
  Mask closed() const { return chain.by_state->loops.closed(chain.layout); }
  void project(const Shift& shift, S* q, S* v, S* scratch) { ::project(chain, shift, q, v, scratch); }
  void shut(S* q, S* v, S* scratch) { ::shut(chain, q, v, scratch); }
  void step_contacts(double by_end) {
    if (chain.layout.contacts > 0) chain.by_state->by_end = by_end;
  }
  Mask met() const { return chain.layout.contacts > 0 ? chain.by_state->met(chain.layout) : L::everywhere(false); }
  /// A run's memory of contacts goes on from here.
  /// @param there  whether the chain is there
  void remember(const S* q, const S* v, const Mask& where, bool there) {
    if (chain.layout.contacts == 0) return;
    if (!there) chain.move(q, v);
    chain.by_state->remember(chain.layout, where);
  }
  /// Accelerations into x, which holds those that are given.
  Mask accelerate(const S* q, const S* v, const S* tau, S* x) {
    for (int i = 0; i < nv; ++i) total[i] = tau[i];
    laws.add(q, v, 1.0, total);
    chain.move(q, v);
    return ::forward(chain, base, total, x);
  }
};

/// Scenarios on a chain by a method.
template <class C, template <class> class M>
struct Roller {
  using Arms = Rolled<C>;
  using Method = M<Arms>;
  using S = typename Arms::S;
  using L = Lanes<S>;
  using Mask = typename L::Mask;
  static constexpr int W = L::width;

  Roll& job;
  Arms arms;
  Method method;
  S *q, *v, *tau, *x, *y, *forces, *rest, *spare, *reactions, *changed;
  Mask lost = L::everywhere(false);

  Roller(Roll& j, Arena& arena) : job(j), arms(j, arena) {
    const int nq = j.layout->nq, nv = j.layout->nv;
    arena.take(nq, q);
    arena.take(nv, v, tau, y, forces, rest, spare);
    arena.take_zeros(nv, x);
    arena.take(3 * j.layout->contacts + 6 * j.layout->loops, reactions);
    arena.take(1, changed);
    arms.laws.given = tau;
    method.lay_out(arena, nq, nv, j.rubbing, j.rubs, j.options);
    if (arena.counts()) return;
    for (int c = 0; c < j.rubs; ++c) {
      method.friction().coulomb[c] = arms.of(j.coulomb, c);
      method.friction().stiction[c] = arms.of(j.stiction, c);
    }
  }

  static double* raw(S* p) { return view<double>(p); }
  void set(long half) {
    job.scenarios->set(half, raw(q), raw(v), raw(x), raw(tau), raw(arms.laws.offset), raw(arms.chain.wrench));
  }
  void lose(const Mask& where, int status, long step) {
    for (int l = 0; l < W; ++l)
      if (L::lane(where, l) && !L::lane(lost, l)) {
        job.status[l] = status;
        job.reached[l] = step;
      }
    lost = lost | where;
  }
  Mask finite(const S* z) const {
    Mask fine = L::everywhere(true);
    for (int i = 0; i < arms.nv; ++i) fine = fine & L::finite(z[i]);
    return fine;
  }
  void lose_runaways(long step) {
    Mask fine = L::everywhere(true);
    for (int i = 0; i < arms.nq; ++i) fine = fine & (L::size(q[i]) <= arms.of(job.farthest, i));
    for (int i = 0; i < arms.nv; ++i) fine = fine & (L::size(v[i]) <= arms.of(job.fastest, i));
    lose(L::none_of(fine), flexarm::lanes::not_finite, step);
  }
  /// Begins at the present state and forces, where they have changed.
  void begin(const Mask& where, long step) {
    const Mask bad = where & L::none_of(method.begin(arms, q, v, tau, x, where));
    lose(bad & L::none_of(finite(x)), flexarm::lanes::not_finite, step);
    lose(bad, flexarm::lanes::singular, step);
  }
  void take(long step) {
    const double h = job.length[step];
    const auto given = [&](double c) {
      if (job.varies) set(2 * step + static_cast<long>(2.0 * c));
    };
    const Mask good = method.step(arms, h, q, v, tau, x, given, lost), bad = L::none_of(good);
    lose(bad & L::none_of(finite(tau)), flexarm::lanes::not_finite, step);
    lose(bad, Method::unsolved, step);
    const Mask other = method.accept(h, v, x, good);
    arms.remember(q, v, good & L::none_of(other), method.asked_at_end());
    if (!L::any(other)) return;
    begin(other, step);
    arms.remember(q, v, good & other, true);
  }

  /// Lets controllers look, and other forces act, where `step` steps are taken. @return where other forces act
  Mask change(long step) {
    const int due = job.scenarios->due(step);
    if (due == 0) return L::everywhere(false);
    if (due > 1) {
      for (int i = 0; i < arms.nv; ++i) y[i] = x[i];
      method.accelerate(arms, q, v, tau, y, L::everywhere(true));
    }
    if (!job.scenarios->change(step, raw(q), raw(v), raw(y), raw(changed))) return L::everywhere(false);
    set(2 * step);
    return *changed > 0.5;
  }

  void write(long step) {
    const int wanted = job.scenarios->wanted(step);
    if (wanted == 0) return;
    for (int i = 0; i < arms.nv; ++i) y[i] = x[i];
    if (wanted > 1) {
      const Mask good = method.accelerate(arms, q, v, tau, y, L::everywhere(true));
      arms.inverse(q, v, y, forces, false);
      lose(L::none_of(good & finite(y) & finite(forces)), flexarm::lanes::not_finite, step);
      for (int i = 0; i < arms.nv; ++i) arms.total[i] = tau[i];
      arms.laws.add(q, v, 1.0, arms.total);
      for (int c = 0; c < job.limits; ++c) {  // to the last digit
        S& force = arms.total[job.limited[c]];
        force = arms.laws.within(c, force);
      }
      arms.laws.add(q, v, 1.0, forces);  // the reactions of prescribed motions alone
      if (arms.chain.layout.loops > 0) take_reactions();
      for (int k = 0; k < arms.free_count; ++k) forces[arms.free[k]] = arms.total[arms.free[k]];
      for (int c = job.rubs; c < job.rubs + job.rubs_given; ++c) {  // a drive must overcome the friction, too
        const S speed = v[job.rubbing[c]], most = arms.of(job.coulomb, c);
        forces[job.rubbing[c]] += L::select(speed > 0.0, most, L::select(speed < 0.0, -most, S{}));
      }
    }
    if (wanted > 1 && arms.chain.layout.contacts > 0)
      arms.chain.by_state->put_contact_forces(arms.chain.layout, reactions);
    job.scenarios->row(raw(q), raw(v), raw(y), raw(forces), raw(reactions), job.status);
  }
  /// Takes the forces of loops off those that inverse dynamics has found, beyond contacts into `reactions`.
  void take_reactions() {
    for (int i = 0; i < arms.nv; ++i) rest[i] = forces[i] - arms.total[i];
    method.friction().take_from(rest);
    ::react(arms.chain, rest, spare);
    for (int i = 0; i < arms.nv; ++i) forces[i] -= rest[i];
    arms.chain.by_state->loops.put_forces(arms.chain.layout, reactions + 3 * arms.chain.layout.contacts);
  }

  /// From the state in `memory` (see isa.cpp).
  void run(const double* q0, const double* v0) {
    for (int i = 0; i < arms.nq; ++i) q[i] = arms.of(q0, i);
    for (int i = 0; i < arms.nv; ++i) v[i] = arms.of(v0, i);
    arms.normalise(q);
    set(0);
    arms.remember(q, v, L::everywhere(true), false);
    change(0);
    begin(L::everywhere(true), 0);
    if (job.watched) job.scenarios->look(0, raw(q), raw(v), raw(changed));
    write(0);
    long step = 0;
    while (step < job.steps && !L::all(lost)) {
      if (!job.scenarios->alive(step)) {
        lose(L::none_of(lost), flexarm::lanes::not_done, step);
        break;
      }
      take(step);
      lose_runaways(step);
      ++step;
      Mask ended = L::everywhere(false);
      if (job.watched && job.scenarios->look(step, raw(q), raw(v), raw(changed))) ended = *changed > 0.5;
      const Mask other = change(step);
      if (L::any(other)) begin(other, step);
      write(step);
      lose(ended, flexarm::lanes::ended, step);
    }
    for (int l = 0; l < W; ++l)
      if (!L::lane(lost, l)) job.reached[l] = step;
    job.work = method.work;
    L::store(job.divided, method.divisions);
    L::store(job.doubt, method.doubt);
  }
};

}  // namespace
