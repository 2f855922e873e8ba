// The fast kernels, of every instruction set that this processor has, against the equations on Eigen.
#include <doctest/doctest.h>

#include "flexarm/batch.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/step.hpp"
#include "kernels.hpp"

using namespace flexarm;
using Eigen::Vector3d;

namespace {

using flexarm_test::all_kernels;
using flexarm_test::Fast;
using flexarm_test::place;

/// Everything that the kernels offer, against the same on Eigen, in the size of the terms that are summed.
void check(const Arm& arm, bool planar, const std::vector<bool>& given = {}, double bent = 0.1) {
  REQUIRE(lanes::KernelArm::of(arm) != nullptr);
  CHECK(lanes::KernelArm::of(arm)->layout().planar == planar);
  const int nv = arm.nv();
  CAPTURE(nv);
  for (const lanes::Kernels* kernels : all_kernels()) {
    CAPTURE(std::string(kernels->name));
    Fast fast(arm, *kernels, given);
    Workspace ws(arm, given);
    ws.fast = FastPath();
    take_composite(arm, ws);
    for (double phase : {0.1, 0.9, 2.0}) {
      Eigen::VectorXd q, v, x(nv), tau = flexarm_test::wave(nv, phase, 1.0), forces(nv);
      place(arm, phase, q, v, bent);
      x = flexarm_test::wave(nv, 2.0 * phase, 1.0);
      ws.a = x;
      CHECK(kernels->forward(fast.memory.get(), q.data(), v.data(), tau.data(), x.data()));
      inverse_dynamics<double>(arm, ws, q, v, x);
      const Eigen::VectorXd left = ws.tau - tau;
      composite_mass_matrix(arm, ws);
      const Eigen::MatrixXd M = ws.M;
      const double size = (ws.M.cwiseAbs() * x.cwiseAbs() + tau.cwiseAbs()).maxCoeff() + ws.tau.cwiseAbs().maxCoeff();
      for (int i : ws.free) CHECK(std::abs(left[i]) < 1e-10 * size);
      inverse_dynamics<double>(arm, ws, q, v, tau);
      kernels->inverse(fast.memory.get(), q.data(), v.data(), tau.data(), forces.data());
      CHECK((forces - ws.tau).cwiseAbs().maxCoeff() < 1e-10 * ws.tau.cwiseAbs().maxCoeff());

      const flexarm::Shift shift{1e-3, 1e-5};  // D, K and the shift, by their effect
      inverse_dynamics<double>(arm, ws, q, v, tau, true);
      REQUIRE(factor_shifted(arm, ws, q, v, shift, true) == Status::ok);
      Eigen::VectorXd expected = Eigen::VectorXd::Zero(nv);
      solve_shifted(arm, ws, tau, expected);
      double twice = 0.0;
      CHECK(kernels->factor(fast.memory.get(), {shift.damping, shift.stiffness}, v.data(), &twice));
      kernels->solve(fast.memory.get(), tau.data(), x.data());
      CHECK((x - expected).cwiseAbs().maxCoeff() < 1e-7 * expected.cwiseAbs().maxCoeff());
      CHECK(twice == doctest::Approx(v.dot(M * v)).epsilon(1e-11));
      CHECK(ws.twice_kinetic == doctest::Approx(v.dot(M * v)).epsilon(1e-11));
    }
  }
}

JointForce spring() {
  JointForce f;
  f.stiffness = 3.0;
  f.rest = 0.2;
  f.damping = 0.4;
  f.reflected_inertia = 0.05;
  f.lower = -0.3;
  f.upper = 0.3;
  f.limit_stiffness = 50.0;
  f.limit_damping = 2.0;
  return f;
}

/// Links in one plane about `axis`, with everything that a joint may have.
Arm flat(const Vector3d& axis, std::array<int, 5> modes, int order, double damping = 0.0) {
  Placement seat;
  seat.position = {0.03, 0.02, 0.01};
  seat.rotation = Eigen::AngleAxisd(0.4, axis).toRotationMatrix();
  std::vector<Link> links;
  links.emplace_back(Joint::revolute(-axis), flexarm_test::body(0.5, {0.075, 0.01, -0.02}),
                     flexarm_test::beam(modes, order, damping), flexarm_test::body(0.2, {0.04, 0, 0.01}));
  links.emplace_back(Joint({{true, axis}}, false, {"turn"}, {spring()}, seat, seat), std::nullopt,
                     flexarm_test::beam(modes, order), std::nullopt);
  links.emplace_back(Joint::fixed(), flexarm_test::body(0.1, {0.02, 0, 0}), std::nullopt, std::nullopt);
  links.emplace_back(Joint::prismatic({0.6 * (1 - axis[0]), 0.8 * axis[2], 0.8 * axis[1]}),
                     flexarm_test::body(0.3, {0.1, 0, 0}), std::nullopt, std::nullopt);
  return Arm(std::move(links), {1.0, 2.0, -9.81});
}

}  // namespace

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
    for (const MassSlice& s : beam.slices()) inertia += s.inertia[0] * std::pow(s.table.linear(3, 0), 2);
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
        Fast fast(twisted, *kernels, {});
        const Eigen::Vector2d q(angle / turn, 0.7), v(8.0 / turn, -3.0), tau(0.02 * turn, 0.1);
        Eigen::Vector2d a;
        CHECK(kernels->forward(fast.memory.get(), q.data(), v.data(), tau.data(), a.data()));
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

