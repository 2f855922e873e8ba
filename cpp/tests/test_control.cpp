#include <doctest/doctest.h>

#include "arms.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/collocation.hpp"
#include "flexarm/ida.hpp"
#include "flexarm/simulate.hpp"
#include "flexarm/simulation.hpp"
#include "step/feedback.hpp"

namespace test_control {
using namespace flexarm;

namespace {

/// A block of 1 kg on a rough line.
Arm block(double coulomb, double stiction) {
  JointForce force;
  force.coulomb = coulomb;
  force.stiction = stiction;
  std::vector<Link> links;
  links.emplace_back(Joint({{false, {1, 0, 0}}}, false, {"x"}, {force}), RigidBody{1.0}, std::nullopt, std::nullopt);
  return Arm(std::move(links));
}

/// Feedback of everything on the first joint, that does not reach its limit.
Feedback feedback_of(const Arm& arm) {
  Feedback f;
  f.column = Eigen::VectorXd::Unit(arm.nv(), 0);
  f.by_q = flexarm_test::wave(arm.nq(), 0.2, 3.0);
  f.by_v = flexarm_test::wave(arm.nv(), 0.9, 0.4);
  f.limit = 1e6;
  return f;
}

}  // namespace

TEST_CASE("feedback is a force: every algorithm agrees with the same force applied") {
  const Arm arm = flexarm_test::spatial_arm(2);
  const Feedback law = feedback_of(arm);
  const Eigen::VectorXd q = flexarm_test::wave(arm.nq(), 0.1, 0.05), v = flexarm_test::wave(arm.nv(), 0.3, 0.2);
  const Eigen::VectorXd tau = flexarm_test::wave(arm.nv(), 0.7);
  Workspace with(arm), without(arm);
  with.feedback.push_back({&law, 0.3});
  const Eigen::VectorXd total = tau + law(0.3, q, v) * law.column;
  forward_dynamics_ab(arm, without, q, v, total);
  forward_dynamics_ab(arm, with, q, v, tau);
  CHECK((with.a - without.a).norm() <= 1e-12 * without.a.norm());
  forward_dynamics_ci(arm, with, q, v, tau);
  CHECK((with.a - without.a).norm() <= 1e-9 * without.a.norm());
  const Eigen::VectorXd a = without.a;
  inverse_dynamics(arm, without, q, v, a);
  inverse_dynamics(arm, with, q, v, a);
  CHECK((without.tau - law(0.3, q, v) * law.column - with.tau).norm() <= 1e-14 * without.tau.norm());
}

TEST_CASE("slopes of feedback are those of the force, and none at the limit") {
  const Arm arm = flexarm_test::spatial_arm(1);
  Feedback law = feedback_of(arm);
  const Eigen::VectorXd q = flexarm_test::wave(arm.nq(), 0.1, 0.05), v = flexarm_test::wave(arm.nv(), 0.3, 0.2);
  std::vector<AppliedFeedback> applied{{&law, 0.1}};
  std::vector<AppliedLimit> limits;
  Eigen::MatrixXd dq = Eigen::MatrixXd::Zero(arm.nv(), arm.nq()), dv = Eigen::MatrixXd::Zero(arm.nv(), arm.nv());
  add_feedback_slopes(applied, limits, q, v, dq, dv);
  for (int k = 0; k < arm.nq(); ++k) {
    const Eigen::VectorXd step = Eigen::VectorXd::Unit(arm.nq(), k);
    CHECK(dq(0, k) == doctest::Approx(law(0.1, q, v) - law(0.1, q + step, v)));
  }
  for (int k = 0; k < arm.nv(); ++k) {
    const Eigen::VectorXd step = Eigen::VectorXd::Unit(arm.nv(), k);
    CHECK(dv(0, k) == doctest::Approx(law(0.1, q, v) - law(0.1, q, v + step)));
  }
  law.limit = 1e-6;
  const Eigen::MatrixXd before = dq;
  add_feedback_slopes(applied, limits, q, v, dq, dv);
  CHECK(dq == before);
}

TEST_CASE("the implicit step's matrix has the slopes of feedback, whatever joins they couple") {
  const Arm arm = flexarm_test::spatial_arm(2);
  std::vector<Feedback> laws{feedback_of(arm), feedback_of(arm)};
  laws[1].column = flexarm_test::wave(arm.nv(), 0.5);
  const Eigen::VectorXd q = flexarm_test::wave(arm.nq(), 0.1, 0.05), v = flexarm_test::wave(arm.nv(), 0.3, 0.2);
  const Shift shift{1e-3, 1e-6};
  std::vector<bool> given(static_cast<std::size_t>(arm.nv()), false);
  given[1] = true;
  for (const std::vector<bool>& prescribed : {std::vector<bool>{}, given}) {
    Workspace without(arm, prescribed), with(arm, prescribed);
    with.feed_back(laws);
    for (Workspace* ws : {&without, &with}) {
      move_arm(arm, *ws, q, v);
      REQUIRE(factor_shifted(arm, *ws, q, v, shift) == Status::ok);
    }
    const Eigen::VectorXd r = flexarm_test::wave(arm.nv(), 0.8);
    Eigen::VectorXd x = Eigen::VectorXd::Zero(arm.nv()), y = x;
    solve_shifted(arm, with, r, x);
    Eigen::VectorXd left = r;  // r - columns slopes^T x, solved without feedback, is x again
    for (const Feedback& f : laws) left -= f.column * (shift.stiffness * f.by_q.dot(x) + shift.damping * f.by_v.dot(x));
    solve_shifted(arm, without, left, y);
    CHECK((x - y).norm() <= 1e-11 * x.norm());
  }
}

TEST_CASE(
    "an implicit step's linear equations are solved with limits of laws and of motors that begin and end in them") {
  const int nv = 4, count = 3;
  int changed = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const double phase = 1.7 * trial, gain = std::pow(10.0, trial % 5);
    Eigen::MatrixXd root(nv, nv), column = Eigen::MatrixXd::Zero(nv, count), by_v = column;  // a law in each column
    for (int i = 0; i < nv; ++i) root.col(i) = flexarm_test::wave(nv, phase + 3.1 * i, 1.0);
    const Eigen::MatrixXd S = root * root.transpose() + 0.1 * Eigen::MatrixXd::Identity(nv, nv);
    for (int l = 0; l < count; ++l) {  // two at one rate, as dampers are
      column(l / 2 * 2, l) = 1.0;
      by_v(l / 2 * 2, l) = gain * (1.0 + l);
    }
    const Eigen::VectorXd by_q = Eigen::VectorXd::Zero(nv * count), limit = Eigen::Vector3d(0.4, 2.0, 0.7);
    const int limited[] = {0, 1}, free[] = {0, 1, 2, 3};
    const double most[] = {1.5, 0.2}, beside[] = {0.6, 0.1};
    FeedbackLaws<double> laws;
    laws.laws = count;
    laws.nq = laws.nv = nv;
    laws.column = column.data();
    laws.by_q = by_q.data();
    laws.by_v = by_v.data();
    laws.limit = limit.data();
    laws.limits = 2;
    laws.limited = limited;
    laws.most = most;
    Arena needed;
    laws.lay_out(needed);
    std::vector<double> memory(needed.bytes() / sizeof(double));
    Arena arena(memory.data());
    laws.lay_out(arena);
    const Eigen::VectorXd given = Eigen::Vector4d(beside[0], beside[1], 0.0, 0.0);
    laws.given = given.data();
    const Eigen::VectorXd q = Eigen::VectorXd::Zero(nv), v = flexarm_test::wave(nv, 0.3 * trial, 1.0);
    const auto force = [&](const Eigen::VectorXd& rates) {
      Eigen::VectorXd f = Eigen::VectorXd::Zero(nv);
      laws.add(q.data(), rates.data(), 1.0, f.data());
      return f;
    };
    const auto given_at = [&](int c) { return beside[c]; };
    laws.factor(
        {1.0, 0.0}, q.data(), v.data(), free, nv, [](int i) { return i; }, [&](int c) { return limited[c]; }, given_at,
        [&](const double* r, double* x) {
          Eigen::Map<Eigen::VectorXd>(x, nv) = S.llt().solve(Eigen::Map<const Eigen::VectorXd>(r, nv));
        });
    const Eigen::VectorXd r = flexarm_test::wave(nv, 5.0 + phase, 20.0);
    Eigen::VectorXd x = S.llt().solve(r);
    changed += laws.correct_within(q.data(), v.data(), given_at, x.data());
    const Eigen::VectorXd left = r + force(v + x) - force(v) - S * x;
    CAPTURE(trial);
    CHECK(left.norm() <= 1e-9 * gain);
  }
  CHECK(changed > 50);
}

