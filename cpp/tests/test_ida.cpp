#include <doctest/doctest.h>

#include "arms.hpp"
#include "flexarm/ida.hpp"

namespace test_ida {
using namespace flexarm;

TEST_CASE("IDA reaches a closed form and counts its work") {
  const Arm arm({Link(Joint::prismatic({1, 0, 0}), flexarm_test::body(2.0, {0, 0, 0}), std::nullopt, std::nullopt)},
                {3.0, 0.0, 0.0});
  const Eigen::VectorXd t = Eigen::VectorXd::LinSpaced(11, 0.0, 1.0);
  Problem pushed(arm);
  pushed.drives = {{0, {}, [](double time) { return -6.0 + 2.0 * time; }}};
  const Trajectory r = simulate_ida(pushed, t, {1e-9, 1e-12});
  REQUIRE(r.failure.empty());
  REQUIRE(r.done == 11);
  for (int k = 0; k < 11; ++k) CHECK(r.q(k, 0) == doctest::Approx(std::pow(t[k], 3) / 6.0).epsilon(1e-7));
  CHECK(r.tau(10, 0) == doctest::Approx(-4.0));
  CHECK(r.stats.steps > 0);
  CHECK(r.stats.jacobians > 0);
}

TEST_CASE("what a drive throws comes through SUNDIALS") {
  const Arm arm = flexarm_test::spatial_arm();
  const Eigen::VectorXd t = Eigen::VectorXd::LinSpaced(2, 0.0, 1.0);
  Problem broken(arm);
  broken.drives = {{0, {}, [](double time) -> double {
                      if (time > 0.01) throw std::domain_error("broken drive");
                      return 0.0;
                    }}};
  CHECK_THROWS_WITH_AS(simulate_ida(broken, t, {}), "broken drive", std::domain_error);
  IdaOptions bad;
  bad.rtol = 0.0;
  CHECK_THROWS_WITH_AS(simulate_ida(Problem(arm), t, bad), "rtol = 0: must be positive and finite",
                       std::invalid_argument);
}

TEST_CASE("a floating arm flies: quaternions stay of unit length, and stopping keeps what is done") {
  const Arm arm = flexarm_test::floating_arm();
  const Eigen::VectorXd t = Eigen::VectorXd::LinSpaced(5, 0.0, 0.01);
  Problem flight(arm);
  flight.v0 = flexarm_test::wave(arm.nv(), 0.3, 0.5);
  const Trajectory r = simulate_ida(flight, t, {});
  REQUIRE(r.failure.empty());
  for (Eigen::Index k = 0; k < r.done; ++k)
    CHECK(r.q.row(k).segment(3, 4).norm() == doctest::Approx(1.0).epsilon(1e-14));
  const Trajectory stopped = simulate_ida(Problem(arm), t, {}, [](double) { return false; });
  CHECK(stopped.failure == kInterrupted);
  CHECK(stopped.done >= 1);
  CHECK(stopped.done < 5);
}

TEST_CASE("the chain's elimination solves IDA's systems, and events are found") {
  for (const Arm& arm : {flexarm_test::spatial_arm(), flexarm_test::tree_arm()}) {
    const Eigen::VectorXd t = Eigen::VectorXd::LinSpaced(3, 0.0, 0.02);
    const auto height = [](double time, const Eigen::VectorXd&, const Eigen::VectorXd&) { return 0.015 - time; };
    Problem problem(arm);
    problem.v0 = flexarm_test::wave(arm.nv(), 0.3, 0.2);
    problem.events = {{height, 0, -1}, {height, 0, 1}, {height, 1, 0}};
    Trajectory r[2];
    for (int k = 0; k < 2; ++k) {
      IdaOptions o{1e-8, 1e-10};
      o.linear_solver = k == 0 ? LinearSolver::dense : LinearSolver::chain;
      r[k] = simulate_ida(problem, t, o);
      REQUIRE(r[k].failure.empty());
      CHECK(r[k].terminated);
      CHECK(r[k].done == 2);
      CHECK(r[k].reached == doctest::Approx(0.015).epsilon(1e-12));
      CHECK(r[k].events[0].t.size() == 1);
      CHECK(r[k].events[1].t.empty());
    }
    CHECK((r[0].q.row(1) - r[1].q.row(1)).norm() < 1e-6);
    CHECK((r[0].events[0].q[0] - r[1].events[0].q[0]).norm() < 1e-6);
    CHECK(r[1].stats.linear_iterations > 0);
  }
}

}  // namespace test_ida