TEST_CASE("what the kernels do not know takes the other way") {
  for (int order : {0, 3, kExact}) CHECK(lanes::KernelArm::of(flexarm_test::spatial_arm(order)) == nullptr);
  CHECK(lanes::KernelArm::of(flexarm_test::floating_arm()) == nullptr);
  const Arm arm = flexarm_test::spatial_arm();
  CHECK(bool(Workspace(arm).fast));
  CHECK(bool(Workspace(arm, {}, {Load::at_end(arm, 0, true)}).fast));
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

TEST_CASE("a scenario's motion does not depend on who shares its pack, and is that of a step by itself") {
  const Arm arm = flat({0, 0, 1}, {2, 0, 0, 0, 0}, 2, 0.01), heavy = flexarm_test::spatial_arm();
  constexpr int kScenarios = 11, kSteps = 40;
  for (const Arm* one : {&arm, &heavy})
    for (bool rk4 : {false, true}) {
      const int nq = one->nq(), nv = one->nv();
      const double h = rk4 ? 2e-6 : one == &arm ? 1e-3 : 1e-5;
      Eigen::MatrixXd q0(nq, kScenarios), v0(nv, kScenarios);
      for (int b = 0; b < kScenarios; ++b) {
        Eigen::VectorXd q, v;
        place(*one, 0.3 * b, q, v);
        q0.col(b) = 1e-3 * q;  // softly: what is too fast for the step must be quiet
        v0.col(b) = 1e-3 * v;
      }
      v0(0, 4) = std::numeric_limits<double>::infinity();  // runs away, and spoils no other
      const Eigen::VectorXd tau = flexarm_test::wave(nv, 0.5, 1e-3);
      const auto run = [&](int first, int count, bool side_by_side) {
        BatchProblem p{{one}, count, {}, {0.0}, {}, {kSteps}, {}, {}, {}};
        for (int k = 0; k < kSteps; ++k) {
          p.lengths.push_back(h);
          p.times.push_back((k + 1) * h);
          p.hold.push_back(0);
        }
        p.q0 = {q0.col(first).data(), nq, 0};
        p.v0 = {v0.col(first).data(), nv, 0};
        p.tau = {tau.data(), 0, 0};
        p.rk4 = rk4;
        p.lanes = side_by_side;
        Eigen::MatrixXd q(nq, count);
        std::vector<int> status(static_cast<std::size_t>(count));
        BatchOutput out;
        out.q = q.data();
        out.status = status.data();
        run_batch(p, out, 1);
        CAPTURE(nq);
        CAPTURE(rk4);
        CAPTURE(side_by_side);
        for (int b = 0; b < count; ++b) CHECK((status[static_cast<std::size_t>(b)] == 0) == (first + b != 4));
        return q;
      };
      const Eigen::MatrixXd all = run(0, kScenarios, true), alone = run(0, kScenarios, false);
      for (int b = 0; b < kScenarios; ++b) {
        if (b == 4) {
          CHECK(all.col(b).array().isNaN().all());
          continue;
        }
        CHECK((all.col(b) - alone.col(b)).cwiseAbs().maxCoeff() < 1e-11 * alone.col(b).cwiseAbs().maxCoeff());
        CHECK(run(b, 1, true) == all.col(b));
      }
    }
}
