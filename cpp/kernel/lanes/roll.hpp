// Scenarios side by side, one in each lane, in fixed steps.
#pragma once

#include "lanes/alpha.hpp"
#include "lanes/chain.hpp"
#include "lanes/kernels.hpp"

namespace {

using flexarm::lanes::Roll;

/// A chain, with feedback, as the methods see it.
template <class Sp>
struct Rolled {
  using Scalar = Pack;
  using Mask = PackMask;
  using L = Lanes<Pack>;
  using C = Chain<Sp, Pack>;

  const Roll& job;
  C chain;
  typename Sp::Lin base;
  const int* free;
  int free_count, nq, nv, laws;
  Pack* offset;                            // laws
  Pack *total, *slopes, *columns, *G, *y;  // nv; nv laws; nv laws; laws^2; laws
  const Pack *q_now = nullptr, *v_now = nullptr;

  static std::size_t memory(const Roll& j) {
    const std::size_t nv = static_cast<std::size_t>(j.layout->nv), n = static_cast<std::size_t>(j.laws);
    return C::memory_needed(*j.layout) + (nv + 2 * n * nv + n * n + 2 * n) * sizeof(Pack);
  }
  Rolled(const Roll& j, char* at)
      : job(j),
        chain(*j.layout, j.numbers, at),
        base(first(j.numbers)),
        free(j.free),
        free_count(j.free_count),
        nq(j.layout->nq),
        nv(j.layout->nv),
        laws(j.laws) {
    total = reinterpret_cast<Pack*>(at + C::memory_needed(*j.layout));
    slopes = total + nv;
    columns = slopes + laws * nv;
    G = columns + laws * nv;
    y = G + laws * laws;
    offset = y + laws;
    for (int i = 0; i < laws; ++i) offset[i] = Pack{};
  }
  static typename Sp::Lin first(const double* p) { return Sp::read(p); }
  static Pack of(const double* table, int i) { return L::load(table + i * FLEXARM_WIDTH); }

  void place(const Pack* q0, const Pack* u, Pack* q) const {
    for (int k = 0; k < free_count; ++k) {
      const int c = job.coordinate[free[k]];
      q[c] = q0[c] + u[free[k]];
    }
  }
  /// A law's force (see Feedback), and where it is at its limit.
  Pack force(int law, const Pack* q, const Pack* v, PackMask& limited) const {
    Pack u = offset[law];
    for (int i = 0; i < nq; ++i) u -= of(job.by_q, law * nq + i) * q[i];
    for (int i = 0; i < nv; ++i) u -= of(job.by_v, law * nv + i) * v[i];
    const Pack most = of(job.limit, law);
    limited = L::size(u) >= most;
    return L::smaller(most, L::larger(-most, u));  // in this order, what is not a number stays so
  }
  void add_feedback(const Pack* q, const Pack* v, double sign, Pack* tau) const {
    for (int l = 0; l < laws; ++l) {
      PackMask limited;
      const Pack u = sign * force(l, q, v, limited);
      for (int i = 0; i < nv; ++i) tau[i] += u * of(job.column, l * nv + i);
    }
  }