TEST_CASE("a delay of thousands of samples") {
  const auto law = [](double t, const Eigen::VectorXd&, const Eigen::VectorXd&, const Eigen::VectorXd&,
                      Eigen::VectorXd& force) { force[0] = 1.0 + t; };
  Control control({}, {{0.0, 1.0, 2500.0, law}, {0.0, 1.0, HUGE_VAL, law}}, 1);
  const Eigen::VectorXd none = Eigen::VectorXd::Zero(1);
  for (int t = 0; t < 6000; ++t) {
    control.run(t, none, none, none);
    CHECK(control.held()[0] == (t < 2500 ? 0.0 : t - 2499.0));
  }
}

TEST_CASE("a simulation goes on behind a law that threw") {
  const Arm arm = flexarm_test::spatial_arm(2);
  Problem problem(arm);
  bool bad = true;
  problem.samplers = {{0.0, 2e-3, 0.0, [&bad](double t, const auto&, const auto&, const auto&, Eigen::VectorXd& force) {
                         if (bad && t > 0.011) throw std::invalid_argument("bad");
                         force.setZero();
                       }}};
  Simulation sim(problem, {"implicit"}, 1e-3);
  CHECK_THROWS_WITH_AS(sim.advance(0.02), "bad", std::invalid_argument);
  const double reached = sim.t();
  CHECK(reached < 0.02);
  bad = false;
  for (int k = 1; k <= 5; ++k) {
    CHECK(sim.step() == Status::ok);
    CHECK(sim.t() == doctest::Approx(reached + k * 1e-3));
  }
}

