#include <doctest/doctest.h>

#include <stdexcept>
#include <utility>

#include "arms.hpp"
#include "batches.hpp"
#include "flexarm/simulate.hpp"
#include "flexarm/step.hpp"

namespace test_batch {
using namespace flexarm;

namespace {

constexpr Eigen::Index kScenarios = 12, kSteps = 200;

/// Twelve starts of one arm, with the memory for what they give.
struct Batch {
  Arm arm;
  Eigen::MatrixXd q0, v0;
  std::vector<double> tau, q, v, reached;
  std::vector<int> status;
  BatchProblem problem;
  BatchOutput out;

  explicit Batch(Arm of, double h = 1e-3) : arm(std::move(of)), tau(static_cast<std::size_t>(arm.nv()), 0.1) {
    q0 = arm.zero().replicate(1, kScenarios);
    v0.resize(arm.nv(), kScenarios);
    for (Eigen::Index b = 0; b < kScenarios; ++b) v0.col(b) = flexarm_test::wave(arm.nv(), static_cast<double>(b));
    problem = flexarm_test::batch_of({&arm}, kScenarios, h, kSteps);
    problem.every = 50;
    flexarm_test::begin_at(problem, q0, v0);
    problem.tau = {tau.data(), 0, 0};
    q.resize(static_cast<std::size_t>(kScenarios * arm.nq() * problem.rows()));
    v.resize(static_cast<std::size_t>(kScenarios * arm.nv() * problem.rows()));
    reached.resize(kScenarios);
    status.resize(kScenarios);
    out.q = q.data();
    out.v = v.data();
    out.status = status.data();
    out.reached = reached.data();
  }
};

}  // namespace

TEST_CASE("a batch is ImplicitStep, scenario by scenario, whatever the number of workers") {
  Batch one(flexarm_test::floating_arm()), three(flexarm_test::floating_arm());
  one.problem.lanes = three.problem.lanes = false;
  const BatchStats stats = run_batch(one.problem, one.out, 1);
  CHECK(stats.steps == kScenarios * kSteps);
  CHECK(run_batch(three.problem, three.out, 3).workers == 3);
  CHECK(one.q == three.q);
  CHECK(one.v == three.v);
  const Arm& arm = one.arm;
  Workspace ws(arm);
  ImplicitStep step(arm, 1e-3);
  Eigen::VectorXd q = arm.zero(), v = one.v0.col(5), tau = Eigen::VectorXd::Constant(arm.nv(), 0.1);
  for (int k = 0; k < kSteps; ++k) REQUIRE(step(ws, q, v, tau) == Status::ok);
  const double* last = one.v.data() + (6 * one.problem.rows() - 1) * arm.nv();
  CHECK((Eigen::Map<const Eigen::VectorXd>(last, arm.nv()) - v).cwiseAbs().maxCoeff() <
        1e-11 * v.cwiseAbs().maxCoeff());
}

TEST_CASE("trees side by side move as each alone") {
  Batch lanes(flexarm_test::tree_arm(), 1e-4), alone(flexarm_test::tree_arm(), 1e-4);
  alone.problem.lanes = false;
  CHECK(run_batch(lanes.problem, lanes.out, 1).lanes > 1);
  run_batch(alone.problem, alone.out, 1);
  double most = 0.0, apart = 0.0;
  for (std::size_t i = 0; i < alone.q.size(); ++i) {
    most = std::max(most, std::abs(alone.q[i]));
    apart = std::max(apart, std::abs(lanes.q[i] - alone.q[i]));
  }
  CHECK(most > 1e-3);
  CHECK(apart < 1e-9 * most);
}

TEST_CASE("a scenario that fails spoils no other") {
  Batch good(flexarm_test::spatial_arm()), bad(flexarm_test::spatial_arm());
  bad.v0(2, 4) = std::nan("");
  run_batch(good.problem, good.out, 2);
  const BatchStats stats = run_batch(bad.problem, bad.out, 2);
  CHECK(!stats.interrupted);
  const std::size_t n = good.q.size() / kScenarios;
  for (std::size_t i = 0; i < good.q.size(); ++i) {
    if (i / n != 4)
      CHECK(good.q[i] == bad.q[i]);
    else
      CHECK(std::isnan(bad.q[i]));
  }
  for (std::size_t b = 0; b < kScenarios; ++b)
    CHECK(bad.status[b] == static_cast<int>(b == 4 ? BatchStatus::not_finite : BatchStatus::ok));
  CHECK(bad.reached[4] == 0.0);
}

TEST_CASE("a batch is ended by whoever watches it, all workers joined") {
  Batch batch(flexarm_test::spatial_arm());
  batch.problem.t = Eigen::VectorXd::LinSpaced(5, 0.0, 2.0);
  batch.problem.every = 1;
  batch.problem.step = 1e-4;  // seconds
  int asked = 0;
  CHECK(run_batch(batch.problem, batch.out, 3, [&](double) { return ++asked < 1; }).interrupted);
  CHECK(asked == 1);  // who has ended it is asked no more
  CHECK(batch.status[kScenarios - 1] == static_cast<int>(BatchStatus::not_done));
  CHECK(std::isnan(batch.q.back()));
  CHECK_THROWS_AS(run_batch(batch.problem, batch.out, 3, [](double) -> bool { throw std::runtime_error("enough"); }),
                  std::runtime_error);
  const auto problems = std::exchange(batch.problem.problems, {});
  CHECK_THROWS_WITH_AS(run_batch(batch.problem, batch.out, 1), "problems = 0: must be one, or one for each scenario",
                       std::invalid_argument);
  batch.problem.problems = problems;
  batch.problem.step = 0.0;
  CHECK_THROWS_WITH_AS(run_batch(batch.problem, batch.out, 1), "step = 0: must be positive and finite",
                       std::invalid_argument);
}

TEST_CASE("each scenario has its own sampled laws, events and times of its steps, as simulate_fixed has them") {
  std::string method;
  SUBCASE("in lanes") { method = "implicit"; }
  SUBCASE("one by one") { method = "gauss"; }
  const Arm arm = flexarm_test::spatial_arm();
  const int nv = arm.nv();
  BatchProblem p = flexarm_test::batch_of(std::vector<const Arm*>(kScenarios, &arm), kScenarios, 1e-3, kSteps);
  p.method.name = method;
  p.every = 10;
  for (Eigen::Index b = 0; b < kScenarios; ++b) {
    auto one = std::make_shared<Problem>(*p.problems[static_cast<std::size_t>(b)]);
    one->v0 = flexarm_test::wave(nv, static_cast<double>(b));
    one->samplers = {{0.0, b < 8 ? 0.0073 : 0.01, 0.002,
                      [nv, sum = 0.0](double, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                      const Eigen::VectorXd& a, Eigen::VectorXd& force) mutable {
                        sum += q[1];
                        force = (-5.0 * sum - 0.1 * v[1] - 1e-4 * a[1]) * Eigen::VectorXd::Unit(nv, 1);
                      }}};
    one->events = {{[](double, const Eigen::VectorXd& q, const Eigen::VectorXd&) { return q[1] - 1e-3; }, 2, 1}};
    p.problems[static_cast<std::size_t>(b)] = one;
  }
  Eigen::MatrixXd q(arm.nq() * p.rows(), kScenarios), tau(nv * p.rows(), kScenarios);
  std::vector<int> status(kScenarios);
  std::vector<double> reached(kScenarios);
  std::vector<std::vector<EventLog>> events(kScenarios);
  BatchOutput out;
  out.q = q.data();
  out.tau = tau.data();
  out.status = status.data();
  out.reached = reached.data();
  out.events = events.data();
  CHECK((run_batch(p, out, 2).lanes > 1) == (method == "implicit"));
  for (Eigen::Index b = 0; b < kScenarios; ++b) {
    CAPTURE(b);
    const auto k = static_cast<std::size_t>(b);
    const Problem& one = *p.problems[k];
    const Trajectory r = simulate_fixed(one, p.t, *p.method.on(arm, p.step), p.step);
    CHECK(status[k] == static_cast<int>(r.terminated ? BatchStatus::ended : BatchStatus::ok));
    CHECK(reached[k] == doctest::Approx(r.reached).epsilon(1e-9));
    REQUIRE(events[k][0].t.size() == r.events[0].t.size());
    for (std::size_t i = 0; i < r.events[0].t.size(); ++i) {
      CHECK(events[k][0].t[i] == doctest::Approx(r.events[0].t[i]).epsilon(1e-9));
      CHECK((events[k][0].q[i] - r.events[0].q[i]).cwiseAbs().maxCoeff() < 1e-9);
    }
    for (Eigen::Index row = 0; row < p.rows(); ++row) {
      const auto mine = q.col(b).segment(row * arm.nq(), arm.nq());
      const auto force = tau.col(b).segment(row * nv, nv);
      if (row * p.every >= r.done) {
        CHECK(mine.array().isNaN().all());
        continue;
      }
      CHECK((mine - r.q.row(row * p.every).transpose()).cwiseAbs().maxCoeff() < 1e-10 * r.q.cwiseAbs().maxCoeff());
      CHECK((force - r.tau.row(row * p.every).transpose()).cwiseAbs().maxCoeff() < 1e-9 * r.tau.cwiseAbs().maxCoeff());
    }
  }
}

}  // namespace test_batch
