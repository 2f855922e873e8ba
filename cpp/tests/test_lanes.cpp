// The kernels, of every instruction set that this processor has, against the paper's equations (oracle/).
#include <doctest/doctest.h>

#include "batches.hpp"
#include "flexarm/step.hpp"
#include "kernels.hpp"

namespace test_lanes {
using namespace flexarm;
using Eigen::Vector3d;
using flexarm_test::all_kernels;
using flexarm_test::check;
using flexarm_test::flat;
using flexarm_test::OnKernels;
using flexarm_test::place;
using flexarm_test::spring;

namespace {}  // namespace

TEST_CASE("planar arms run in the plane, with the results of space") {
  for (int order : {1, 2})
    for (double damping : {0.0, 0.02}) {
      CAPTURE(order);
      check(flat({0, 0, 1}, {3, 0, 0, 0, 0}, order, damping), true);
      check(flat({0, 1, 0}, {0, 2, 0, 0, 1}, order, damping), true);
      check(flat({0, 0, 1}, {2, 0, 0, 2, 0}, order, damping), true);
    }
  std::vector<bool> first(9, false);
  first[0] = true;
  check(flat({0, 0, 1}, {3, 0, 0, 0, 0}, 2), true, first);
}

TEST_CASE("arms in space") {
  for (int order : {1, 2}) {
    CAPTURE(order);
    check(flexarm_test::spatial_arm(order), false);
    check(flat({0, 0, 1}, {3, 3, 1, 0, 0}, order, 0.01), false);
    check(flat({0, 1, 0}, {2, 0, 0, 0, 0}, order), false);  // bends out of the plane of its joints
    std::vector<bool> second(15, false);
    second[7] = true;
    check(flat({0, 0, 1}, {2, 1, 1, 1, 1}, order), false, second);
  }
  std::vector<Link> links;
  links.emplace_back(Joint({{true, {0, 0, 1}}, {true, {0, 1, 0}}, {false, {1, 1, 1}}}, false, {"a", "b", "c"},
                           {spring(), spring(), spring()}),
                     flexarm_test::body(0.5, {0.1, 0.2, 0}), flexarm_test::beam({2, 2, 0, 0, 0}, 2), std::nullopt);
  links.emplace_back(Joint::revolute({1, 0, 0}), flexarm_test::body(0.5, {0.1, 0, 0}), std::nullopt,
                     flexarm_test::body(0.1, {0, 0, 0.1}));
  check(Arm(std::move(links), {0, 0, -9.81}), false);
}

TEST_CASE("trees") {
  for (int order : {0, 1, 2, 3, kExact}) {
    CAPTURE(order);
    check(flexarm_test::flat_tree(order), true, {}, order == 0 ? 0.01 : 0.1);
    check(flexarm_test::tree_arm(order), false, {}, order == 0 ? 0.01 : 0.1);
  }
  std::vector<bool> some(static_cast<std::size_t>(flexarm_test::tree_arm().nv()), false);
  some[0] = some[6] = true;
  check(flexarm_test::tree_arm(), false, some);
}

TEST_CASE("beams twisted and bent by many turns") {
  for (double turned : {1.0, 2.9, 3.1, 3.3, 6.3, 9.4, 12.6, 21.0, 30.0})
    for (int order : {1, 2}) {
      CAPTURE(turned);
      CAPTURE(order);
      check(flat({0, 0, 1}, {0, 0, 2, 0, 0}, order), false, {}, turned);
      check(flat({0, 0, 1}, {2, 2, 1, 0, 0}, order), false, {}, turned);
      check(flexarm_test::spatial_arm(order), false, {}, turned);
    }
}

TEST_CASE("a rod that only twists is a hinge with a spring and a rotor, however far it is turned") {
  for (int order : {1, 2}) {
    const Beam beam = flexarm_test::beam({0, 0, 1, 0, 0}, order);
    const double turn = beam.tip().linear(3, 0);  // of the end, by the coordinate
    double inertia = 0.0;
    for (const MassSlice& s : beam.slices()) inertia += s.inertia(0, 0) * std::pow(s.table.linear(3, 0), 2);
    JointForce spring;
    spring.stiffness = beam.stiffness()(0, 0) / (turn * turn);
    spring.reflected_inertia = inertia / (turn * turn);
    const Vector3d gravity(1.0, 2.0, -9.81);
    const RigidBody body = flexarm_test::body(0.5, {0.1, 0, 0});
    std::vector<Link> rod, hinge;
    rod.emplace_back(Joint::fixed(), std::nullopt, beam, std::nullopt);
    hinge.emplace_back(Joint({{true, {1, 0, 0}}}, false, {"twist"}, {spring}), std::nullopt, std::nullopt,
                       std::nullopt);
    for (std::vector<Link>* links : {&rod, &hinge})
      links->emplace_back(Joint::revolute({0, 1, 0}), body, std::nullopt, std::nullopt);
    const Arm twisted(rod, gravity), turned(hinge, gravity);
    Workspace ws(turned);
    for (const lanes::Kernels* kernels : all_kernels())
      for (double angle = -30.0; angle <= 30.0; angle += 0.37) {
        CAPTURE(std::string(kernels->name));
        CAPTURE(angle);
        OnKernels on(twisted, *kernels, {});
        const Eigen::Vector2d q(angle / turn, 0.7), v(8.0 / turn, -3.0), tau(0.02 * turn, 0.1);
        Eigen::Vector2d a;
        CHECK(kernels->forward(on.memory.get(), q.data(), v.data(), tau.data(), a.data()) == lanes::Outcome::good);
        const Eigen::Vector2d scale(turn, 1.0);
        REQUIRE(forward_dynamics_ab(turned, ws, q.cwiseProduct(scale), v.cwiseProduct(scale),
                                    tau.cwiseQuotient(scale)) == Status::ok);
        const Eigen::Vector2d expected = ws.a.cwiseQuotient(scale);
        CHECK((a - expected).norm() < 1e-9 * expected.norm());
      }
  }
}

TEST_CASE("a tilt acts, however small it is") {
  for (double along : {1.0, -1.0})
    for (double tilt : {1e-15, 1e-12, 4e-8, -4e-8, 1e-6, 2e-6, -1e-4}) {
      CAPTURE(along);
      CAPTURE(tilt);
      const Arm slider({Link(Joint::prismatic({0.0, tilt, along}), flexarm_test::body(1.0, {0.1, 0, 0}), std::nullopt,
                             std::nullopt)},
                       {0.0, 10.0, 0.0});
      Workspace ws(slider);
      const Eigen::VectorXd zero = Eigen::VectorXd::Zero(1);
      REQUIRE(forward_dynamics(slider, ws, zero, zero, zero) == Status::ok);
      CHECK(ws.a[0] == doctest::Approx(10.0 * tilt / std::sqrt(1.0 + tilt * tilt)).epsilon(1e-9));
      // a vertical hinge out of the vertical, and the same by its seat: gravity turns it
      RigidBody weight;
      weight.mass = 2.0;
      weight.com = {0.5, 0.0, 0.0};
      Placement seat;
      seat.rotation = Eigen::AngleAxisd(tilt, Vector3d::UnitX()).toRotationMatrix();
      const std::vector<Joint> joints{Joint::revolute({0.0, -along * tilt, along}),
                                      Joint({{true, {0, 0, along}}}, false, {"hinge"}, {}, seat)};
      for (const Joint& joint : joints) {
        const Arm hinge({Link(joint, weight, std::nullopt, std::nullopt)}, {0.0, 0.0, -10.0});
        Workspace hung(hinge);
        REQUIRE(forward_dynamics(hinge, hung, zero, zero, zero) == Status::ok);
        CHECK(hung.a[0] == doctest::Approx(along * -20.0 * std::sin(tilt)).epsilon(1e-8));
      }
    }
}

TEST_CASE("a copy of a workspace moves by itself") {
  const Arm arm = flexarm_test::spatial_arm();
  Workspace one(arm), two(one);
  const Eigen::VectorXd q = flexarm_test::wave(arm.nq(), 0.2), v = q, tau = v;
  REQUIRE(forward_dynamics(arm, one, q, v, tau) == Status::ok);
  const Eigen::VectorXd a = one.a;
  REQUIRE(forward_dynamics(arm, two, 0.5 * q, v, tau) == Status::ok);
  REQUIRE(forward_dynamics(arm, one, q, v, tau) == Status::ok);
  CHECK(one.a == a);
  CHECK(two.a != a);
}

TEST_CASE(
    "a scenario's motion does not depend on who shares its pack, and is that of a step by itself, by every method") {
  const Arm arm = flat({0, 0, 1}, {2, 0, 0, 0, 0}, 2, 0.01), heavy = flexarm_test::spatial_arm();
  constexpr int kScenarios = 11, kSteps = 40;
  for (const Arm* one : {&arm, &heavy})
    for (const OneStep::Traits& method : OneStep::methods()) {
      const int nq = one->nq(), nv = one->nv();
      const double h = method.limit > 0.0 ? 2e-6 : one == &arm ? 1e-3 : 1e-5;
      Eigen::MatrixXd q0(nq, kScenarios), v0(nv, kScenarios);
      for (int b = 0; b < kScenarios; ++b) {
        Eigen::VectorXd q, v;
        place(*one, 0.3 * b, q, v);
        q0.col(b) = 1e-3 * q;  // softly: what is too fast for the step must be quiet
        v0.col(b) = 1e-3 * v;
      }
      v0(0, 4) = std::numeric_limits<double>::infinity();  // runs away, and spoils no other
      const Eigen::VectorXd tau = flexarm_test::wave(nv, 0.5, 1e-3);
      const auto run = [&](int first, int count, bool side_by_side, int whole = 0) {
        BatchProblem p = flexarm_test::batch_of({one}, count, h, kSteps);
        flexarm_test::begin_at(p, q0, v0, first);
        p.tau = {tau.data(), 0, 0};
        p.method.name = method.name;
        p.whole = whole;
        p.lanes = side_by_side;
        Eigen::MatrixXd q(2 * nq, count);  // start and end
        std::vector<int> status(static_cast<std::size_t>(count));
        BatchOutput out;
        out.q = q.data();
        out.status = status.data();
        run_batch(p, out, 1);
        CAPTURE(nq);
        CAPTURE(method.name);
        CAPTURE(side_by_side);
        for (int b = 0; b < count; ++b) CHECK((status[static_cast<std::size_t>(b)] == 0) == (first + b != 4));
        return Eigen::MatrixXd(q.bottomRows(nq));
      };
      const Eigen::MatrixXd all = run(0, kScenarios, true), alone = run(0, kScenarios, false);
      for (int b = 0; b < kScenarios; ++b) {
        if (b == 4) {
          CHECK(all.col(b).array().isNaN().all());
          continue;
        }
        CHECK((all.col(b) - alone.col(b)).cwiseAbs().maxCoeff() < 1e-11 * alone.col(b).cwiseAbs().maxCoeff());
        CHECK(run(b, 1, true, kScenarios) == all.col(b));  // a chunk
        CHECK(run(b, 1, true) == alone.col(b));            // few enough to run one by one
      }
    }
}

}  // namespace test_lanes
