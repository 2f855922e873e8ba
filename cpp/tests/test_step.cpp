#include <doctest/doctest.h>

#include "arms.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/collocation.hpp"
#include "flexarm/simulate.hpp"
#include "flexarm/step_derivatives.hpp"
#include "space/ball.hpp"

namespace test_step {
using namespace flexarm;

namespace {

/// M + shift.damping D + shift.stiffness K, written down in full; `passive`: slopes by q and by v of joint coordinates.
Eigen::MatrixXd dense(const Arm& arm, Workspace& ws, const Shift& shift,
                      const std::vector<std::tuple<int, double, double>>& passive) {
  composite_mass_matrix(arm, ws);
  Eigen::MatrixXd S = ws.M;
  for (std::size_t n = 0; n < arm.size(); ++n) {
    const Link& link = arm.link(n);
    if (!link.beam()) continue;
    auto block = S.block(arm.first(n) + link.nj(), arm.first(n) + link.nj(), link.ne(), link.ne());
    block += shift.damping * link.beam()->damping() + shift.stiffness * link.beam()->stiffness();
  }
  for (const auto& [i, by_q, by_v] : passive) S(i, i) += shift.stiffness * by_q + shift.damping * by_v;
  return S;
}

void check_solve(const Arm& arm, const Eigen::VectorXd& q, const std::vector<bool>& prescribed,
                 const std::vector<std::tuple<int, double, double>>& passive) {
  const Eigen::VectorXd v = flexarm_test::wave(arm.nv(), 0.4);
  for (double h : {0.0, 1e-3, 1.0}) {
    const Shift shift{0.5 * h, 0.25 * h * h};
    Workspace ws(arm, prescribed), other(arm);
    move_arm(arm, ws, q, v);
    move_arm(arm, other, q, v);
    const Eigen::MatrixXd S = dense(arm, other, shift, passive);
    REQUIRE(factor_shifted(arm, ws, q, v, shift) == Status::ok);
    CHECK(ws.twice_kinetic == doctest::Approx(v.dot(other.M * v)).epsilon(1e-12));
    for (double phase : {0.0, 1.0}) {  // two right sides, one factorisation
      const Eigen::VectorXd r = flexarm_test::wave(arm.nv(), phase, 1.0);
      Eigen::VectorXd x = Eigen::VectorXd::Constant(arm.nv(), 7.0);
      solve_shifted(arm, ws, r, x);
      const Eigen::VectorXd back = S * x;
      for (int i = 0; i < arm.nv(); ++i) {
        if (ws.prescribed[i])
          CHECK(x[i] == 0.0);
        else
          CHECK(std::abs(back[i] - r[i]) < 1e-9 * S.row(i).cwiseAbs().dot(x.cwiseAbs()));
      }
    }
  }
}

Arm swinging(double spring) {  // a slider with spring, damper and a stop at 0.1 m, and a pendulum on it
  const JointForce f{spring, 0.0, 0.4, -1.0, 0.1, 900.0, 0.0};
  const Joint slider({{false, Eigen::Vector3d::UnitX()}}, false, {"prismatic"}, {f});
  std::vector<Link> links;
  links.emplace_back(slider, flexarm_test::body(1.0, {0.1, 0, 0}), std::nullopt, std::nullopt);
  links.emplace_back(Joint::revolute({0, 1, 0}), flexarm_test::body(0.5, {0.1, 0, 0}),
                     flexarm_test::beam({2, 1, 0, 1, 0}, 2), std::nullopt);
  return Arm(std::move(links), {0, 0, -9.81});
}

}  // namespace

TEST_CASE("the shifted solve is that of the dense matrix, with prescribed coordinates left out") {
  const Arm spatial = flexarm_test::spatial_arm(), floating = flexarm_test::floating_arm();
  std::vector<bool> some(static_cast<std::size_t>(spatial.nv()), false);
  check_solve(spatial, flexarm_test::wave(spatial.nq(), 0.1), some, {});
  some[1] = some[static_cast<std::size_t>(spatial.first(2))] = true;
  check_solve(spatial, flexarm_test::wave(spatial.nq(), 0.1), some, {});
  const int ball = floating.first(1);
  check_solve(floating, floating.zero() + flexarm_test::wave(floating.nq(), 0.1), {},
              {{ball, 0.0, 0.1}, {ball + 1, 0.0, 0.1}, {ball + 2, 0.0, 0.1}});
  const Arm spring = swinging(30.0);
  Eigen::VectorXd q = flexarm_test::wave(spring.nq(), 0.1);
  check_solve(spring, q, {}, {{0, 30.0, 0.4}});
  q[0] = 0.2;  // in the stop
  check_solve(spring, q, {}, {{0, 930.0, 0.4}});
}

TEST_CASE("an implicit step as in the README: a stiff arm swings at a step far above its fast periods") {
  const Arm arm = swinging(0.0);
  Workspace ws(arm);
  ImplicitStep step(arm, 1e-3);
  Eigen::VectorXd q = arm.zero(), v = Eigen::VectorXd::Zero(arm.nv());
  const Eigen::VectorXd tau = v;
  const Energy before = energy(arm, ws, q, v);
  double swing = 0.0;
  for (int k = 0; k < 500; ++k) {
    REQUIRE(step(ws, q, v, tau) == Status::ok);
    CHECK(step.iterations() <= 6);
    swing = std::max(swing, std::abs(q[1]));
  }
  CHECK(swing > 1.0);
  const Energy after = energy(arm, ws, q, v);  // the slider's damper takes some
  CHECK(after.kinetic + after.potential < before.kinetic + before.potential + 1e-4);
}

TEST_CASE("a step that fails leaves the state as it was") {
  const Arm arm = swinging(0.0);
  Workspace ws(arm);
  const Eigen::VectorXd q0 = flexarm_test::wave(arm.nq(), 0.2), v0 = flexarm_test::wave(arm.nv(), 0.5);
  Eigen::VectorXd q = q0, v = v0, tau = Eigen::VectorXd::Zero(arm.nv());
  ImplicitStep implicit(arm, 1e-3);
  REQUIRE(implicit.start(ws, q, v, tau) == Status::ok);
  tau[1] = std::nan("");
  CHECK(implicit(ws, q, v, tau) == Status::not_finite);
  CHECK(q == q0);
  CHECK(v == v0);
  Rk4Step rk4(arm, 1e-3);
  CHECK(rk4(ws, q, v, tau) == Status::not_finite);
  CHECK(q == q0);
  CHECK(v == v0);
  ImplicitOptions impatient;
  impatient.max_iterations = 1;
  ImplicitStep once(arm, 0.1, impatient);
  tau[1] = 5.0;
  CHECK(once(ws, q, v, tau) == Status::not_converged);
  CHECK(q == q0);
}

TEST_CASE("a step out of any reach fails and leaves the state as it was") {
  const Arm arm = flexarm_test::spatial_arm();
  const Eigen::VectorXd tau = Eigen::VectorXd::Zero(arm.nv()), q0 = arm.zero();
  const int bent = arm.first(1) + arm.link(1).nj();  // the first coordinate of the first beam
  Eigen::VectorXd v0 = tau;
  v0[bent] = 2.0 * arm.farthest()[bent] / 1e-6;
  CHECK(arm.within_reach(q0, v0));
  ImplicitStep implicit(arm, 1e-6);
  Rk4Step rk4(arm, 1e-6);
  CollocationStep gauss(arm);
  for (Step* step : {static_cast<Step*>(&implicit), static_cast<Step*>(&rk4), static_cast<Step*>(&gauss)}) {
    Workspace ws(arm);
    Eigen::VectorXd q = q0, v = v0;
    REQUIRE(step->start(ws, q, v, tau) == Status::ok);
    CHECK(step->advance(1e-6, ws, q, v, tau, {}) != Status::ok);
    CHECK(q == q0);
    CHECK(v == v0);
  }
  Eigen::VectorXd q = q0, still = tau;
  q[bent] = 2.0 * arm.farthest()[bent];
  CHECK_FALSE(arm.within_reach(q, still));
  CHECK(arm.farthest_out(q, still) == "the beam of link 1 is bent by 20 times its length");
  q[bent] = std::nan("");
  CHECK_FALSE(arm.within_reach(q, still));
  still[0] = 1e13;
  CHECK_FALSE(arm.within_reach(q0, still));
  CHECK(arm.farthest_out(q0, still).find("moves at 1e+13") != std::string::npos);
  CHECK(arm.farthest_out(q0, tau).empty());
}

TEST_CASE("bad steps are refused by name and value") {
  const Arm arm = swinging(0.0);
  CHECK_THROWS_WITH_AS(ImplicitStep(arm, 0.0), "step = 0: must be positive and finite", std::invalid_argument);
  CHECK_THROWS_WITH_AS(Rk4Step(arm, -1.0), "step = -1: must be positive and finite", std::invalid_argument);
  ImplicitOptions bad;
  bad.spectral_radius = 1.5;
  CHECK_THROWS_WITH_AS(ImplicitStep(arm, 1e-3, bad), "spectral_radius = 1.5: must be from 0 to 1",
                       std::invalid_argument);
}

TEST_CASE("quaternions stay of unit length, at the exact angle of a steady turn") {
  const Arm arm(
      {Link(Joint({}, true, {"wx", "wy", "wz"}), flexarm_test::body(1.0, {0, 0, 0}), std::nullopt, std::nullopt)});
  Workspace ws(arm);
  ImplicitStep step(arm, 0.01);
  Eigen::VectorXd q = arm.zero(), v = flexarm_test::wave(3, 0.3, 5.0);
  for (int k = 0; k < 10000; ++k) REQUIRE(step(ws, q, v, Eigen::VectorXd::Zero(3)) == Status::ok);
  CHECK(std::abs(q.norm() - 1.0) < 1e-15 * 4);
  Eigen::Vector4d turned;
  const double u[] = {0.0, 0.0, 0.6}, from[] = {std::cos(0.2), 0.0, 0.0, std::sin(0.2)};
  turn_ball(from, u, turned.data());
  CHECK((turned - Eigen::Vector4d(std::cos(0.5), 0.0, 0.0, std::sin(0.5))).norm() < 1e-15);
}

TEST_CASE("implicit steps hold what friction holds, to the bit; Runge-Kutta and Gauss steps refuse it by name") {
  JointForce rough;
  rough.coulomb = 0.5;
  rough.stiction = 0.75;
  std::vector<Link> links;
  links.emplace_back(Joint({{false, {1, 0, 0}}}, false, {"x"}, {rough}), RigidBody{2.0}, std::nullopt, std::nullopt);
  const Arm arm(std::move(links));
  Workspace ws(arm);
  ImplicitStep step(arm, 7e-3);
  Eigen::VectorXd q = Eigen::VectorXd::Constant(1, 0.1), v = Eigen::VectorXd::Zero(1), tau = v;
  const auto run = [&](double force, int steps) {
    tau[0] = force;
    for (int k = 0; k < steps; ++k) REQUIRE(step(ws, q, v, tau) == Status::ok);
  };
  run(0.7, 10);
  CHECK(q[0] == 0.1);
  CHECK(v[0] == 0.0);
  CHECK(step.friction()[0] == doctest::Approx(-0.7));
  CHECK(step.jump(ws, q, v, tau = Eigen::VectorXd::Constant(1, 0.8)) == Status::ok);
  CHECK(ws.a[0] == doctest::Approx(0.15));
  run(0.8, 100);  // torn loose: (0.8 - 0.5) / 2
  CHECK(v[0] == doctest::Approx(0.15 * 0.7));
  CHECK(q[0] == doctest::Approx(0.1 + 0.5 * 0.15 * 0.49));
  CHECK(step.friction()[0] == -0.5);
  const double from = q[0], speed = v[0];
  CHECK(step.jump(ws, q, v, tau = Eigen::VectorXd::Zero(1)) == Status::ok);
  run(0.0, 100);  // braked by 0.25 m/s^2
  CHECK(v[0] == 0.0);
  CHECK(std::abs(q[0] - from - 0.5 * speed * speed / 0.25) <= 0.25 * 7e-3 * 7e-3 / 8);
  CHECK(step.friction()[0] == 0.0);
  CHECK(step.counts().switches == 1);
  const char* told =
      "coulomb of 'link 0 x' = 0.5: \"rk4\" has no dry friction here: take \"implicit\" (C++: ImplicitStep)";
  CHECK_THROWS_WITH_AS(Rk4Step(arm, 1e-3), told, std::invalid_argument);
  CHECK_THROWS_AS(CollocationStep{arm}, std::invalid_argument);
}

TEST_CASE("the time loop meets outputs and samples exactly and counts its work") {
  const Arm arm = swinging(0.0);
  const Eigen::VectorXd t = Eigen::VectorXd::LinSpaced(4, 0.0, 0.3);
  std::vector<double> seen;
  Drive push{0, {}, [&seen](double time) {
               seen.push_back(time);
               return 0.0;
             }};
  push.breaks = Eigen::Vector3d(0.05, 0.1 + 1e-17, 0.25);
  ImplicitStep step(arm, 0.03);
  Problem pushed(arm);
  pushed.drives = {push};
  const Trajectory r = simulate_fixed(pushed, t, step, 0.03);
  REQUIRE(r.failure.empty());
  CHECK(r.done == 4);
  CHECK(r.stats.steps == 2 + 2 + 4 + 2 + 2);
  for (double stop : {0.05, t[1], t[2], 0.25, 0.3}) CHECK(std::count(seen.begin(), seen.end(), stop) > 0);
  CHECK(r.stats.residuals >= r.stats.steps);
  const Trajectory stopped = simulate_fixed(Problem(arm), t, step, 1e-4, [](double) { return false; });
  CHECK(stopped.failure == kInterrupted);
  CHECK(stopped.reached < 0.01);
  CHECK(stopped.done == 1);
}

namespace {

/// [q; v] at the end of a step, by [q; v; tau].
Eigen::VectorXd end_of_step(StepDerivatives& d, Workspace& ws, const Eigen::VectorXd& x) {
  const Eigen::Index n = x.size() / 3;
  Eigen::VectorXd q = x.head(n), v = x.segment(n, n), out(2 * n);
  REQUIRE(d(ws, q, v, x.tail(n)) == Status::ok);
  out << q, v;
  return out;
}

TEST_CASE("derivatives of a step, against differences and between themselves") {
  const Arm arm = flexarm_test::spatial_arm(2);
  const Eigen::Index n = arm.nv();
  for (const char* method : {"implicit", "rk4"}) {
    CAPTURE(std::string(method));
    StepDerivatives d(method, arm, std::string(method) == "rk4" ? 1e-6 : 1e-4, {0.6, 1e-14, 40});
    Workspace ws(arm);
    const Eigen::VectorXd x = flexarm_test::wave(3 * static_cast<int>(n), 0.3, 1e-3);
    end_of_step(d, ws, x);
    Eigen::MatrixXd A, B, both(2 * n, 3 * n);
    d.matrices(A, B);
    both << A, B;
    for (Eigen::Index k = 0; k < 3 * n; ++k) {
      const double h = 1e-4;
      const auto at = [&](double s) { return end_of_step(d, ws, x + s * h * Eigen::VectorXd::Unit(3 * n, k)); };
      const Eigen::VectorXd wide = (at(2.0) - at(-2.0)) / (4.0 * h), near = (at(1.0) - at(-1.0)) / (2.0 * h);
      const Eigen::VectorXd expected = (4.0 * near - wide) / 3.0;
      CHECK((expected - both.col(k)).norm() < 1e-5 * (1e-2 + both.col(k).norm()));
    }
  }
  const Arm floating = flexarm_test::floating_arm();  // on balls
  CHECK_THROWS_AS(StepDerivatives("implicit", floating, 1e-3), std::invalid_argument);
}

}  // namespace

}  // namespace test_step
