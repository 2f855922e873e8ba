// Explicit Runge-Kutta methods each of whose stages follows from the one before it; whatever rubs goes on as it does
// all through a step. See methods.hpp for their engine and their interface.
#pragma once

#include "door/kernels.hpp"
#include "step/joint_friction.hpp"
#include "wide/scalar.hpp"

namespace {

using flexarm::lanes::MethodOptions;
using flexarm::lanes::MethodTraits;
using flexarm::lanes::Work;

/// @tparam Row  the method's coefficients: of each stage its time, which is a multiple of half a step, and its weight,
///              in parts of their sum
template <class Engine, class Row>
struct RungeKutta {
  using S = typename Engine::Scalar;
  using L = Lanes<S>;
  using Mask = typename L::Mask;
  static constexpr flexarm::lanes::Ending unsolved = flexarm::lanes::not_finite;  // no arm is singular; it has run away

  int nq = 0, nv = 0;
  S *q0, *q_sum, *dq, *v0, *v_sum, *own, *rest, *turned;
  static constexpr int iterations = 0;
  Work work;
  S divisions{}, doubt{};        // no step is divided
  JointFriction<Engine> joints;  // of which none switches within a step

  void lay_out(Arena& arena, int nq_, int nv_, const int* rubbing, int rubbing_count, const MethodOptions&) {
    nq = nq_;
    nv = nv_;
    arena.take_zeros(nq, q0, q_sum, dq);
    arena.take_zeros(nv, v0, v_sum, own, rest, turned);
    joints.lay_out(arena, rubbing, rubbing_count, nv);
  }
  JointFriction<Engine>& friction() { return joints; }

  void forget() {}
  Mask begin(Engine& engine, const S* q, const S* v, const S* tau, S* x, const Mask& where) {
    if (joints.count == 0) return L::everywhere(true);
    const Mask good = accelerate(engine, q, v, tau, x, where);
    joints.end_instant(v, where & good);
    return good;
  }
  Mask accelerate(Engine& engine, const S* q, const S* v, const S* tau, S* x, const Mask& where, bool between = false) {
    if (joints.count == 0) return engine.accelerate(q, v, tau, x);
    return joints.accelerate(engine, q, v, tau, x, where, own, rest, turned, between);
  }
  template <class Given>
  Mask step(Engine& engine, double h, S* q, S* v, const S* tau, S* x, const Given& given, const Mask& skip) {
    constexpr auto& times = Row::times;
    constexpr auto& weights = Row::weights;
    Mask good = L::none_of(skip);
    for (int i = 0; i < nq; ++i) {
      q0[i] = q[i];
      q_sum[i] = S{};
    }
    for (int i = 0; i < nv; ++i) {
      v0[i] = v[i];
      v_sum[i] = S{};
    }
    for (int stage = 0; stage < Row::stages; ++stage) {
      if (stage > 0) {
        for (int i = 0; i < nq; ++i) q[i] = q0[i] + (times[stage] * h) * dq[i];
        for (int i = 0; i < nv; ++i) v[i] = v0[i] + (times[stage] * h) * x[i];
      }
      given(times[stage]);
      good = good & accelerate(engine, q, v, tau, x, good, true);
      ++work.evaluations;
      if (!L::any(good)) return good;
      engine.rates(q, v, dq);
      for (int i = 0; i < nq; ++i) q_sum[i] += weights[stage] * dq[i];
      for (int i = 0; i < nv; ++i) v_sum[i] += weights[stage] * x[i];
    }
    for (int i = 0; i < nq; ++i) q[i] = q0[i] + (h / Row::sum) * q_sum[i];
    for (int i = 0; i < nv; ++i) v[i] = v0[i] + (h / Row::sum) * v_sum[i];
    given(1.0);
    engine.normalise(q);
    if (engine.closes()) engine.project({}, q, v, own);
    return good;
  }
  static constexpr bool asked_at_end() { return false; }
  Mask accept(double, S*, S*, const Mask&) {
    for (int c = 0; c < joints.count; ++c) joints.before[c] = joints.force[c];
    return L::everywhere(false);
  }
};

/// The classical method of fourth order.
struct Rk4 {
  static constexpr MethodTraits traits{"rk4", false, false, false, 2.83};
  static constexpr int stages = 4;
  static constexpr double times[] = {0.0, 0.5, 0.5, 1.0}, weights[] = {1.0, 2.0, 2.0, 1.0}, sum = 6.0;
  template <class Engine>
  using On = RungeKutta<Engine, Rk4>;
};

}  // namespace
