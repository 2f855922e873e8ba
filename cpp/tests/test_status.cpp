// What is not finite is said so, of every input and by whatever path.
#include <doctest/doctest.h>

#include <limits>

#include "arms.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/collocation.hpp"
#include "flexarm/step.hpp"

namespace test_status {
using namespace flexarm;

namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();

/// One rigid link on a hinge: its rate, and without gravity its angle, do not even enter its equation.
Arm hinge() {
  return Arm({Link(Joint::revolute({0, 0, 1}), flexarm_test::body(1.0, {0.1, 0, 0}), std::nullopt, std::nullopt)});
}
Arm planar() {
  std::vector<Link> links;
  for (int k = 0; k < 2; ++k)
    links.emplace_back(Joint::revolute({0, 0, 1}), flexarm_test::body(0.5, {0.1, 0, 0}),
                       flexarm_test::beam({2, 0, 0, 0, 0}, 2), std::nullopt);
  return Arm(std::move(links), {0, -9.81, 0});
}
std::vector<Arm> arms() {
  return {hinge(),
          planar(),
          flexarm_test::spatial_arm(),
          flexarm_test::spatial_arm(0),
          flexarm_test::spatial_arm(3),
          flexarm_test::floating_arm()};
}

struct State {
  Eigen::VectorXd q, v, tau;
};

using Evaluate = Status (*)(const Arm&, Workspace&, State&);
const std::vector<std::pair<const char*, Evaluate>> all{
    {"forward_dynamics",
     [](const Arm& arm, Workspace& ws, State& s) { return forward_dynamics(arm, ws, s.q, s.v, s.tau); }},
    {"ab", [](const Arm& arm, Workspace& ws, State& s) { return forward_dynamics_ab(arm, ws, s.q, s.v, s.tau); }},
    {"ci", [](const Arm& arm, Workspace& ws, State& s) { return forward_dynamics_ci(arm, ws, s.q, s.v, s.tau); }},
    {"ImplicitStep",
     [](const Arm& arm, Workspace& ws, State& s) { return ImplicitStep(arm, 1e-5)(ws, s.q, s.v, s.tau); }},
    {"Rk4Step", [](const Arm& arm, Workspace& ws, State& s) { return Rk4Step(arm, 1e-8)(ws, s.q, s.v, s.tau); }},
    {"start",
     [](const Arm& arm, Workspace& ws, State& s) { return ImplicitStep(arm, 1e-5).start(ws, s.q, s.v, s.tau); }},
    {"CollocationStep", [](const Arm& arm, Workspace& ws, State& s) {
       CollocationStep step(arm);
       const Status status = step.start(ws, s.q, s.v, s.tau);
       return status == Status::ok ? step.advance(1e-6, ws, s.q, s.v, s.tau, {}) : status;
     }}};

/// Every entry of q, v and tau in turn.
template <class Visit>
void spoil(const Arm& arm, const std::vector<double>& values, const Visit& visit) {
  const State good{arm.zero() + flexarm_test::wave(arm.nq(), 0.3, 1e-3), flexarm_test::wave(arm.nv(), 0.7, 1e-3),
                   flexarm_test::wave(arm.nv(), 0.1, 1e-3)};
  for (double bad : values)
    for (Eigen::VectorXd State::* part : {&State::q, &State::v, &State::tau})
      for (Eigen::Index i = 0; i < (good.*part).size(); ++i) {
        State s = good;
        (s.*part)[i] = bad;
        CAPTURE(bad);
        CAPTURE(i);
        CAPTURE((part == &State::q ? "q" : part == &State::v ? "v" : "tau"));
        visit(s, s.*part, i);
      }
}

}  // namespace

TEST_CASE("a number of q, v or tau that is not finite is no success, and no singular matrix") {
  for (const Arm& arm : arms()) {
    CAPTURE(arm.nv());
    Workspace ws(arm), loaded(arm, {}, {Load::at_end(arm, 0, true)});
    Feedback law{Eigen::VectorXd::Unit(arm.nv(), 0), Eigen::VectorXd::Zero(arm.nq()), Eigen::VectorXd::Zero(arm.nv())};
    law.by_v[0] = 0.1;
    law.limit = 1.0;
    const std::vector<Feedback> laws{law};
    Workspace ruled(arm);
    ruled.feed_back(laws);
    for (const auto& [name, evaluate] : all) {
      CAPTURE(name);
      for (Workspace* w : {&ws, &loaded, &ruled}) {
        spoil(arm, {std::nan(""), kInf, -kInf}, [&, &f = evaluate](State& s, Eigen::VectorXd& part, Eigen::Index) {
          const State before = s;
          CHECK(f(arm, *w, s) == Status::not_finite);
          for (Eigen::Index k = 0; k < part.size(); ++k)  // and nothing was made of it
            CHECK((&part == &s.tau || &part == &s.q || std::isnan(before.v[k]) || s.v[k] == before.v[k]));
        });
        State fine{arm.zero(), Eigen::VectorXd::Zero(arm.nv()), Eigen::VectorXd::Zero(arm.nv())};
        CHECK(evaluate(arm, *w, fine) == Status::ok);  // and nothing of it is left in the workspace
      }
    }
  }
}