  void inverse(const Pack* q, const Pack* v, const Pack* a, Pack* tau, bool) {
    chain.move(q, v);
    chain.forces(base, a, tau);
    add_feedback(q, v, -1.0, tau);
    q_now = q;
    v_now = v;
  }
  PackMask factor(const Shift& shift, Pack& twice) {
    twice = chain.twice_kinetic(v_now);
    const PackMask good = chain.template inward<true, false, false>(nullptr, nullptr, shift);
    for (int l = 0; l < laws; ++l) {  // Woodbury's formula for S + column slopes^T, as in ab.cpp
      PackMask limited;
      force(l, q_now, v_now, limited);
      Pack* s = slopes + l * nv;
      for (int i = 0; i < nv; ++i) s[i] = total[i] = Pack{};
      for (int k = 0; k < free_count; ++k) {
        const int i = free[k];
        const Pack slope =
            shift.damping * of(job.by_v, l * nv + i) + shift.stiffness * of(job.by_q, l * nq + job.coordinate[i]);
        s[i] = L::select(limited, Pack{}, slope);
      }
      for (int i = 0; i < nv; ++i) total[i] = of(job.column, l * nv + i);
      solve_chain(total, columns + l * nv);
    }
    for (int i = 0; i < laws; ++i)
      for (int j = 0; j < laws; ++j) {
        Pack sum = number<Pack>(i == j ? 1.0 : 0.0);
        for (int k = 0; k < nv; ++k) sum += slopes[i * nv + k] * columns[j * nv + k];
        G[i * laws + j] = sum;
      }
    for (int k = 0; k < laws; ++k)  // G = L U, below the diagonal L, above it U
      for (int i = k + 1; i < laws; ++i) {
        const Pack l = G[i * laws + k] / G[k * laws + k];
        G[i * laws + k] = l;
        for (int j = k + 1; j < laws; ++j) G[i * laws + j] -= l * G[k * laws + j];
      }
    return good;
  }
  void solve_chain(const Pack* r, Pack* x) {
    chain.template inward<false, true, false>(r, nullptr, Shift{});
    for (int i = 0; i < nv; ++i) x[i] = Pack{};
    chain.template outward<false>(Sp::zero(), x);
  }
  void solve(const Pack* r, Pack* x) {
    solve_chain(r, x);
    if (laws == 0) return;
    for (int i = 0; i < laws; ++i) {
      Pack sum{};
      for (int k = 0; k < nv; ++k) sum += slopes[i * nv + k] * x[k];
      for (int j = 0; j < i; ++j) sum -= G[i * laws + j] * y[j];
      y[i] = sum;
    }
    for (int i = laws; i-- > 0;) {
      Pack sum = y[i];
      for (int j = i + 1; j < laws; ++j) sum -= G[i * laws + j] * y[j];
      y[i] = sum / G[i * laws + i];
      for (int k = 0; k < nv; ++k) x[k] -= columns[i * nv + k] * y[i];
    }
  }
  /// Accelerations into x, which holds those that are given.
  PackMask accelerate(const Pack* q, const Pack* v, const Pack* tau, Pack* x) {
    for (int i = 0; i < nv; ++i) total[i] = tau[i];
    add_feedback(q, v, 1.0, total);
    chain.move(q, v);
    const PackMask good = chain.template inward<true, true, true>(total, x, Shift{});
    chain.template outward<true>(base, x);
    return good;
  }
};

template <class Sp>
struct Roller {
  using L = Lanes<Pack>;
  static constexpr int W = FLEXARM_WIDTH;
  enum { singular = 1, not_converged = 2, not_finite = 3, not_done = 4 };

  static std::size_t memory(const Roll& j) {
    const std::size_t nq = static_cast<std::size_t>(j.layout->nq), nv = static_cast<std::size_t>(j.layout->nv);
    return Rolled<Sp>::memory(j) +
           (2 * nq + 6 * nv + 1 + Alpha<Rolled<Sp>>::scalars(j.layout->nq, j.layout->nv, j.rubs)) * sizeof(Pack);
  }

  Roll& job;
  Rolled<Sp> arms;
  Alpha<Rolled<Sp>> alpha;
  Pack *q, *q_kept, *v, *v_kept, *tau, *x, *rate, *scratch, *changed;
  PackMask lost = L::everywhere(false);

