// The step of predictions: closed forms, its derivatives against differences, friction that is hard to solve, limits.
#include <doctest/doctest.h>

#include <cmath>
#include <complex>

#include "acted_on.hpp"
#include "predictive_step.hpp"

namespace test_predictive_step {
using namespace flexarm;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kSpeed = 0.05;

/// A mass on a slide.
Arm slide(const JointForce& force, double mass = 2.0) {
  std::vector<Link> links;
  RigidBody body;
  body.mass = mass;
  links.emplace_back(Joint({{false, {1, 0, 0}}}, false, {"x"}, {force}), body, std::nullopt, std::nullopt);
  return Arm(std::move(links));
}

VectorXd one(double x) { return VectorXd::Constant(1, x); }

}  // namespace

TEST_CASE("of an oscillator, the step is that of its stability function, of order 2, and still where it is stiff") {
  JointForce spring;
  spring.stiffness = 200.0;
  const Problem problem(slide(spring));
  PredictiveStep step(problem, MatrixXd(1, 0), {}, kSpeed, 1);
  const double w = 10.0, share = 1.0 - std::sqrt(0.5);
  const auto after = [&](double h, int steps) {
    VectorXd q = one(0.3), v = one(0.0);
    for (int k = 0; k < steps; ++k) REQUIRE(step(0, 0.0, h, q, v, one(0.0)) == Status::ok);
    return std::complex<double>(q[0], v[0] / w);
  };
  for (const double h : {0.01, 0.1, 1.0, 1e3}) {  // q + i v / w goes to it times the conjugate of R(i w h)
    const std::complex<double> z(0.0, -w * h), R = (1.0 + (1.0 - 2.0 * share) * z) / std::pow(1.0 - share * z, 2);
    CHECK(std::abs(after(h, 1) - 0.3 * R) < 1e-9);
    CHECK((h < 1e3 || std::abs(R) < 1e-3));
  }
  const auto error = [&](int steps) { return std::abs(after(1.0 / steps, steps) - 0.3 * std::polar(1.0, -w)); };
  CHECK(error(200) < 1e-3);
  CHECK(error(200) / error(400) == doctest::Approx(4.0).epsilon(0.05));
}

TEST_CASE("of an oscillator, five stages are of order 4, follow a frequency, and are still where it is stiff") {
  JointForce spring;
  spring.stiffness = 200.0;
  const Problem problem(slide(spring));
  PredictiveStep step(problem, MatrixXd(1, 0), {}, kSpeed, 1, ImplicitStages::five());
  const double w = 10.0;
  const auto after = [&](double h, int steps) {
    VectorXd q = one(0.3), v = one(0.0);
    for (int k = 0; k < steps; ++k) REQUIRE(step(0, 0.0, h, q, v, one(0.0)) == Status::ok);
    return std::complex<double>(q[0], v[0] / w) / 0.3;
  };
  const auto error = [&](int steps) { return std::abs(after(1.0 / steps, steps) - std::polar(1.0, -w)); };
  CHECK(error(40) / error(80) == doctest::Approx(16.0).epsilon(0.05));
  CHECK(std::abs(std::arg(after(0.1, 1)) + 1.0) < 1e-3);
  CHECK(std::abs(std::abs(after(0.1, 1)) - 1.0) < 1e-4);
  CHECK(std::abs(after(1e3, 1)) < 1e-3);
}

TEST_CASE("derivatives by state, commands and parameters are those of differences") {
  for (const bool balls : {false, true}) {
    CAPTURE(balls);
    const ImplicitStages stages = balls ? ImplicitStages::five() : ImplicitStages::two();
    const Problem problem = balls ? flexarm_test::acted_on() : Problem(flexarm_test::spatial_arm());
    const Arm& arm = *problem.arm;
    const Eigen::Index n = arm.nv(), at = balls ? 1 : 0;
    const int rate = static_cast<int>(at);
    const MatrixXd columns = MatrixXd::Identity(n, n).middleCols(3, 3);
    const std::vector<KalmanParameter> kinds{{KalmanParameter::payload, 0, 0.0, 0.0},
                                             {KalmanParameter::damping, rate, 0.0, 0.0},
                                             {KalmanParameter::coulomb, rate, 0.0, 0.0},
                                             {KalmanParameter::offset, rate, 0.0, 0.0},
                                             {KalmanParameter::gain, rate, 0.0, 0.0}};
    const auto np = static_cast<Eigen::Index>(kinds.size()), all = 2 * n + 3 + np;
    PredictiveStep step(problem, columns, kinds, 1.0, 1, stages);
    VectorXd x0 = VectorXd::Zero(all);
    x0.tail(3 + np) << 0.5, 0.4, 0.3, 0.2, 0.05, 0.3, 0.02, 0.1;
    const auto end = [&](const VectorXd& x) {
      auto [q, v] = flexarm_test::displaced(problem, x.head(2 * n));
      VectorXd forces = columns * x.segment(2 * n, 3);
      forces[at] += 0.4;
      REQUIRE(step(0, 0.03, 2e-3, q, v, forces, x.tail(np)) == Status::ok);
      return std::pair(q, v);
    };
    const auto here = end(x0);
    if (balls) {
      CHECK(here.first[0] == doctest::Approx(0.1 * 0.032 * 0.032));
      CHECK(here.second[0] == doctest::Approx(0.2 * 0.032));
    }
    MatrixXd A(2 * n, 2 * n), B(2 * n, 3 + np), differences(2 * n, all);
    step.derivatives(A, B);
    const MatrixXd bend = step.bend();
    for (Eigen::Index k = 0; k < all; ++k) {
      const double e = k < 2 * n ? 1e-5 : 1e-3;
      const auto more = end(x0 + e * VectorXd::Unit(all, k)), less = end(x0 - e * VectorXd::Unit(all, k));
      VectorXd up(n), down(n);
      displacement(arm, here.first, more.first, up);
      displacement(arm, here.first, less.first, down);
      differences.col(k) << (up - down) / (2.0 * e), (more.second - less.second) / (2.0 * e);
    }
    CHECK((A - differences.leftCols(2 * n)).norm() < 1e-6 * A.norm());
    for (Eigen::Index k = 0; k < 3 + np; ++k) {
      CAPTURE(k);
      const VectorXd slope = differences.col(2 * n + k);
      CHECK((B.col(k) - slope).norm() < 1e-5 * (slope.norm() + 1.0));
    }
    CHECK(bend.cols() == all);
    CHECK(bend.allFinite());
  }
}

