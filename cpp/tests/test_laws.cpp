// Laws that know the arm's dynamics.
#include <doctest/doctest.h>

#include <cmath>

#include "arms.hpp"
#include "flexarm/ab.hpp"
#include "flexarm/computed_torque.hpp"
#include "watch.hpp"

using namespace flexarm;

namespace {

/// Axes of all joints' freedoms, on their way at a constant rate.
std::vector<ComputedTorque::Axis> axes_of(const Arm& arm, double kp = 0.0, double kv = 0.0) {
  std::vector<ComputedTorque::Axis> out;
  for (std::size_t n = 0; n < arm.size(); ++n)
    for (int j = 0; j < arm.link(n).joint().nv(); ++j) {
      const double place = 0.3 + 0.1 * static_cast<double>(out.size());
      out.push_back({arm.first(n) + j, [place](double t) { return MotionValue{place + t, 1.0, 0.0}; }, kp, kv});
    }
  return out;
}

}  // namespace

TEST_CASE("computed torque: feed-forward is inverse dynamics where the beams are in static balance") {
  const Arm arm = flexarm_test::spatial_arm(2);
  ComputedTorque law(arm, axes_of(arm));
  REQUIRE(law.feed_forward(0.2) == Status::ok);
  Workspace ws(arm);
  const Eigen::VectorXd none = Eigen::VectorXd::Zero(arm.nv());
  inverse_dynamics(arm, ws, law.q(), none, none);
  Eigen::VectorXd v = none;
  double left = 0.0, held = 0.0;
  std::vector<bool> joint(static_cast<std::size_t>(arm.nv()), false);
  for (const auto& x : axes_of(arm)) {
    joint[static_cast<std::size_t>(x.rate)] = true;
    v[x.rate] = 1.0;
    CHECK(law.q()[arm.coordinate_of(x.rate)] == x.reference(0.2).q);
  }
  for (int i = 0; i < arm.nv(); ++i) {
    double& larger = joint[static_cast<std::size_t>(i)] ? held : left;
    larger = std::max(larger, std::abs(ws.tau[i]));
  }
  CHECK(left <= 1e-8 * held);
  inverse_dynamics(arm, ws, law.q(), v, none);
  for (int i = 0; i < arm.nv(); ++i)
    CHECK(law.tau[i] == doctest::Approx(joint[static_cast<std::size_t>(i)] ? ws.tau[i] : 0.0));
  ComputedTorque straight(arm, axes_of(arm), false);
  REQUIRE(straight.feed_forward(0.2) == Status::ok);
  CHECK((straight.tau - law.tau).norm() > 1e-6 * law.tau.norm());
}

TEST_CASE("computed torque: limits, what does not fit, what is not finite") {
  const Arm arm = flexarm_test::spatial_arm(2);
  auto axes = axes_of(arm, 1e4, 10.0);
  for (auto& x : axes) x.limit = 0.5;
  ComputedTorque law(arm, axes);
  Eigen::VectorXd q = arm.zero(), v = Eigen::VectorXd::Zero(arm.nv());
  REQUIRE(law(0.0, q, v) == Status::ok);
  CHECK(law.tau.cwiseAbs().maxCoeff() == 0.5);
  const Eigen::VectorXd before = law.tau;
  q[0] = std::nan("");
  CHECK(law(0.0, q, v) == Status::not_finite);
  q[0] = 0.0;
  REQUIRE(law(0.0, q, v) == Status::ok);  // as if nothing had been
  CHECK((law.tau - before).norm() <= 1e-9);
  axes.pop_back();
  CHECK_THROWS_AS(ComputedTorque(arm, axes), std::invalid_argument);
  axes.push_back(axes.front());
  CHECK_THROWS_AS(ComputedTorque(arm, axes), std::invalid_argument);
  CHECK_THROWS_AS(ComputedTorque(flexarm_test::floating_arm(), axes_of(flexarm_test::floating_arm())),
                  std::invalid_argument);
}

#ifdef FLEXARM_WATCHES
TEST_CASE("computed torque asks nothing of the system") {
  const Arm arm = flexarm_test::spatial_arm(2);
  ComputedTorque law(arm, axes_of(arm, 10.0, 1.0));
  const Eigen::VectorXd q = flexarm_test::wave(arm.nq(), 0.1, 0.3), v = flexarm_test::wave(arm.nv(), 0.3, 0.2);
  bool good = true;
  const auto asked = flexarm_test::watch([&] {
    for (int k = 0; k < 5; ++k) good = good && law(0.1 * k, q, v) == Status::ok;
    good = good && law.feed_forward(1.0) == Status::ok;
  });
  CHECK(good);
  CHECK(asked.allocations == 0);
  CHECK(asked.locks == 0);
  CHECK(asked.throws == 0);
}
#endif

TEST_CASE("a sampled linear law at its limit leads its states back") {
  LinearLaw law;
  law.A = law.B = law.C = law.D = law.columns = law.by_q = Eigen::MatrixXd::Ones(1, 1);
  law.by_v = Eigen::MatrixXd::Zero(1, 1);
  law.limit = 1.0;
  law.reference = [](double) { return Eigen::VectorXd::Constant(1, 2.0); };
  law.u0 = Eigen::VectorXd::Constant(1, 0.25);
  law.windup = Eigen::MatrixXd::Constant(1, 1, 0.5);
  law.x = Eigen::VectorXd::Zero(1);
  const Eigen::VectorXd none = Eigen::VectorXd::Zero(1);
  double x = 0.0;
  for (int k = 0; k < 5; ++k) {
    const double w = 0.25 + x + 2.0;
    CHECK(law(0.0, none, none, none)[0] == std::min(w, 1.0));
    x += 2.0 + 0.5 * (std::min(w, 1.0) - w);
    CHECK(law.x[0] == doctest::Approx(x));
  }
}