TEST_CASE("samples come at their times, and their forces after the delay") {
  std::vector<double> asked;
  const auto law = [&asked](double t, const Eigen::VectorXd&, const Eigen::VectorXd&, const Eigen::VectorXd&,
                            Eigen::VectorXd& force) {
    asked.push_back(t);
    force[0] = 1.0 + static_cast<double>(asked.size());
  };
  Control control({}, {{0.0, 0.1, 0.15, law}}, 1);
  double time = 0.0;
  for (const double expected : {0.1, 0.15, 0.2, 0.25, 0.3})
    CHECK((time = control.next(std::nextafter(time, 1.0))) == doctest::Approx(expected));
  const Eigen::VectorXd none = Eigen::VectorXd::Zero(1);
  CHECK_FALSE(control.run(0.0, none, none, none));  // asked, and the force on its way
  CHECK(asked.size() == 1);
  CHECK_FALSE(control.run(0.1, none, none, none));
  CHECK(control.held()[0] == 0.0);
  CHECK(control.run(0.16, none, none, none));
  CHECK(control.held()[0] == 2.0);
  CHECK_FALSE(control.due(0.19));
  const auto same = [](double, const auto&, const auto&, const auto&, Eigen::VectorXd& force) { force[0] = 2.0; };
  Control held({}, {{0.0, 0.1, 0.0, same}}, 1);
  CHECK(held.run(0.0, none, none, none));
  CHECK_FALSE(held.run(0.1, none, none, none));  // the force held before
  CHECK(held.held()[0] == 2.0);
  CHECK_THROWS_WITH_AS(Control({}, {{0.0, 0.0, 0.0, law}}, 1), "period = 0: must be positive and finite",
                       std::invalid_argument);
}

TEST_CASE("friction: a block pushed by less than the stiction does not move; by more, it slides") {
  const Arm arm = block(1.0, 1.5);
  const Eigen::VectorXd t = Eigen::VectorXd::LinSpaced(5, 0.0, 1.0);
  for (double push : {1.4, -1.4, 2.0, -2.0}) {
    CAPTURE(push);
    Problem problem(arm);
    problem.tau << push;
    CollocationStep gauss(arm, {}, DryFriction::left_to_caller);
    const bool moves = std::abs(push) > 1.5;
    for (const Trajectory& r : {simulate_fixed(problem, t, gauss, 0.1), simulate_ida(problem, t, {})}) {
      REQUIRE(r.failure.empty());
      REQUIRE(r.done == 5);
      CHECK(r.q(4, 0) == doctest::Approx(moves ? std::copysign(0.5, push) : 0.0));
      CHECK(r.friction(4, 0) == doctest::Approx(moves ? -std::copysign(1.0, push) : -push));
      CHECK(r.tau(4, 0) == push);
    }
  }
}

TEST_CASE("a motor's limit holds for given forces and feedback together, in every slope as well") {
  using flexarm::JointForce;
  std::vector<Link> links = flexarm_test::spatial_arm(2).links();
  JointForce motor;
  motor.torque_limit = 0.3;
  const flexarm::Joint& own = links[0].joint();
  links[0] = Link(flexarm::Joint(own.motions(), own.has_ball(), own.labels(),
                                 std::vector<JointForce>(static_cast<std::size_t>(own.nv()), motor)),
                  links[0].hub(), links[0].beam(), links[0].tip());
  const Arm arm(links);
  const std::vector<AppliedLimit> limits = torque_limits(arm);
  REQUIRE(limits.size() == static_cast<std::size_t>(own.nv()));
  const std::vector<Feedback> laws{feedback_of(arm)};
  const Eigen::VectorXd q = flexarm_test::wave(arm.nq(), 0.1, 0.05), v = flexarm_test::wave(arm.nv(), 0.3, 0.2);
  Workspace ws(arm);
  ws.feed_back(laws);
  const Eigen::VectorXd tau = Eigen::VectorXd::Constant(arm.nv(), 0.1);
  Eigen::VectorXd wanted = tau + laws[0](0.0, q, v) * laws[0].column;
  for (const AppliedLimit& l : limits) wanted[l.rate] = std::clamp(wanted[l.rate], -0.3, 0.3);
  ws.limits = limits;
  forward_dynamics(arm, ws, q, v, tau);
  const Eigen::VectorXd a = ws.a;
  Workspace bare(arm);
  forward_dynamics(arm, bare, q, v, wanted);
  CHECK((a - bare.a).norm() <= 1e-12 * bare.a.norm());
}

}  // namespace test_control