TEST_CASE("friction that sticks and turns is solved, whatever its speed") {
  const double mass = 0.02, h = 1e-3, g = (1.0 - std::sqrt(0.5)) * h;
  for (const double speed : {1e-2, 1e-4, 1e-6})
    for (const double coulomb : {0.1, 10.0}) {
      CAPTURE(speed);
      CAPTURE(coulomb);
      JointForce rough;
      rough.coulomb = coulomb;
      const Problem problem(slide(rough, mass));
      PredictiveStep step(problem, MatrixXd(1, 0), {}, speed, 1);
      const auto stage = [&](double from, double force) {  // v of m (v - from) / g + c v / hypot(v, speed) = force
        double low = -1e4, high = 1e4;
        for (int k = 0; k < 200; ++k) {
          const double v = 0.5 * (low + high);
          (mass * (v - from) / g + coulomb * v / std::hypot(v, speed) < force ? low : high) = v;
        }
        return low;
      };
      int turned = 0;
      for (int k = 0; k < 300; ++k) {  // each from another state than the last
        const double v0 = std::pow(10.0, k % 7 - 5) * std::sin(1.0 * k), force = 3.0 * coulomb * std::sin(0.37 * k);
        const double v1 = stage(v0, force), v2 = stage(v0 + (h - g) * (v1 - v0) / g, force);
        VectorXd q = one(0.0), v = one(v0);
        REQUIRE(step(0, 0.0, h, q, v, one(force)) == Status::ok);
        CHECK(v[0] == doctest::Approx(v2).epsilon(1e-6).scale(1e-9));
        turned += v0 * v[0] < 0.0;
      }
      CHECK(turned > 50);
    }
}

TEST_CASE("a motor at its limit gives no more, and no derivative; an offset is no motor's") {
  JointForce motor;
  motor.torque_limit = 3.0;
  const Problem problem(slide(motor));
  PredictiveStep step(problem, MatrixXd::Identity(1, 1), {{KalmanParameter::offset, 0, 0.0, 0.0}}, kSpeed, 1);
  for (const double asked : {2.0, 7.0}) {
    VectorXd q = one(0.0), v = one(0.0);
    REQUIRE(step(0, 0.0, 0.01, q, v, one(asked), one(0.5)) == Status::ok);
    CHECK(v[0] == doctest::Approx(0.01 * (std::min(asked, 3.0) + 0.5) / 2.0));
    CHECK(q[0] == doctest::Approx(0.5e-4 * (std::min(asked, 3.0) + 0.5) / 2.0));
    MatrixXd A(2, 2), B(2, 2);
    step.derivatives(A, B);
    CHECK(B(1, 0) == doctest::Approx(asked < 3.0 ? 0.005 : 0.0));
    CHECK(B(1, 1) == doctest::Approx(0.005));
    CHECK(A.isApprox((MatrixXd(2, 2) << 1.0, 0.01, 0.0, 1.0).finished(), 1e-12));
  }
}

TEST_CASE("what is remembered is all that matters; an arm of negative inertia has no step") {
  const Problem problem(flexarm_test::spatial_arm());
  const Eigen::Index n = problem.arm->nv();
  const std::vector<KalmanParameter> payload{{KalmanParameter::payload, 0, 0.0, 0.0}};
  PredictiveStep step(problem, MatrixXd(n, 0), payload, kSpeed, 2), other(problem, MatrixXd(n, 0), payload, kSpeed, 2);
  const auto go = [&](PredictiveStep& s, double mass, Status expected = Status::ok) {
    VectorXd q = flexarm_test::wave(static_cast<int>(n), 0.1, 1e-3), v = flexarm_test::wave(static_cast<int>(n), 0.4);
    for (int k = 0; k < 3; ++k) CHECK(s(1, 0.0, 1e-3, q, v, VectorXd::Zero(n), one(mass)) == expected);
    return v;
  };
  go(step, 0.1);
  other.recall(step.memory());
  CHECK(go(other, 0.2) == go(step, 0.2));
  go(step, -50.0, Status::singular);
  go(step, 0.1);
}

}  // namespace test_predictive_step
