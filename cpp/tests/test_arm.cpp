#include <doctest/doctest.h>

#include "arms.hpp"
#include "flexarm/ab.hpp"
#include "flexarm/ci.hpp"

namespace test_arm {
using namespace flexarm;

TEST_CASE("AB, CI and inverse dynamics agree at every order, and with balls") {
  for (int order : {0, 1, 2, 3, kExact, -1, -2}) {
    const Arm arm = order == -2   ? flexarm_test::tree_arm()
                    : order == -1 ? flexarm_test::floating_arm()
                                  : flexarm_test::spatial_arm(order);
    Workspace ws(arm);
    const Eigen::VectorXd q = arm.zero() + flexarm_test::wave(arm.nq(), 0.2, order == 0 ? 0.01 : 0.1),
                          v = flexarm_test::wave(arm.nv(), 0.9, 0.5), tau = flexarm_test::wave(arm.nv(), 2.0, 1.0);
    REQUIRE(forward_dynamics_ab(arm, ws, q, v, tau) == Status::ok);
    const Eigen::VectorXd ab = ws.a;
    REQUIRE(forward_dynamics_ci(arm, ws, q, v, tau) == Status::ok);
    const Eigen::VectorXd ci = ws.a;
    CHECK((ab - ci).norm() < 1e-9 * ab.norm());
    inverse_dynamics(arm, ws, q, v, ab);
    composite_mass_matrix(arm, ws);
    const Eigen::VectorXd size = ws.M.cwiseAbs() * ab.cwiseAbs();
    CHECK(((ws.tau - tau).array().abs() < 1e-10 * (size.array() + 1.0)).all());
  }
}

TEST_CASE("the kinetic energy is that of the mass matrix, and the same from any moving seat") {
  const Arm arm = flexarm_test::spatial_arm();
  Workspace ws(arm);
  const Eigen::VectorXd q = flexarm_test::wave(arm.nv(), 0.2, 0.2), v = flexarm_test::wave(arm.nv(), 0.9, 1.0);
  const Energy e = energy(arm, ws, q, v);
  move_arm(arm, ws, q, v);
  composite_mass_matrix(arm, ws);
  CHECK(0.5 * v.dot(ws.M * v) == doctest::Approx(e.kinetic).epsilon(1e-13));
}

TEST_CASE("workspaces do not remember: a second evaluation elsewhere and back gives the same bits") {
  const Arm arm = flexarm_test::spatial_arm();
  Workspace ws(arm);
  const Eigen::VectorXd q = flexarm_test::wave(arm.nv(), 0.2, 0.1), v = flexarm_test::wave(arm.nv(), 0.9),
                        tau = flexarm_test::wave(arm.nv(), 2.0);
  forward_dynamics(arm, ws, q, v, tau);
  const Eigen::VectorXd first = ws.a;
  forward_dynamics_ci(arm, ws, -3.0 * q, 2.0 * v, tau);
  forward_dynamics(arm, ws, q, v, tau);
  CHECK((ws.a.array() == first.array()).all());
}

TEST_CASE("a parent must be a link before, or the world") {
  const Link link(Joint::revolute({0, 0, 1}), flexarm_test::body(0.5, {0.1, 0, 0}),
                  flexarm_test::beam({1, 0, 0, 0, 0}, 2), std::nullopt);
  const auto tree = [&](std::vector<Arm::Seat> seats) { return Arm({link, link, link}, {0, 0, 0}, std::move(seats)); };
  CHECK(tree({}).seats() == std::vector<Arm::Seat>{-1, 0, 1});
  CHECK(tree({}).is_chain());
  CHECK(!tree({-1, 0, 0}).is_chain());
  CHECK(!tree({-1, 0, {1, 0.2}}).is_chain());
  CHECK_THROWS_WITH_AS(tree({-1, 0, 2}), "parents[2] = 2: must be a link before this one, or -1: the world",
                       std::invalid_argument);
  CHECK_THROWS_AS(tree({-1, -2, 0}), std::invalid_argument);
  CHECK_THROWS_WITH_AS(tree({-1, {0, 0.51}, 1}),
                       "at[1] = 0.51: must be on the parent's beam, above 0 and up to its length, 0.5 m",
                       std::invalid_argument);
  for (double at : {0.0, -0.1, std::nan("")}) CHECK_THROWS_AS(tree({-1, {0, at}, 1}), std::invalid_argument);
  CHECK_THROWS_AS(tree({-1, 0, {-1, 0.2}}), std::invalid_argument);
  CHECK_THROWS_AS(
      Arm({Link(Joint::revolute({0, 0, 1}), flexarm_test::body(0.5, {0.1, 0, 0}), std::nullopt, std::nullopt), link},
          {0, 0, 0}, {-1, {0, 0.2}}),
      std::invalid_argument);
  CHECK_THROWS_WITH_AS(tree({-1, 0}), "parents = 2 numbers: must be one for each of 3 links", std::invalid_argument);
}

TEST_CASE("an arm without inertia is refused, with the coordinate named") {
  const Joint hinge = Joint::revolute({0, 0, 1});
  CHECK_THROWS_AS(Arm({Link(hinge, std::nullopt, std::nullopt, std::nullopt)}), std::invalid_argument);
  CHECK_THROWS_AS(Arm({}), std::invalid_argument);
  // two hinges on one axis, one inertia: only their sum is defined
  const RigidBody wheel = flexarm_test::body(1.0, {0, 0, 0});
  CHECK_THROWS_AS(
      Arm({Link(hinge, std::nullopt, std::nullopt, std::nullopt), Link(hinge, wheel, std::nullopt, std::nullopt)}),
      std::invalid_argument);
}

}  // namespace test_arm
