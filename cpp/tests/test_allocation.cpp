// The contract of the hot path: after set-up nothing is allocated, locked, thrown or printed, no system call is made,
// and the work of a call is bounded.
#include <doctest/doctest.h>

#include <cstdio>
#include <mutex>
#include <utility>
#include <vector>

#include "arms.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/computed_torque.hpp"
#include "flexarm/derivatives.hpp"
#include "flexarm/ida.hpp"
#include "flexarm/laws.hpp"
#include "flexarm/simulation.hpp"
#include "flexarm/step.hpp"
#include "watch.hpp"

namespace test_allocation {
using namespace flexarm;

TEST_CASE("a step gives up after the iterations that it was granted") {
  const Arm arm = flexarm_test::spatial_arm();
  Workspace ws(arm);
  ImplicitOptions options;
  options.rtol = 1e-300;  // never reached
  options.max_iterations = 4;
  ImplicitStep step(arm, 1e-4, options);
  Eigen::VectorXd q = arm.zero(), v = flexarm_test::wave(arm.nv(), 0.4, 2.0);
  const Eigen::VectorXd tau = flexarm_test::wave(arm.nv(), 0.7), q0 = q, v0 = v;
  CHECK(step(ws, q, v, tau) == Status::not_converged);
  CHECK(step.iterations() == 40);  // of the whole step, and of the first of 1, 2, 4 .. 256 parts
  CHECK(step.counts().evaluations == 40);
  CHECK(step.counts().factorisations <= 40);
  CHECK((q == q0 && v == v0));  // as before
}

#ifdef FLEXARM_WATCHES

using flexarm_test::Asked, flexarm_test::Calls, flexarm_test::system_calls, flexarm_test::watch;

namespace {

template <class F>
void check_nothing(const char* what, const F& f) {
  CAPTURE(what);
  const Asked asked = watch(f);
  CHECK(asked.allocations == 0);
  CHECK(asked.locks == 0);
  CHECK(asked.throws == 0);
}

/// What a simulation steps by: fixed steps, and those that are chosen.
std::vector<Method> methods(std::vector<std::string> names) {
  std::vector<Method> out;
  for (std::string& name : names) out.push_back({std::move(name)});
  out.push_back({"gauss"});
  out.back().tolerance = 1e-5;
  return out;
}

/// Calls of all that the hot path offers, with what they write into. Every kind of joint force, beam order and load.
struct HotPath {
  const Arm& arm;
  Workspace ws, own;  // CI and single calls; steps
  std::vector<Feedback> laws;
  Eigen::VectorXd q, v, tau, dq, a, x;
  Mat6X<double> J;
  PlacedSlice at;  // in the middle of the last beam
  std::size_t last = 0;
  ImplicitStep implicit;
  Rk4Step rk4;
  InverseDerivatives by_inverse;
  ForwardDerivatives by_forward;
  Status status = Status::ok;

  HotPath(const Arm& of, const std::vector<bool>& prescribed, const std::vector<Load>& loads)
      : arm(of),
        ws(of, prescribed, loads),
        own(of, prescribed, loads),
        laws(1),
        q(of.zero()),
        v(flexarm_test::wave(of.nv(), 0.4)),
        tau(flexarm_test::wave(of.nv(), 0.7)),
        dq(q),
        a(tau),
        x(tau),
        J(6, of.nv()),
        at(of, 0),
        implicit(of, 1e-5),
        rk4(of, 1e-7),
        by_inverse(of, loads),
        by_forward(of, loads, prescribed) {
    laws[0].column = Eigen::VectorXd::Unit(arm.nv(), 0);
    laws[0].by_q = flexarm_test::wave(arm.nq(), 0.1);
    laws[0].by_v = flexarm_test::wave(arm.nv(), 0.2);
    for (Workspace* w : {&ws, &own}) {
      for (auto& load : w->loads) load.wrench << 0.1, 0.2, 0.3, 0.01, 0.02, 0.03;
      w->feed_back(laws);
      take_composite(arm, *w);
    }
    for (std::size_t n = 0; n < arm.size(); ++n)
      if (arm.link(n).beam()) last = n;
    if (arm.link(last).beam()) at = PlacedSlice(arm, last, 0.5 * arm.link(last).beam()->length());
  }

