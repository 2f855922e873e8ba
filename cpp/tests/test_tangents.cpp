#include <doctest/doctest.h>

#include "arms.hpp"
#include "flexarm/ida.hpp"

namespace test_tangents {
using namespace flexarm;

namespace {

/// A block on a slide.
Arm block(double mass, double coulomb = 0.0, double stiction = 0.0) {
  JointForce force;
  force.coulomb = coulomb;
  force.stiction = stiction;
  std::vector<Link> links;
  links.emplace_back(Joint({{false, {1, 0, 0}}}, false, {"x"}, {force}), RigidBody{mass}, std::nullopt, std::nullopt);
  return Arm(std::move(links));
}

Problem driven(const Arm& arm, std::vector<Drive> drives, double v0 = 0.0) {
  Problem out(arm);
  out.drives = std::move(drives);
  out.v0 << v0;
  return out;
}

/// Central differences of second order, exact for what is a polynomial of degree two.
template <class Make>
Parameter parameter(double value, double h, const Make& make) {
  Parameter p;
  p.scale = value;
  for (double d : {-h, h}) p.neighbours.push_back({(d > 0.0 ? 0.5 : -0.5) / h, d, make(value + d)});
  return p;
}

}  // namespace

TEST_CASE("tangents of a pushed block are those of its closed form, with both linear solvers") {
  const Arm arm = block(2.0);
  const Eigen::VectorXd t = Eigen::VectorXd::LinSpaced(11, 0.0, 1.0);
  const auto push = [](double scale) { return Drive{0, {}, [scale](double time) { return scale * 6.0 * time; }}; };
  const std::vector<Parameter> by = {
      parameter(2.0, 1e-3, [&](double mass) { return driven(block(mass), {push(1.0)}); }),
      parameter(1.0, 1e-3, [&](double scale) { return driven(arm, {push(scale)}, 3.0 * (scale - 1.0)); })};
  for (LinearSolver solver : {LinearSolver::dense, LinearSolver::chain}) {
    IdaOptions options{1e-9, 1e-12};
    options.linear_solver = solver;
    const Trajectory r = simulate_ida(driven(arm, {push(1.0)}), t, options, {}, by);
    REQUIRE(r.failure.empty());
    REQUIRE(r.tangents.size() == 2);
    for (int k = 0; k < 11; ++k) {
      const double x = t[k];
      CHECK(r.q(k, 0) == doctest::Approx(x * x * x / 2.0).epsilon(1e-7));
      CHECK(r.tangents[0].q(k, 0) == doctest::Approx(-x * x * x / 4.0).epsilon(1e-6));
      CHECK(r.tangents[0].a(k, 0) == doctest::Approx(-1.5 * x).epsilon(1e-6));
      CHECK(r.tangents[1].q(k, 0) == doctest::Approx(3.0 * x + x * x * x / 2.0).epsilon(1e-6));
      CHECK(r.tangents[1].v(k, 0) == doctest::Approx(3.0 + 1.5 * x * x).epsilon(1e-6));
      CHECK(r.tangents[1].tau(k, 0) == doctest::Approx(6.0 * x).epsilon(1e-9));
    }
  }
}

TEST_CASE("tangents of a prescribed motion, and of its reaction") {
  const Arm arm = block(2.0);
  const Eigen::VectorXd t = Eigen::VectorXd::LinSpaced(5, 0.0, 1.0);
  const auto moved = [](double scale) {
    return Drive{
        0, [scale](double x) { return MotionValue{scale * x * x * x, 3.0 * scale * x * x, 6.0 * scale * x}; }, {}};
  };
  const std::vector<Parameter> by = {
      parameter(1.0, 1e-3, [&](double scale) { return driven(arm, {moved(scale)}); }),
      parameter(2.0, 1e-3, [&](double mass) { return driven(block(mass), {moved(1.0)}); })};
  const Trajectory r = simulate_ida(driven(arm, {moved(1.0)}), t, {}, {}, by);
  REQUIRE(r.done == 5);
  for (int k = 0; k < 5; ++k) {
    CHECK(r.tangents[0].v(k, 0) == doctest::Approx(3.0 * t[k] * t[k]));
    CHECK(r.tangents[0].tau(k, 0) == doctest::Approx(12.0 * t[k]));
    CHECK(r.tangents[1].q(k, 0) == 0.0);
    CHECK(r.tangents[1].tau(k, 0) == doctest::Approx(6.0 * t[k]));
  }
}

TEST_CASE("tangents go through sticking and sliding as the closed form does") {
  // pushed by 2 t against a stiction of 1.5 and a friction of 1: off at T = 0.75; and slid to rest from 3 m/s
  const double c = 1.0, s = 1.5, m = 2.0;
  const Arm arm = block(m, c, s);
  const Eigen::VectorXd t = Eigen::VectorXd::LinSpaced(21, 0.0, 2.0);
  const auto problem = [](const Arm& of, double v0, bool pushed) {
    return driven(of, pushed ? std::vector<Drive>{{0, {}, [](double x) { return 2.0 * x; }}} : std::vector<Drive>{},
                  v0);
  };
  const auto simulate = [&](double v0, bool pushed) {
    const auto by = [&](double value, const auto& make) {
      return parameter(value, 1e-3, [&](double x) { return problem(make(x), v0, pushed); });
    };
    const IdaOptions options{1e-9, 1e-12};
    return simulate_ida(
        problem(arm, v0, pushed), t, options, {},
        {by(c, [&](double x) { return block(m, x, s); }), by(s, [&](double x) { return block(m, c, x); }),
         by(m, [&](double x) { return block(x, c, s); })});
  };
  const Trajectory off = simulate(0.0, true);
  REQUIRE(off.failure.empty());
  CHECK(off.stats.switches == 1);
  for (int k = 0; k < 21; ++k) {
    const double after = std::max(t[k] - s / 2.0, 0.0);
    CHECK(off.tangents[0].v(k, 0) == doctest::Approx(-after / m).epsilon(1e-6));
    CHECK(off.tangents[1].v(k, 0) == doctest::Approx(after > 0.0 ? (c - s) / (2.0 * m) : 0.0).epsilon(1e-6));
    CHECK(off.tangents[1].q(k, 0) == doctest::Approx(after * (c - s) / (2.0 * m)).epsilon(1e-6));
    CHECK(off.tangents[0].friction(k, 0) == doctest::Approx(after > 0.0 ? -1.0 : 0.0).epsilon(1e-9));
    CHECK(off.tangents[2].tau(k, 0) == doctest::Approx(0.0).epsilon(1e-9));
  }
  const Trajectory rest = simulate(0.5, false);  // at rest from t = 1 on, 0.25 m away
  REQUIRE(rest.failure.empty());
  CHECK(rest.q(20, 0) == doctest::Approx(0.25));
  CHECK(rest.tangents[0].q(20, 0) == doctest::Approx(-0.25).epsilon(1e-6));
  CHECK(rest.tangents[1].q(20, 0) == doctest::Approx(0.0));
  CHECK(rest.tangents[2].q(20, 0) == doctest::Approx(0.125).epsilon(1e-6));
  CHECK(rest.tangents[0].v(20, 0) == 0.0);
}

TEST_CASE("what has no tangents is refused") {
  const Eigen::VectorXd t = Eigen::VectorXd::LinSpaced(3, 0.0, 1.0);
  const Arm arm = block(1.0);
  CHECK_THROWS_WITH_AS(simulate_ida(Problem(arm), t, {}, {}, {Parameter{}}),
                       "neighbours of parameter 0 = 0: must be one or more", std::invalid_argument);
  const Parameter rough = parameter(1.0, 1e-3, [](double) { return Problem(block(1.0, 0.1, 0.1)); });
  CHECK_THROWS_WITH_AS(simulate_ida(Problem(arm), t, {}, {}, {rough}),
                       "coulomb or stiction = 0: has no derivative where there is no dry friction",
                       std::invalid_argument);
}

}  // namespace test_tangents
