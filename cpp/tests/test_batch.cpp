#include <doctest/doctest.h>

#include <stdexcept>

#include "arms.hpp"
#include "flexarm/batch.hpp"
#include "flexarm/step.hpp"

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
    problem.arms = {&arm};
    problem.scenarios = kScenarios;
    problem.lengths.assign(kSteps, h);
    problem.hold.assign(kSteps, 0);
    for (Eigen::Index k = 0; k <= kSteps; ++k) {
      problem.times.push_back(h * static_cast<double>(k));
      if (k % 50 == 0) problem.rows.push_back(k);
    }
    problem.q0 = {q0.data(), arm.nq(), 0};
    problem.v0 = {v0.data(), arm.nv(), 0};
    problem.tau = {tau.data(), 0, 0};
    q.resize(static_cast<std::size_t>(kScenarios * arm.nq()) * problem.rows.size());
    v.resize(static_cast<std::size_t>(kScenarios * arm.nv()) * problem.rows.size());
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
  const double* last = one.v.data() + (6 * static_cast<Eigen::Index>(one.problem.rows.size()) - 1) * arm.nv();
  CHECK((Eigen::Map<const Eigen::VectorXd>(last, arm.nv()) - v).cwiseAbs().maxCoeff() <
        1e-11 * v.cwiseAbs().maxCoeff());
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
  batch.problem.lengths.assign(20000, 1e-4);  // seconds
  batch.problem.rows.back() = 20000;
  batch.problem.hold.assign(20000, 0);
  batch.problem.times.assign(20001, 0.0);
  CHECK(run_batch(batch.problem, batch.out, 3, [](double share) { return share < 0.0; }).interrupted);
  CHECK(batch.status[kScenarios - 1] == static_cast<int>(BatchStatus::not_done));
  CHECK(std::isnan(batch.q.back()));
  CHECK_THROWS_AS(run_batch(batch.problem, batch.out, 3, [](double) -> bool { throw std::runtime_error("enough"); }),
                  std::runtime_error);
  batch.problem.hold.pop_back();
  CHECK_THROWS_WITH_AS(run_batch(batch.problem, batch.out, 1), "hold = 19999: must be as many as the steps",
                       std::invalid_argument);
}