  Roller(Roll& j, char* at) : job(j), arms(j, at) {
    const int nq = j.layout->nq, nv = j.layout->nv;
    Pack* p = reinterpret_cast<Pack*>(at + Rolled<Sp>::memory(j));
    Pack **of_q[] = {&q, &q_kept}, **of_v[] = {&v, &v_kept, &tau, &x, &rate, &scratch};
    for (Pack** y : of_q) {
      *y = p;
      p += nq;
    }
    for (Pack** y : of_v) {
      *y = p;
      p += nv;
    }
    changed = p++;
    alpha.lay_out(p, nq, nv, j.rubbing, j.rubs);
    for (int c = 0; c < j.rubs; ++c) {
      alpha.contacts.coulomb[c] = L::load(j.coulomb + c * W);
      alpha.contacts.stiction[c] = L::load(j.stiction + c * W);
    }
    alpha.o = AlphaOptions::of(j.spectral_radius, j.rtol, j.max_iterations);
    alpha.contraction = number<Pack>(1.0);
    alpha.scale = Pack{};
    alpha.weight = L::load(j.weight);
    for (int i = 0; i < nv; ++i) x[i] = Pack{};
  }

  void set(long step, long half) {
    const auto raw = [](Pack* p) { return reinterpret_cast<double*>(p); };
    job.set(job.context, step, half, raw(q), raw(v), raw(x), raw(tau), raw(arms.offset), raw(arms.chain.wrench));
  }
  void lose(const PackMask& where, int status, long step) {
    for (int l = 0; l < W; ++l)
      if (L::lane(where, l) && !L::lane(lost, l)) {
        job.status[l] = status;
        job.reached[l] = step;
      }
    lost = lost | where;
  }
  void lose_runaways(long step) {
    PackMask fine = L::everywhere(true);
    for (int i = 0; i < arms.nq; ++i) fine = fine & (L::size(q[i]) <= arms.of(job.farthest, i));
    for (int i = 0; i < arms.nv; ++i) fine = fine & (L::size(v[i]) <= arms.of(job.fastest, i));
    lose(~fine, not_finite, step);
  }
  /// Begins at the present state and forces, where they have changed.
  void begin(const PackMask& where, long step) {
    ++alpha.evaluations;
    lose_runaways(step);
    const PackMask good = accelerate(x, where);
    PackMask fine = L::everywhere(true);
    for (int i = 0; i < arms.nv; ++i) fine = fine & L::finite(x[i]);
    lose(~fine & where, not_finite, step);
    lose(~good & where, singular, step);
    alpha.begin(x, where);
    alpha.contacts.end_instant(v, where);
  }
  /// Accelerations under dry friction into y, which holds those that are given. Scenarios without friction get what
  /// they get in a pack that has none.
  PackMask accelerate(Pack* y, const PackMask& where) {
    const PackMask rubs = alpha.contacts.anywhere();
    if (!L::any(rubs)) return arms.accelerate(q, v, tau, y);
    PackMask good = alpha.settle(arms, q, v, tau, y, where);
    if (L::all(rubs)) return good;
    for (int i = 0; i < arms.nv; ++i) alpha.turn[i] = y[i];
    good = (good & rubs) | (arms.accelerate(q, v, tau, alpha.turn) & ~rubs);
    for (int i = 0; i < arms.nv; ++i) y[i] = L::select(rubs, y[i], alpha.turn[i]);
    return good;
  }

  void implicit_step(long step, double h) {
    for (int i = 0; i < arms.nv; ++i) alpha.v0[i] = v[i];
    if (job.varies) set(step, 2 * step + 2);
    for (int i = 0; i < arms.nq; ++i) alpha.q0[i] = q[i];  // free ones are still those of the beginning
    alpha.predict(arms, h, x);
    const PackMask good = alpha.iterate(arms, h, q, v, tau, lost);
    PackMask ran_away = L::everywhere(false);
    for (int i = 0; i < arms.nv; ++i) ran_away = ran_away | ~L::finite(tau[i]);
    lose(~good & ran_away, not_finite, step);
    lose(~good, not_converged, step);
    alpha.end(h, good);
    const PackMask switched = alpha.contacts.end_step(v, good);
    if (L::any(switched)) begin(switched, step);  // other forces act from here on
  }