TEST_CASE("a result that overflows is not finite, not singular") {
  for (const Arm& arm : arms()) {
    CAPTURE(arm.nv());
    const bool cut = arm.size() > 1 && arm.link(1).beam()->options().order == 0;  // whose mass matrix may well be
    Workspace ws(arm);
    for (int method : {0, 1, 2}) {
      CAPTURE(all[static_cast<std::size_t>(method)].first);
      spoil(arm, {1e160, -1e200, 1e307}, [&](State& s, Eigen::VectorXd&, Eigen::Index) {
        const Status status = all[static_cast<std::size_t>(method)].second(arm, ws, s);
        if (status == Status::ok)
          CHECK(ws.a.allFinite());
        else
          CHECK((status == Status::not_finite || (cut && status == Status::singular)));
      });
    }
  }
}

TEST_CASE("what is prescribed: its force may be anything, its motion may not") {
  const Arm arm = planar();
  std::vector<bool> given(static_cast<std::size_t>(arm.nv()), false);
  given[0] = true;
  for (int method : {0, 1, 2, 3, 4}) {
    CAPTURE(all[static_cast<std::size_t>(method)].first);
    const auto evaluate = all[static_cast<std::size_t>(method)].second;
    Workspace ws(arm, given);
    State s{arm.zero(), Eigen::VectorXd::Zero(arm.nv()), Eigen::VectorXd::Zero(arm.nv())};
    s.tau[0] = std::nan("");
    CHECK(evaluate(arm, ws, s) == Status::ok);
    s = {arm.zero(), Eigen::VectorXd::Zero(arm.nv()), Eigen::VectorXd::Zero(arm.nv())};
    ws.a[0] = kInf;
    CHECK(evaluate(arm, ws, s) == Status::not_finite);
  }
}

TEST_CASE("a step that has begun says of what comes later that it is not finite") {
  for (const Arm& arm : arms())
    spoil(arm, {std::nan(""), kInf}, [&](State& s, Eigen::VectorXd&, Eigen::Index) {
      Workspace ws(arm);
      ImplicitStep step(arm, 1e-5);
      State fine{arm.zero(), Eigen::VectorXd::Zero(arm.nv()), Eigen::VectorXd::Zero(arm.nv())};
      REQUIRE(step(ws, fine.q, fine.v, fine.tau) == Status::ok);
      CHECK(step(ws, s.q, s.v, s.tau) == Status::not_finite);
    });
}

TEST_CASE("a factorisation of what is not finite is not one") {
  const Arm arm = flexarm_test::spatial_arm(3);
  Workspace ws(arm);
  const Eigen::VectorXd v = flexarm_test::wave(arm.nv(), 0.7);
  for (double bad : {std::nan(""), kInf, 1e200}) {
    Eigen::VectorXd q = flexarm_test::wave(arm.nq(), 0.3);
    q[2] = bad;
    move_arm(arm, ws, q, v);
    CHECK(factor_shifted(arm, ws, q, v, {1e-3, 1e-5}) == Status::not_finite);
  }
}

TEST_CASE("an implicit step whose first factorisation fails under continuous control says so") {
  // at order 0 the cut kinetic energy is not positive this far out
  BeamOptions o;
  o.modes = {1, 0, 0, 0, 0};
  o.order = 0;
  RigidBody hub;
  hub.end = {0.0, 0.5, 0.0};
  const Arm arm({Link(Joint::revolute({0, 0, 1}), hub,
                      Beam(0.5, Section::rectangle(0.01, 0.02), flexarm_test::steel(), o), std::nullopt)});
  for (double far : {0.38, 3.0, -3.0, 30.0, -30.0}) {
    Feedback law{Eigen::VectorXd::Unit(2, 0), Eigen::VectorXd::Unit(2, 0), Eigen::VectorXd::Unit(2, 0)};
    const std::vector<Feedback> laws{law};
    Workspace ws(arm);
    ws.feed_back(laws);
    ImplicitStep step(arm, 0.4);
    Eigen::VectorXd q(2), v = Eigen::VectorXd::Zero(2);
    q << 0.0, far;
    const Eigen::VectorXd q0 = q, tau = v;
    const Status status = step(ws, q, v, tau);
    if (status == Status::ok)
      CHECK(q.allFinite());
    else
      CHECK(q == q0);
  }
}

TEST_CASE("lists of other lengths than the arm's are refused, by name") {
  const Arm arm = planar();
  CHECK_THROWS_WITH_AS(Workspace(arm, {true}), doctest::Contains("prescribed = 1 entries: must be one for each of"),
                       std::invalid_argument);
  Workspace ws(arm);
  const std::vector<Feedback> laws{
      {Eigen::VectorXd::Unit(2, 0), Eigen::VectorXd::Zero(arm.nq()), Eigen::VectorXd::Zero(arm.nv())}};
  CHECK_THROWS_WITH_AS(ws.feed_back(laws), doctest::Contains("their lengths must be nv, nq, nv: 6, 6, 6"),
                       std::invalid_argument);
}

TEST_CASE("stiction that is not given is as much as the sliding friction") {
  JointForce rough;
  rough.coulomb = 0.5;
  const Joint joint({{true, Eigen::Vector3d::UnitZ()}}, false, {"hinge"}, {rough});
  CHECK(joint.forces()[0].stiction == 0.5);
  CHECK(Joint({{true, Eigen::Vector3d::UnitZ()}}, false, {"hinge"}, {JointForce{}}).forces()[0].stiction == 0.0);
  rough.stiction = 0.4;
  CHECK_THROWS_WITH_AS(Joint({{true, Eigen::Vector3d::UnitZ()}}, false, {"hinge"}, {rough}),
                       "stiction[0] = 0.4: must be finite, and at least coulomb", std::invalid_argument);
}

}  // namespace test_status
