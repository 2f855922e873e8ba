// Laws that know the arm's dynamics, and linear ones.
#include <doctest/doctest.h>

#include <Eigen/LU>
#include <cmath>
#include <complex>
#include <string>

#include "arms.hpp"
#include "flexarm/ab.hpp"
#include "flexarm/computed_torque.hpp"
#include "flexarm/laws.hpp"
#include "flexarm/problem.hpp"
#include "watch.hpp"

namespace test_laws {
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

/// A sampled law of one y as its transfer function says it: D + C (z - A)^-1 B.
std::complex<double> answer(const LinearLaw& law, std::complex<double> z) {
  const Eigen::MatrixXcd left = z * Eigen::MatrixXcd::Identity(law.A.rows(), law.A.cols()) - law.A;
  return (law.D + law.C * left.partialPivLu().solve(law.B.cast<std::complex<double>>()))(0, 0);
}

/// A flywheel of 1 kg m2 on a joint, without gravity.
Arm flywheel() {
  std::vector<Link> links;
  links.emplace_back(Joint::revolute({0, 0, 1}), RigidBody{1.0, {0, 0, 0}, Eigen::Vector3d(1, 1, 1).asDiagonal()},
                     std::nullopt, std::nullopt);
  return Arm(std::move(links));
}

template <class F>
std::string said(F f) {
  try {
    f();
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "";
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
  law.limit = law.reach = Eigen::VectorXd::Constant(1, 1.0);
  law.reference = [](double, Eigen::VectorXd& r) { r.setConstant(1, 2.0); };
  law.u0 = Eigen::VectorXd::Constant(1, 0.25);
  law.windup = Eigen::MatrixXd::Constant(1, 1, 0.5);
  law.x = Eigen::VectorXd::Zero(1);
  const Eigen::VectorXd none = Eigen::VectorXd::Zero(1);
  double x = 0.0;
  for (int k = 0; k < 5; ++k) {
    const double w = 0.25 + x + 2.0;
    CHECK(law.sample(0.0, none, none, none)[0] == std::min(w, 1.0));
    x += 2.0 + 0.5 * (std::min(w, 1.0) - w);
    CHECK(law.x[0] == doctest::Approx(x));
  }
}

TEST_CASE("PID: the trapezoidal recursion by hand, led back at its limit") {
  const Arm arm = flywheel();
  const double h = 0.01, kp = 3.0, ki = 20.0, kd = 0.4, tf = 0.05, tt = 0.1, most = 2.0;
  const auto r = [](double t) { return std::cos(t); };
  LinearLaw law = pid(arm, 0, {kp, ki, kd, tf, tt}, h, r);
  double integral = 0.0, slope = 0.0, e_before = 0.0;
  Eigen::VectorXd q(1), v = Eigen::VectorXd::Zero(1);
  for (int k = 0; k < 40; ++k) {
    q[0] = 0.2 * std::sin(0.3 * k);
    const double e = r(h * k) - q[0];
    integral += 0.5 * h * ki * (e + e_before);
    slope = ((2.0 * tf - h) * slope + 2.0 * kd * (e - e_before)) / (2.0 * tf + h);
    CHECK(law.sample(h * k, q, v, v)[0] == doctest::Approx(kp * e + integral + slope).epsilon(1e-12));
    e_before = e;
  }
  // e = 1 for ever: held at its limit, w settles where ki e = (w - limit) / tt, that is at limit + ki tt
  law = pid(arm, 0, {kp, ki, kd, tf, tt, most}, h, [](double) { return 1.0; });
  q[0] = 0.0;
  for (int k = 0; k < 1000; ++k) CHECK(law.sample(h * k, q, v, v)[0] == most);
  CHECK((law.C * law.x + law.D)(0, 0) == doctest::Approx(most + ki * tt).epsilon(1e-9));
}

TEST_CASE("a drive: steps of its encoder, filtered differences, an integral that is led back, by hand") {
  const Arm arm = flywheel();
  const double h = 0.001, kp = 30.0, kv = 0.8, ki = 20.0, step = 1e-3, cut = 40.0, most = 4.0;
  const auto r = [](double t) { return 0.3 * std::sin(5.0 * t); };
  const auto rate = [](double t) { return 1.5 * std::cos(5.0 * t); };
  ServoGains gains{kp, kv, ki, step, cut};
  gains.limit = most;
  LinearLaw law = servo(arm, 0, gains, h, {r, rate, [](double) { return 0.25; }}, 2.0);
  const double fresh = 1.0 - std::exp(-2.0 * std::acos(-1.0) * cut * h), back = h / std::sqrt(kv / ki);
  double integral = 0.0, v_seen = 0.0, before = 0.0;
  int held = 0;
  Eigen::VectorXd q(1);
  const Eigen::VectorXd v = Eigen::VectorXd::Zero(1);
  for (int k = 0; k < 400; ++k) {
    const double t = 2.0 + h * k;
    q[0] = 0.1 + 0.25 * std::sin(5.0 * t - 0.2);
    const double y = std::floor(q[0] / step + 0.5) * step;
    if (k == 0) before = y;
    v_seen += fresh * ((y - before) / h - v_seen);
    before = y;
    integral += ki * h * (r(t) - y);
    const double w = kp * (r(t) - y) + integral + kv * (rate(t) - v_seen) + 0.25, u = std::clamp(w, -most, most);
    CHECK(law.sample(t, q, v, v)[0] == doctest::Approx(u).epsilon(1e-11));
    integral += back * (u - w);
    held += u != w;
  }
  CHECK(held > 50);
  CHECK(held < 350);
  // a filter of the second order takes a constant rate as it is, in the end
  gains.damping_ratio = 0.7;
  law = servo(arm, 0, {0.0, 1.0, 0.0, 0.0, cut, 0.7}, h);
  for (int k = 0; k < 200; ++k) {
    q[0] = -3.0 * h * k;
    law.sample(h * k, q, v, v);
  }
  CHECK(law.u[0] == doctest::Approx(3.0));
  CHECK_THROWS_AS(servo_law({1.0, 1.0, 1.0, 0.0, {}, {}, 0.5 * h}, h), std::invalid_argument);
  CHECK_THROWS_AS(servo(arm, 0, {1.0, 1.0, 0.0, -1.0}, h), std::invalid_argument);
}

TEST_CASE("the slopes of a drive are those of its samples, at the first one, too") {
  const Arm arm = flywheel();
  const double h = 0.01, d = 1e-6;
  const LinearLaw made = servo(arm, 0, {3.0, 0.2, 5.0, 0.0, 20.0}, h);
  const Eigen::VectorXd v = Eigen::VectorXd::Zero(1);
  const auto run = [&](double q0) {
    LinearLaw law = made;
    Eigen::VectorXd out(3), q(1);
    for (int k = 0; k < 3; ++k) {
      q[0] = k == 0 ? q0 : 0.4 * k;
      out[k] = law.sample(h * k, q, v, v)[0];
    }
    return out;
  };
  const Eigen::VectorXd right = (run(0.2 + d) - run(0.2 - d)) / (2.0 * d);
  LinearLaw law = made;
  Eigen::MatrixXd dx = Eigen::MatrixXd::Zero(law.x.size(), 1), du;
  Eigen::VectorXd q(1);
  for (int k = 0; k < 3; ++k) {
    q[0] = k == 0 ? 0.2 : 0.4 * k;
    law.sample(h * k, q, v, v);
    law.slopes(dx, (k == 0 ? -1.0 : 0.0) * law.by_q, du);
    CHECK(du(0, 0) == doctest::Approx(right[k]).epsilon(1e-7));
  }
}

TEST_CASE("a filter of positive position feedback peaks where it is meant to, sampled slowly, too") {
  const Arm arm = flexarm_test::spatial_arm(2);
  const FeedbackPath path{Eigen::VectorXd::Unit(arm.nq(), 1), 2.0 * Eigen::VectorXd::Unit(arm.nv(), 1)};
  const double w = 50.0, zeta = 0.3, gain = 4.0, h = 0.02;  // 3.1 samples a period
  LinearLaw law = positive_position(arm, path, {w, zeta, gain, 0.5, 3.0}, h);
  const std::complex<double> at_w = answer(law, std::polar(1.0, w * h));  // by e = -y: gain / (2 zeta i), turned
  CHECK(std::abs(at_w + gain / std::complex<double>(0.0, 2.0 * zeta)) <= 1e-12 * std::abs(at_w));
  CHECK(std::abs(answer(law, 1.0) + gain) <= 1e-12);
  Eigen::VectorXd q = Eigen::VectorXd::Zero(arm.nq()), f;
  const Eigen::VectorXd v = Eigen::VectorXd::Zero(arm.nv());
  q[1] = 0.9;
  for (int k = 0; k < 400; ++k) law(h * k, q, v, v, f);
  CHECK(f[1] == doctest::Approx(2.0 * gain * (0.9 - 0.5)));  // gain (y - reference), by the column
  CHECK(f.norm() == doctest::Approx(std::abs(f[1])));
}

TEST_CASE("integral resonant control: its pole by Tustin's rule, its static gain, its limit") {
  const Arm arm = flywheel();
  const double k = -30.0, d = -0.2, h = 0.05;
  const FeedbackPath path{Eigen::VectorXd::Ones(1), Eigen::VectorXd::Ones(1)};
  LinearLaw law = integral_resonant(arm, path, {k, d, 0.25}, h);
  CHECK(law.A(0, 0) == doctest::Approx((1.0 - 0.5 * h * k * d) / (1.0 + 0.5 * h * k * d)).epsilon(1e-14));
  const Eigen::VectorXd q = Eigen::VectorXd::Ones(1), v = Eigen::VectorXd::Zero(1);
  double u = 0.0;
  for (int n = 0; n < 300; ++n) u = law.sample(h * n, q, v, v)[0];
  CHECK(u == doctest::Approx((1.0 - 0.25) / d));
  law = integral_resonant(arm, path, {k, d, 0.25, 1.5}, h);
  for (int n = 0; n < 300; ++n) u = law.sample(h * n, q, v, v)[0];
  CHECK(u == -1.5);
}

TEST_CASE("zero-order hold: an oscillator and what a limit does to it, in closed form") {
  const double w = 3.0, h = 0.4, c = std::cos(w * h), s = std::sin(w * h);
  StateSpace of;
  of.A = (Eigen::Matrix2d() << 0.0, 1.0, -w * w, 0.0).finished();
  of.B = Eigen::Vector2d(0.0, 1.0);
  of.C = Eigen::RowVector2d(1.0, 0.0);
  of.D = Eigen::MatrixXd::Constant(1, 1, 0.7);
  of.windup = 2.0 * of.B;
  const StateSpace by = sampled_law(of, h, Discretisation::zero_order_hold);
  CHECK((by.A - (Eigen::Matrix2d() << c, s / w, -w * s, c).finished()).norm() <= 1e-14);
  CHECK((by.B - Eigen::Vector2d((1.0 - c) / (w * w), s / w)).norm() <= 1e-15);
  CHECK((by.windup - 2.0 * by.B).norm() <= 1e-15);
  CHECK(by.C == of.C);
  CHECK(by.D == of.D);
  of.A(0, 1) = of.A(1, 0) = 0.0;
  of.A(0, 0) = 2.0 / h;
  CHECK(said([&] { sampled_law(of, h); }).find("period = 0.4: a pole") == 0);
}

TEST_CASE("PD closes the loop that was meant: a flywheel's decay in closed form") {
  const Arm arm = flywheel();
  const auto one = [](double) { return 1.0; };
  const double kp = 25.0, kd = 6.0, w = 4.0;  // poles -3 +- 4 i
  const Feedback law = pd(arm, 0, kp, kd, one);
  double q = 0.0, v = 0.0;
  const int n = 2000;  // Runge-Kutta's midpoint rule
  for (int k = 0; k < n; ++k) {
    const double h = 1.0 / n;
    const auto u = [&](double x, double y) {
      return law(law.reference(0.0), Eigen::VectorXd::Constant(1, x), Eigen::VectorXd::Constant(1, y)) * law.column[0];
    };
    const double qm = q + 0.5 * h * v, vm = v + 0.5 * h * u(q, v);
    q += h * vm;
    v += h * u(qm, vm);
  }
  CHECK(q == doctest::Approx(1.0 - std::exp(-3.0) * (std::cos(w) + 0.75 * std::sin(w))).epsilon(1e-6));
}

TEST_CASE("linear laws say what does not fit") {
  const Arm arm = flywheel();
  const FeedbackPath path{Eigen::VectorXd::Ones(1), Eigen::VectorXd::Ones(1)};
  const double nan = std::nan("");
  const auto begins = [](const std::string& text, const char* with) { return text.rfind(with, 0) == 0; };
  CHECK(begins(said([&] { pd(arm, 1, 1, 1); }), "rate = 1: must be 0 to 0"));
  CHECK(begins(said([&] { pd(arm, 0, nan, 1); }), "kp = nan"));
  CHECK(begins(said([&] { pd(arm, 0, 1, 1, {}, 0.0); }), "limit = 0"));
  CHECK(begins(said([&] { pid(arm, 0, {1, 1, nan}, 0.1); }), "kd = nan"));
  CHECK(begins(said([&] { pid(arm, 0, {1, 1, 1}, 0.0); }), "period = 0: must be positive"));
  CHECK(begins(said([&] { pid(arm, 0, {1, 1, 1, -1.0}, 0.1); }), "filter_time = -1"));
  CHECK(begins(said([&] { pid(arm, 0, {1, 1, 1, 1.0, 0.01}, 0.1); }), "tracking_time = 0.01: must be at least"));
  CHECK(begins(said([&] { pid(arm, 0, {1, 0, 1, 1.0, 1.0}, 0.1); }), "tracking_time: there is no integral"));
  CHECK(begins(said([&] { continuous_law(PidGains{1, 1, 1}); }), "filter_time"));
  CHECK(
      begins(said([&] { positive_position(arm, path, {50.0, 0.3, 1.0}, 0.1); }), "period = 0.1: must be below 0.0628"));
  CHECK(begins(said([&] { positive_position(arm, {{}, path.column}, {50.0, 0.3, 1.0}, 0.01); }), "by_q = 0"));
  CHECK(begins(said([&] { positive_position(arm, {path.by_q, {}}, {50.0, 0.3, 1.0}, 0.01); }), "column = 0"));
  CHECK(begins(said([&] { integral_resonant(arm, path, {1.0, -2.0}, 0.01); }), "gain = 1, feedthrough = -2: must"));
  CHECK(begins(said([&] { integral_resonant(arm, path, {1.0, 2.0, nan}, 0.01); }), "reference = nan"));
  CHECK(begins(said([&] { pd(flexarm_test::floating_arm(), 3, 1, 1); }), "rate = 3: is a ball's"));
  CHECK(said([&] { pd(flexarm_test::floating_arm(), 2, 1, 1); }).empty());
  Problem problem(arm);
  LinearLaw law = pid(arm, 0, {1, 1, 1}, 0.1);
  const auto checked = [&] {
    problem.samplers = {{0.0, 0.1, 0.0, law}};
    return said([&] { problem.check(); });
  };
  CHECK(checked().empty());
  law.columns.resize(2, 1);
  CHECK(begins(checked(), "size of a law's columns = 2 x 1: must be 1 x 1"));
  law.C.resize(0, law.A.rows());  // without outputs
  CHECK(begins(checked(), "size of a law's D = 1 x "));
}

}  // namespace test_laws