  void rk4_step(long step, double h) {
    const double times[] = {0.0, 0.5, 0.5, 1.0}, weights[] = {1.0, 2.0, 2.0, 1.0};
    Pack *q_sum = alpha.q0, *v_sum = alpha.v0;
    for (int i = 0; i < arms.nq; ++i) {
      q_kept[i] = q[i];
      q_sum[i] = Pack{};
    }
    for (int i = 0; i < arms.nv; ++i) {
      v_kept[i] = v[i];
      v_sum[i] = Pack{};
    }
    for (int stage = 0; stage < 4; ++stage) {
      if (stage > 0) {
        for (int i = 0; i < arms.nv; ++i) {
          const int c = job.coordinate[i];
          q[c] = q_kept[c] + (times[stage] * h) * rate[i];
          v[i] = v_kept[i] + (times[stage] * h) * x[i];
        }
      }
      if (job.varies) set(step, 2 * step + (stage + 1) / 2);
      ++alpha.evaluations;
      lose(~arms.accelerate(q, v, tau, x), not_finite, step);
      for (int i = 0; i < arms.nv; ++i) {
        rate[i] = v[i];
        q_sum[job.coordinate[i]] += weights[stage] * v[i];
        v_sum[i] += weights[stage] * x[i];
      }
    }
    for (int i = 0; i < arms.nq; ++i) q[i] = q_kept[i] + (h / 6.0) * q_sum[i];
    for (int i = 0; i < arms.nv; ++i) v[i] = v_kept[i] + (h / 6.0) * v_sum[i];
    if (job.varies) set(step, 2 * step + 2);
  }

  void write(long step) {
    const int wanted = job.wanted(job.context, step);
    if (wanted == 0) return;
    for (int i = 0; i < arms.nv; ++i) rate[i] = x[i];
    if (wanted > 1) {
      accelerate(rate, L::everywhere(true));
      arms.inverse(q, v, rate, scratch, false);
      for (int i = 0; i < arms.nv; ++i) arms.total[i] = tau[i];
      arms.add_feedback(q, v, 1.0, arms.total);
      arms.add_feedback(q, v, 1.0, scratch);  // the reactions of what is prescribed, and of nothing else
      for (int k = 0; k < arms.free_count; ++k) scratch[arms.free[k]] = arms.total[arms.free[k]];
      for (int c = job.rubs; c < job.rubs + job.rubs_given; ++c) {  // a drive must overcome the friction, too
        const Pack speed = v[job.rubbing[c]], most = L::load(job.coulomb + c * W);
        scratch[job.rubbing[c]] += L::select(speed > 0.0, most, L::select(speed < 0.0, -most, Pack{}));
      }
    }
    const auto raw = [](const Pack* p) { return reinterpret_cast<const double*>(p); };
    job.row(job.context, raw(q), raw(v), raw(rate), raw(scratch), job.status);
  }

  /// From the state in `memory` (see isa.cpp).
  void run(const double* q0, const double* v0) {
    for (int i = 0; i < arms.nq; ++i) q[i] = L::load(q0 + i * W);
    for (int i = 0; i < arms.nv; ++i) v[i] = L::load(v0 + i * W);
    set(0, 0);
    if (job.implicit) begin(L::everywhere(true), 0);
    write(0);
    long step = 0;
    for (; step < job.steps && !L::all(lost); ++step) {
      if (!job.alive(job.context, step)) {
        lose(~lost, not_done, step);
        break;
      }
      if (step > 0 && job.jumps(job.context, step, reinterpret_cast<double*>(changed))) {
        set(step, 2 * step);
        if (job.implicit) begin(*changed > 0.5, step);
      }
      if (job.implicit)
        implicit_step(step, job.length[step]);
      else
        rk4_step(step, job.length[step]);
      lose_runaways(step);
      write(step + 1);
    }
    for (int l = 0; l < W; ++l)
      if (!L::lane(lost, l)) job.reached[l] = step;
    job.evaluations = alpha.evaluations;
    job.factorisations = alpha.factorisations;
    job.solves = alpha.solves;
  }
};

}  // namespace