  void dynamics() {
    if (forward_dynamics_ab(arm, ws, q, v, tau) != Status::ok) status = Status::singular;
    inverse_dynamics(arm, ws, q, v, a);
    joint_forces(arm, ws, a);
    composite_mass_matrix(arm, ws);
    if (forward_dynamics_ci(arm, ws, q, v, tau) != Status::ok) status = Status::singular;
    move_arm(arm, ws, q, v);
    if (factor_shifted(arm, ws, q, v, {1e-3, 1e-6}) != Status::ok) status = Status::singular;
    solve_shifted(arm, ws, tau, x);
  }
  void derivatives() {
    by_inverse(arm, q, v, a);
    if (by_forward(arm, q, v, tau) != Status::ok) status = Status::singular;
  }
  void kinematics() {
    move_arm(arm, ws, q, v);
    coordinate_rates(arm, q, v, dq);
    accelerate_arm(arm, ws, a);
    slice_jacobian(arm, ws, last, J);
    slice_jacobian(arm, ws, at, J);
    x[0] += slice_pose(ws, at).p[0] + slice_pose(ws, last).p[0] + link_pose(ws, last).p[0] + slice_in_link(ws, at).p[0];
    x[0] += slice_motion(arm, ws, at).acceleration[0] + slice_motion(arm, ws, last).acceleration[0];
    x[0] += energy(arm, ws, q, v).kinetic + momentum(arm, ws, q, v).mass;
  }
  template <class S>
  void steps(S& step) {
    for (int k = 0; k < 5 && status == Status::ok; ++k) status = step(own, q, v, tau);
  }
  void all() {
    dynamics();
    kinematics();
    steps(implicit);
    steps(rk4);
  }
};

void check_arm(const Arm& arm, const std::vector<bool>& prescribed, bool calls = false) {
  const std::vector<Load> loads{Load::at_end(arm, arm.size() - 1, true)};
  HotPath hot(arm, prescribed, loads);
  check_nothing("dynamics", [&] { hot.dynamics(); });
  check_nothing("derivatives", [&] { hot.derivatives(); });
  check_nothing("kinematics", [&] { hot.kinematics(); });
  check_nothing("implicit", [&] { hot.steps(hot.implicit); });
  check_nothing("rk4", [&] { hot.steps(hot.rk4); });
  CHECK(hot.status == Status::ok);
  if (!calls) return;
  const Calls made = system_calls([&] { hot.all(); });
  if (made == Calls::unknown) MESSAGE("SKIPPED, not passed: this kernel does not let a process forbid itself calls");
  CHECK(made != Calls::some);
}

}  // namespace

TEST_CASE("the watch sees") {
  CHECK(watch([] { std::vector<double> x(100), y(x); }).allocations >= 2);
  CHECK(watch([] { Eigen::VectorXd x = Eigen::VectorXd::Zero(100); }).allocations >= 1);
  static std::mutex mutex;
  CHECK(watch([] { const std::lock_guard<std::mutex> lock(mutex); }).locks == 1);
  CHECK(watch([] {
          try {
            throw 1;
          } catch (int) {
          }
        }).throws == 1);
  CHECK(system_calls([] { std::fputs("", stdout); }) != Calls::some);
  CHECK(system_calls([] { std::fputs(" ", stdout); }) != Calls::none);
  CHECK(system_calls([] { std::vector<char> x(100'000'000); }) != Calls::none);
}

TEST_CASE("dynamics, kinematics and steps ask nothing of the system") {
  for (int order : {0, 1, 2, 3, kExact}) {
    CAPTURE(order);
    const Arm arm = flexarm_test::spatial_arm(order);
    check_arm(arm, {}, order == 2 || order == kExact);
    std::vector<bool> first(static_cast<std::size_t>(arm.nv()), false);
    first[1] = true;
    check_arm(arm, first);
  }
  check_arm(flexarm_test::floating_arm(), {}, true);
  check_arm(flexarm_test::tree_arm(), {}, true);
  std::vector<Link> many;  // with many elastic coordinates
  many.emplace_back(Joint::revolute({0, 0, 1}), flexarm_test::body(0.5, {0.075, 0, 0}),
                    flexarm_test::beam({12, 12, 8, 4, 4}, 2), flexarm_test::body(0.2, {0.04, 0, 0.01}));
  check_arm(Arm(std::move(many)), {}, true);
}

TEST_CASE("a step that fails throws nothing and asks for nothing") {
  const Arm arm = flexarm_test::spatial_arm();
  Workspace ws(arm);
  ImplicitStep implicit(arm, 1e-4);
  Rk4Step rk4(arm, 1.0);  // far beyond its stability
  Eigen::VectorXd q = arm.zero(), v = flexarm_test::wave(arm.nv(), 0.4), tau = flexarm_test::wave(arm.nv(), 0.7);
  Status status = Status::ok;
  check_nothing("rk4", [&] {
    for (int k = 0; k < 100 && status == Status::ok; ++k) status = rk4(ws, q, v, tau);
  });
  CHECK(status == Status::not_finite);
  tau[0] = std::numeric_limits<double>::quiet_NaN();
  check_nothing("implicit", [&] { status = implicit(ws, q, v, tau); });
  CHECK(status == Status::not_finite);
}

TEST_CASE("joints that stick and slide within steps ask nothing of the system") {
  for (const double height : {0.004, 0.3}) {  // without a load, and with one
    JointForce rough;
    rough.coulomb = 0.2;
    rough.stiction = 0.3;
    std::vector<Link> links;
    for (int n = 0; n < 2; ++n)
      links.emplace_back(Joint({{true, {0, 0, 1}}}, false, {"z"}, {rough}), flexarm_test::body(0.3, {height, 0, 0}),
                         flexarm_test::beam({2, 0, 0, 0, 0}, 2, 0.02), std::nullopt);
    const Arm arm(std::move(links));
    const std::vector<Load> loads(height > 0.1 ? 1 : 0, Load::at_end(arm, 1, true));
    Workspace ws(arm, {}, loads);
    ImplicitStep step(arm, 1e-3);
    Eigen::VectorXd q = arm.zero(), v = q, tau = q;
    Status status = Status::ok;
    const auto run = [&](int from, int to) {
      for (int k = from; k < to && status == Status::ok; ++k) {
        tau[0] = std::sin(0.02 * k);
        tau[3] = 0.4 * std::sin(0.033 * k);
        status = step(ws, q, v, tau);
      }
    };
    run(0, 1);
    check_nothing("implicit with friction", [&] { run(1, 1000); });
    CHECK(status == Status::ok);
    CHECK(step.counts().switches > 5);
  }
}

TEST_CASE("steps that end at switches of dry friction ask nothing of the system") {
  JointForce rough;
  rough.coulomb = 0.2;
  rough.stiction = 0.3;
  std::vector<Link> links;
  for (int n = 0; n < 2; ++n)
    links.emplace_back(Joint({{true, {0, 0, 1}}}, false, {"z"}, {rough}), flexarm_test::body(0.3, {0.1, 0, 0}),
                       std::nullopt, std::nullopt);
  Problem problem{Arm(std::move(links))};
  problem.drives = {{0, {}, [](double t) { return 0.9 * std::sin(20.0 * t); }},
                    {1, {}, [](double t) { return 0.7 * std::sin(33.0 * t); }}};
  problem.events = {{[](double t, const Eigen::VectorXd&, const Eigen::VectorXd&) { return std::cos(6.0 * t); }}};
  for (const Method& method : methods({"rk4", "gauss"})) {
    CAPTURE(method.tolerance);
    Simulation sim(problem, method, 1e-3);
    Status status = sim.step();
    int switches = 0;
    bool held = false;
    check_nothing(method.name.c_str(), [&] {
      for (int k = 0; k < 1000 && status == Status::ok; ++k) {
        status = sim.step();
        switches += std::exchange(held, sim.v()[0] == 0.0) != held;
      }
    });
    CHECK(status == Status::ok);
    CHECK(switches >= 2);
    CHECK(sim.events()[0].t.size() > 0);
    CHECK(sim.steps() > (method.tolerance > 0.0 ? 1000 : 1005));  // some end at switches
    if (method.tolerance > 0.0) CHECK(sim.failed_steps() > 5);    // are taken back
  }
}

TEST_CASE("controllers that sample, with delays, ask nothing of the system") {
  const Arm arm = flexarm_test::spatial_arm(2);
  Problem problem(arm);
  const PiecewisePolynomial ramp(Eigen::Vector2d(0.0, 1.0), Eigen::Vector2d(0.3, 0.1));
  PidGains gains{2.0, 1.0, 0.05};
  gains.limit = 0.4;
  std::vector<ComputedTorque::Axis> axes;
  std::vector<TorqueLaw::Place> places;
  for (std::size_t n = 0; n < arm.size(); ++n)
    for (int i = arm.first(n); i < arm.first(n) + arm.link(n).joint().nv(); ++i) {
      axes.push_back({i, ramp, 20.0, 4.0, 0.3});
      places.push_back({arm.coordinate_of(i), i});
    }
  const TorqueLaw torques(std::make_shared<const Arm>(arm), axes, true, places, arm.nv());
  problem.samplers = {{0.0, 1e-3, 2.5e-3, pid(arm, 0, gains, 1e-3, PolynomialValue{ramp})}, {5e-4, 2e-3, 0.0, torques}};
  for (const Method& method : methods({"implicit", "rk4", "gauss"})) {
    CAPTURE(method.tolerance);
    Simulation sim(problem, method, method.name == "rk4" ? 5e-6 : 5e-4);
    Status status = sim.step();
    check_nothing(method.name.c_str(), [&] {
      while (status == Status::ok && sim.t() < 0.02) status = sim.step();
    });
    CHECK(status == Status::ok);
    CHECK(sim.t() >= 0.02);
  }
}

TEST_CASE("gauss collocation of many coordinates asks nothing of the system") {
  std::vector<Link> links;
  for (int n = 0; n < 2; ++n)
    links.emplace_back(Joint::revolute({0, 0, 1}), flexarm_test::body(0.5, {0.075, 0, 0}),
                       flexarm_test::beam({8, 8, 4, 4, 4}, 2), flexarm_test::body(0.2, {0.04, 0, 0.01}));
  Problem problem{Arm(std::move(links))};
  problem.v0 = flexarm_test::wave(problem.arm->nv(), 0.3, 0.2);
  for (const Method& method : methods({"gauss"})) {
    CAPTURE(method.tolerance);
    Simulation sim(problem, method, 1e-4);
    Status status = sim.step();
    check_nothing("gauss", [&] {
      for (int k = 0; k < 20 && status == Status::ok; ++k) status = sim.step();
    });
    CHECK(status == Status::ok);
  }
}

TEST_CASE("steps of closed loops ask nothing of the system") {
  const Eigen::Vector3d z = Eigen::Vector3d::UnitZ();
  Placement right;
  right.position = {0.5, 0.0, 0.0};
  std::vector<Link> links;
  for (const Placement& at : {Placement{}, Placement{}, right, Placement{}})
    links.emplace_back(Joint({{true, z}}, false, {"hinge"}, {}, at), std::nullopt,
                       flexarm_test::beam({2, 0, 0, 0, 0}, 2), std::nullopt);
  Loop pin;
  pin.a.at.link = 1;
  pin.b.at.link = 3;
  const Arm arm(std::move(links), {0.0, -9.81, 0.0}, {-1, 0, -1, 2}, {}, {}, {pin});
  Problem problem(arm);
  const double left = 2.0, in = std::acos(0.5 - std::cos(left)) - left;  // symmetric
  problem.q0[0] = left;
  problem.q0[3] = in;
  problem.q0[6] = 3.14159265358979323846 - left;
  problem.q0[9] = -in;
  for (const Method& method : methods({"implicit", "rk4", "gauss"})) {
    CAPTURE(method.name);
    Simulation sim(problem, method, 1e-5);
    Status status = sim.step();
    check_nothing("loops", [&] {
      for (int k = 0; k < 20 && status == Status::ok; ++k) status = sim.step();
    });
    CHECK(status == Status::ok);
  }
}

TEST_CASE("steps in which events occur, or that one ends, ask nothing of the system") {
  Problem problem(flexarm_test::spatial_arm());
  problem.v0 = flexarm_test::wave(problem.arm->nv(), 0.3, 2.0);
  problem.drives = {{0, {}, [](double t) { return std::sin(20.0 * t); }, Eigen::VectorXd::LinSpaced(40, 0.0, 4e-3)}};
  const auto every = [](double span) {
    return [span](double t, const Eigen::VectorXd&, const Eigen::VectorXd&) { return std::sin(3.14159265 * t / span); };
  };
  problem.events = {{every(1e-3)}, {every(3.1e-3), 1}};
  for (const Method& method : methods({"implicit", "rk4", "gauss"})) {
    Simulation sim(problem, method, method.name == "rk4" ? 1e-6 : 1e-4);
    Status status = Status::ok;
    bool ended = false;
    check_nothing(method.name.c_str(), [&] {
      while (status == Status::ok && sim.t() < 5e-3) {
        status = sim.step();
        ended = ended || sim.terminated();
      }
    });
    CHECK(status == Status::ok);
    CHECK(ended);
    CHECK(sim.events()[0].t.size() >= 4);
  }
}

TEST_CASE("a simulation asks nothing of the system, and goes on from a state to the last bit") {
  Problem problem(flexarm_test::spatial_arm());
  const Arm& arm = *problem.arm;
  problem.v0 = flexarm_test::wave(arm.nv(), 0.3, 0.2);
  problem.drives = {{0, {}, [](double t) { return std::sin(20.0 * t); }}};
  problem.loads = {{Load::at_end(arm, 0, true), [](double t) { return Vec6<double>::Constant(0.1 * t).eval(); }}};
  Feedback law{Eigen::VectorXd::Unit(arm.nv(), 0), Eigen::VectorXd::Unit(arm.nq(), 0), Eigen::VectorXd::Zero(arm.nv())};
  law.limit = 0.05;
  problem.feedback = {law};
  for (const Method& method : methods({"implicit", "rk4", "gauss"})) {
    CAPTURE(method.name);
    CAPTURE(method.tolerance);
    const double h = method.name == "rk4" ? 1e-6 : 1e-4;
    Simulation sim(problem, method, h);
    const Eigen::VectorXd tau[] = {Eigen::VectorXd::Zero(arm.nv()), Eigen::VectorXd::Constant(arm.nv(), 1e-3)};
    Status status = sim.step();
    sim.a();
    const auto run = [&] {
      for (int k = 0; k < 50 && status == Status::ok; ++k) {
        sim.set_force(0, 0.01 * k);
        sim.set_load(0, Vec6<double>::Constant(0.01 * k));
        sim.set_tau(tau[k % 2]);
        status = sim.step();
        sim.a();
      }
    };
    check_nothing(method.name.c_str(), run);
    REQUIRE(status == Status::ok);
    if (method.tolerance == 0.0) CHECK(sim.t() == doctest::Approx(51 * h));
    const Simulation::State kept = sim.state();
    run();
    const Eigen::VectorXd q = sim.q(), v = sim.v();
    Simulation other(problem, method, h);
    for (Simulation* again : {&sim, &other}) {
      again->restore(kept);
      for (int k = 0; k < 50; ++k) {
        again->set_force(0, 0.01 * k);
        again->set_load(0, Vec6<double>::Constant(0.01 * k));
        again->set_tau(tau[k % 2]);
        again->step();
        again->a();
      }
      CHECK(again->q() == q);
      CHECK(again->v() == v);
    }
  }
  CHECK_THROWS_WITH_AS(Simulation(problem, {"euler"}, 1e-4), "method = euler: is not known", std::invalid_argument);
}

TEST_CASE("an arm and what AB, inverse dynamics and steps need take memory in proportion to its links") {
  const auto taken = [](std::size_t links) {
    std::vector<Link> parts;
    for (std::size_t k = 0; k < links; ++k)
      parts.emplace_back(Joint::revolute({0, 0, 1}), flexarm_test::body(0.5, {0.1, 0, 0}), std::nullopt, std::nullopt);
    const Asked asked = watch([&] {
      const Arm arm(std::move(parts));
      Workspace ws(arm);
      ImplicitStep implicit(arm, 1e-3);
      Rk4Step rk4(arm, 1e-3);
      Eigen::VectorXd q = arm.zero(), v = q, tau = q;
      implicit(ws, q, v, tau);
      rk4(ws, q, v, tau);
    });
    return asked.bytes;
  };
  CHECK(taken(800) < 2.1 * static_cast<double>(taken(400)));
}

TEST_CASE("a step of IDA allocates nothing: longer runs allocate no more") {
  const Arm arm = flexarm_test::floating_arm();
  Problem problem(arm);
  const Workspace first(*problem.arm);  // makes what the kernels keep with the arm
  problem.v0 = flexarm_test::wave(arm.nv(), 0.3, 0.5);
  problem.events = {{[](double, const Eigen::VectorXd&, const Eigen::VectorXd&) { return 1.0; }}};
  for (LinearSolver solver : {LinearSolver::dense, LinearSolver::chain}) {
    IdaOptions options;
    options.linear_solver = solver;
    long steps = 0;
    const auto run = [&](double end) {
      const Eigen::VectorXd t = Eigen::VectorXd::LinSpaced(3, 0.0, end);
      const Asked asked = watch([&] {
        const Trajectory r = simulate_ida(problem, t, options);
        steps = r.stats.steps;
        CHECK(r.failure.empty());
      });
      return asked.allocations;
    };
    const long few = run(1e-3), few_steps = steps, many = run(4e-3);
    CHECK(steps > 2 * few_steps);
    CHECK(many == few);
  }
}

#else

TEST_CASE("SKIPPED: the hot path asks nothing of the system") {
  MESSAGE("SKIPPED, not passed: malloc cannot be replaced in this build (a sanitizer, or no glibc)");
}

#endif

}  // namespace test_allocation
