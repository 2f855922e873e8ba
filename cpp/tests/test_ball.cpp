// Balls, and beams of order 0, on the kernels.
#include <doctest/doctest.h>

#include <algorithm>

#include "batches.hpp"
#include "flexarm/kinematics.hpp"
#include "flexarm/step.hpp"
#include "kernels.hpp"
#include "space/ball.hpp"

namespace test_ball {
using namespace flexarm;
using Eigen::Vector3d;
using flexarm_test::beam;
using flexarm_test::body;
using flexarm_test::check;
using flexarm_test::check_slopes;

namespace {

/// Spring, dampers and rotors of a ball that may turn so far.
std::vector<JointForce> ball_forces(double upper) {
  std::vector<JointForce> forces(3);
  for (int k = 0; k < 3; ++k) {
    JointForce& f = forces[static_cast<std::size_t>(k)];
    f.stiffness = 3.0;
    f.damping = 0.1 * (k + 1);
    f.reflected_inertia = 0.02 * (k + 1);
    f.upper = upper;
    if (std::isfinite(upper)) {
      f.limit_stiffness = 50.0;
      f.limit_damping = 2.0;
    }
  }
  return forces;
}

Placement turned_seat() {
  Placement seat;
  seat.position = {0.03, 0.02, 0.01};
  seat.rotation = Eigen::AngleAxisd(0.4, Vector3d(0.6, 0.0, 0.8)).toRotationMatrix();
  return seat;
}

Joint ball(std::vector<JointForce> forces = {}, const Placement& inboard = {}, const Placement& outboard = {}) {
  return Joint({}, true, {"wx", "wy", "wz"}, std::move(forces), inboard, outboard);
}

/// A ball behind a slide and a hinge, all with forces.
Joint hinged_ball(double upper) {
  std::vector<JointForce> forces = ball_forces(upper);
  forces.insert(forces.begin(), {flexarm_test::spring(), JointForce{}});
  return Joint({{false, {0, 0.6, 0.8}}, {true, {0, 1, 0}}}, true, {"x", "turn", "wx", "wy", "wz"}, forces,
               turned_seat(), turned_seat());
}

Arm arm_of(std::vector<Link> links) { return Arm(std::move(links), {1.0, 2.0, -9.81}); }

/// Balls at the base, between beams and at the end.
Arm many_balls(int order, double upper) {
  std::vector<Link> links;
  links.emplace_back(hinged_ball(upper), body(1.0, {0.1, 0.05, 0}), beam({2, 2, 1, 1, 1}, order),
                     body(0.2, {0.04, 0, 0.01}));
  links.emplace_back(ball(ball_forces(upper), turned_seat()), std::nullopt, beam({2, 1, 0, 0, 0}, order, 0.01),
                     std::nullopt);
  links.emplace_back(Joint::revolute({0, 0.6, 0.8}), body(0.3, {0.1, 0, 0}), std::nullopt, std::nullopt);
  links.emplace_back(ball({}, {}, turned_seat()), body(0.4, {0.1, 0, 0.2}), std::nullopt, std::nullopt);
  return arm_of(std::move(links));
}

void check_all(const Arm& arm, bool planar, double bent = 0.1) {
  check(arm, planar, {}, bent);
  check_slopes(arm, bent);
}

/// Beams of order 0 whose bodies sit off their axes.
Arm cut_arm(const Vector3d& axis, flexarm::StrainCounts modes, double damping = 0.0) {
  RigidBody tip = body(0.7, {0.04, 0, 0.03});
  tip.com = {0.2, 0.1 * axis[2], 0.1 * axis[1]};
  std::vector<Link> links;
  links.emplace_back(Joint::revolute(-axis), body(0.5, {0.075, 0.01, -0.02}), beam(modes, 0, damping), tip);
  links.emplace_back(Joint({{true, axis}}, false, {"turn"}, {flexarm_test::spring()}), std::nullopt, beam(modes, 0),
                     std::nullopt);
  links.emplace_back(Joint::revolute(axis), body(0.3, {0.1, 0, 0}), beam(modes, 0), tip);
  return arm_of(std::move(links));
}

}  // namespace

TEST_CASE("a ball alone, at any turn and any length of its quaternion") {
  const double none = std::numeric_limits<double>::infinity();
  std::vector<Link> links;
  links.emplace_back(ball(ball_forces(none), turned_seat(), turned_seat()), body(1.0, {0.1, 0, 0}), std::nullopt,
                     std::nullopt);
  check_all(arm_of(links), false);
  // what resists it, from no turn at all to beyond half a turn
  for (double upper : {none, 0.5, 3.0, 1e-3}) {
    links[0] = Link(ball(ball_forces(upper)), body(1.0, {0.1, 0, 0}), std::nullopt, std::nullopt);
    const Arm arm = arm_of(links);
    const oracle::Oracle truth(arm);
    const Eigen::VectorXd v = flexarm_test::wave(arm.nv(), 1.0, 2.0), a = flexarm_test::wave(arm.nv(), 2.0, 3.0);
    for (const lanes::Kernels* kernels : flexarm_test::all_kernels())
      for (double turn : {0.0, 1e-9, 1e-5, 1e-4, 3e-4, 1e-3, 1.5e-3, 0.4, 0.5, 0.5005, 2.0, 3.0, 3.14159, 4.0, 6.28})
        for (double length : {1.0, -0.7}) {
          CAPTURE(upper);
          CAPTURE(turn);
          flexarm_test::OnKernels on(arm, *kernels, {});
          Eigen::VectorXd q(arm.nq()), tau(arm.nv());
          q << std::cos(0.5 * turn), std::sin(0.5 * turn) * Vector3d(0.48, -0.64, 0.6);
          q *= length;
          const Eigen::VectorXd expected = truth.inverse(q, v, a);
          kernels->inverse(on.memory.get(), q.data(), v.data(), a.data(), tau.data());
          CHECK((tau - expected).norm() < 1e-13 * (expected.norm() + 10.0));
          const double kinks[] = {0.0, upper, upper + 1e-3, 3.141592653589793};  // where differences see none
          if (std::all_of(std::begin(kinks), std::end(kinks), [&](double k) { return !(std::abs(turn - k) < 1e-4); }))
            check_slopes(arm, q, v);
        }
  }
}

TEST_CASE("balls behind other motions, several in a chain, under beams") {
  for (double upper : {0.5, 3.0, std::numeric_limits<double>::infinity()}) {
    std::vector<Link> links;
    links.emplace_back(hinged_ball(upper), body(1.0, {0.1, 0, 0}), std::nullopt, std::nullopt);
    check_all(arm_of(links), false);
    links.emplace_back(ball(), body(0.5, {0.1, 0.2, 0}), std::nullopt, std::nullopt);
    links.emplace_back(Joint::revolute({1, 0, 0}), body(0.5, {0.1, 0.2, 0}), std::nullopt, std::nullopt);
    check_all(arm_of(links), false);
    for (int order : {0, 1, 2}) check_all(many_balls(order, upper), false);
  }
  std::vector<bool> given(static_cast<std::size_t>(many_balls(2, 3.0).nv()), false);
  given[0] = given[3] = true;  // of a joint that has a ball, and of the ball
  check(many_balls(2, 3.0), false, given);
}

TEST_CASE("beams of order 0, in the plane and in space") {
  for (double damping : {0.0, 0.02}) {
    check_all(cut_arm({0, 0, 1}, {3, 0, 0, 2, 0}, damping), true, 0.002);  // the tips' centres lie beside the plane
    check_all(cut_arm({0, 1, 0}, {0, 2, 0, 0, 1}, damping), true, 0.002);
    check_all(cut_arm({0, 0, 1}, {2, 2, 1, 1, 1}, damping), false, 0.002);
    check_all(cut_arm({0, 0.6, 0.8}, {2, 2, 2, 0, 0}, damping), false, 0.002);
  }
  check_all(flexarm_test::spatial_arm(0), false);
  check_slopes(cut_arm({0, 0.6, 0.8}, {2, 2, 2, 0, 0}), 3.0);  // where the cut inertia is no longer positive definite
}

TEST_CASE("packs of arms with balls, and of order 0, move as one by one") {
  constexpr int kScenarios = 11, kSteps = 40;
  struct Case {
    Arm arm;
    double step, bent;
  };
  std::vector<Link> rigid;
  rigid.emplace_back(hinged_ball(0.4), body(1.0, {0.1, 0, 0}), std::nullopt, std::nullopt);
  rigid.emplace_back(ball(), body(0.5, {0.1, 0.2, 0}), std::nullopt, std::nullopt);
  for (const Case& c : {Case{arm_of(rigid), 2e-3, 0.0}, Case{many_balls(2, 0.3), 1e-5, 1e-4},
                        Case{many_balls(0, 3.0), 1e-5, 1e-4}, Case{cut_arm({0, 1, 0}, {0, 2, 0, 0, 0}), 1e-4, 1e-3}})
    for (const OneStep::Traits& method : OneStep::methods()) {
      const Arm& arm = c.arm;
      const int nq = arm.nq(), nv = arm.nv();
      const double step = method.limit > 0.0 && c.bent > 0.0 ? 1e-6 : c.step, limit = 100.0;
      Eigen::MatrixXd q0(nq, kScenarios), v0(nv, kScenarios);
      for (int b = 0; b < kScenarios; ++b) {
        Eigen::VectorXd q, v;
        flexarm_test::place(arm, 0.3 * b, q, v, c.bent);
        for (std::size_t n = 0; n < arm.size(); ++n) {
          v.segment(arm.first(n) + arm.link(n).nj(), arm.link(n).ne()) *= 1e-3;
        }
        normalise(arm, q);
        q0.col(b) = q;
        v0.col(b) = v;
      }
      v0(0, 4) = std::numeric_limits<double>::infinity();  // runs away, and spoils no other
      const Eigen::VectorXd tau = flexarm_test::wave(nv, 0.5, 1e-2), by_q = flexarm_test::wave(nq, 0.1, 0.1),
                            by_v = flexarm_test::wave(nv, 0.2, 0.1), column = Eigen::VectorXd::Unit(nv, 0);
      const auto run = [&](int first, int count, bool side_by_side, int whole = 0) {
        BatchProblem p = flexarm_test::batch_of({&arm}, count, step, kSteps);
        Problem one = *p.problems[0];
        one.tau = tau;
        Feedback law{column, by_q, by_v};
        law.limit = limit;
        one.feedback = {law};
        p.problems = {std::make_shared<Problem>(one)};
        flexarm_test::begin_at(p, q0, v0, first);
        p.method.name = method.name;
        p.whole = whole;
        p.lanes = side_by_side;
        Eigen::MatrixXd q(2 * nq, count);
        std::vector<int> status(static_cast<std::size_t>(count));
        BatchOutput out;
        out.q = q.data();
        out.status = status.data();
        const BatchStats stats = run_batch(p, out, 1);
        CHECK((stats.lanes > 1) == side_by_side);
        CAPTURE(first);
        for (int b = 0; b < count; ++b) CHECK((status[static_cast<std::size_t>(b)] == 0) == (first + b != 4));
        return q;
      };
      CAPTURE(nq);
      CAPTURE(method.name);
      const Eigen::MatrixXd all = run(0, kScenarios, true), alone = run(0, kScenarios, false);
      for (int b = 0; b < kScenarios; ++b) {
        if (b == 4) continue;
        CHECK((all.col(b) - alone.col(b)).cwiseAbs().maxCoeff() < 1e-12);
        CHECK(run(b, 1, true, kScenarios) == all.col(b));
        CHECK(run(b, 1, false) == alone.col(b));
        CHECK((all.col(b).tail(nq) - all.col(b).head(nq)).norm() > 1e-6);
      }
    }
}

TEST_CASE("a kernel moves coordinates as quaternions' algebra does") {
  const auto quaternion = [](const double* p) { return Eigen::Quaterniond(p[0], p[1], p[2], p[3]); };
  const auto put = [](const Eigen::Quaterniond& p, double* out) { Eigen::Map<Eigen::Vector4d>(out) << p.w(), p.vec(); };
  const Arm arm = many_balls(2, 3.0);
  const lanes::Layout& layout = lanes::KernelArm::of(arm).layout();
  const Eigen::VectorXd q0 = flexarm_test::wave(arm.nq(), 0.3, 1.0);
  Eigen::VectorXd q(arm.nq()), expected = q0;
  for (double size : {0.0, 1e-9, 1e-7, 0.3, 7.0}) {
    const Eigen::VectorXd u = flexarm_test::wave(arm.nv(), 0.7, size);
    for (std::size_t n = 0; n < arm.size(); ++n) {
      const Link& link = arm.link(n);
      const int i = arm.first_q(n), j = arm.first(n), nq = link.joint().nq(), nj = link.nj(),
                before = nq - (link.joint().has_ball() ? 4 : 0);
      expected.segment(i, before) = q0.segment(i, before) + u.segment(j, before);
      expected.segment(i + nq, link.ne()) = q0.segment(i + nq, link.ne()) + u.segment(j + nj, link.ne());
      if (!link.joint().has_ball()) continue;
      const Eigen::Vector3d by = u.segment<3>(j + before);
      const Eigen::AngleAxisd turn(by.norm(), by.norm() > 0.0 ? by.normalized() : Eigen::Vector3d::UnitX());
      put((quaternion(q0.data() + i + before) * turn).normalized(), expected.data() + i + before);
    }
    displace(layout, q0.data(), u.data(), q.data());
    CHECK((q - expected).norm() < 1e-14);
    for (std::size_t n = 0; n < arm.size(); ++n) {
      const Link& link = arm.link(n);
      const int i = arm.first_q(n), j = arm.first(n), nq = link.joint().nq(), nj = link.nj(),
                before = nq - (link.joint().has_ball() ? 4 : 0);
      expected.segment(i, before) = u.segment(j, before);
      expected.segment(i + nq, link.ne()) = u.segment(j + nj, link.ne());
      if (!link.joint().has_ball()) continue;
      const Eigen::Quaterniond p = quaternion(q0.data() + i + before);
      const Eigen::Vector3d w = 0.5 * u.segment<3>(j + before);
      put(p * Eigen::Quaterniond(0.0, w[0], w[1], w[2]), expected.data() + i + before);
      expected.segment<4>(i + before) += (1.0 - p.squaredNorm()) * q0.segment<4>(i + before);
    }
    ::coordinate_rates(layout, q0.data(), u.data(), q.data());
    CHECK((q - expected).norm() < 1e-13 * (1.0 + size));
  }
  q = expected = q0;
  normalise(layout, q.data());
  for (std::size_t n = 0; n < arm.size(); ++n)
    if (arm.link(n).joint().has_ball()) expected.segment<4>(arm.first_q(n) + arm.link(n).joint().nq() - 4).normalize();
  CHECK((q - expected).norm() < 1e-15);
}

}  // namespace test_ball
