// The Kalman filter: its model against an arm with other parts and against fine steps, its tangent against differences,
// its algebra against covariances in full, and what it asks of the system.
#include <doctest/doctest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>

#include "arms.hpp"
#include "flexarm/kalman.hpp"
#include "flexarm/step.hpp"
#include "watch.hpp"

namespace test_kalman {
using namespace flexarm;
using Eigen::MatrixXd, Eigen::VectorXd;
using flexarm_test::wave;

namespace {

constexpr double kStep = 1e-3;

/// Without the products of errors, which a payload that is uncertain has.
std::vector<KalmanParameter> certain_payload(std::vector<KalmanParameter> p) {
  p[0].deviation = 0.0;
  return p;
}

/// Two links in space, of which the last carries a point mass, and whose joints are damped.
Arm two_links(double payload, double damping = 0.0) {
  JointForce damper;
  damper.damping = damping;
  RigidBody tip = flexarm_test::body(0.1, {0.02, 0.0, 0.01});
  const Eigen::Vector3d com = (tip.mass * tip.com + payload * tip.end) / (tip.mass + payload);
  const auto about = [](double m, const Eigen::Vector3d& r) {
    return Eigen::Matrix3d(m * (r.squaredNorm() * Eigen::Matrix3d::Identity() - r * r.transpose()));
  };
  tip.inertia += about(tip.mass, tip.com - com) + about(payload, tip.end - com);
  tip.com = com;
  tip.mass += payload;
  std::vector<Link> links;
  links.emplace_back(Joint({{true, {0, 0.6, 0.8}}}, false, {"r"}, {damper}), flexarm_test::body(0.5, {0.075, 0, 0}),
                     flexarm_test::beam({2, 1, 1, 0, 0}, 2, 0.02), flexarm_test::body(0.2, {0.04, 0, 0.01}));
  links.emplace_back(Joint::revolute({0, 1, 0}), std::nullopt, flexarm_test::beam({2, 1, 0, 0, 0}, 2, 0.02), tip);
  return Arm(std::move(links), {0, 0, -9.81});
}

std::vector<KalmanSensor> sensors(const Arm& arm) {
  std::vector<KalmanSensor> s{KalmanSensor::encoder(arm, 0, 1e-3), KalmanSensor::tachometer(arm, arm.first(1), 1e-2),
                              KalmanSensor::gauge(arm, 0, 0.01, 0.002, 0.0, 1e-6),
                              KalmanSensor::camera(arm, 1, {}, {0, 0, 1}, 1e-3),
                              KalmanSensor::gauge(arm, 1, 0.02, 0.002, 0.001, 1e-6)};
  s.back().F = (Eigen::Matrix2d() << 0.99, 9e-4, -0.15, 0.95).finished();
  s.back().before = Eigen::Vector2d(0.004, 0.07);
  s.back().after = Eigen::Vector2d(0.006, 0.08);
  return s;
}

std::vector<KalmanParameter> parameters(const Arm& arm, double payload, double damping, double coulomb) {
  const int joint = arm.first(1);
  return {{KalmanParameter::payload, 0, payload, 0.5},
          {KalmanParameter::damping, 0, damping, 0.1, 0.01},
          {KalmanParameter::coulomb, joint, coulomb, 0.1},
          {KalmanParameter::offset, joint, 0.02, 0.1},
          {KalmanParameter::gain, 0, 0.1, 0.1}};
}

struct Start {
  VectorXd q, v, tau, q_deviation, v_deviation;
  explicit Start(const Arm& arm)
      : q(wave(arm.nv(), 0.3)),
        v(wave(arm.nv(), 0.9, 0.5)),
        tau(wave(arm.nv(), 0.5, 2.0)),
        q_deviation(VectorXd::Constant(arm.nv(), 0.01)),
        v_deviation(VectorXd::Constant(arm.nv(), 0.1)) {}
};

VectorXd state(const KalmanFilter& f) {
  VectorXd x(f.q().size() + f.v().size() + f.parameters().size());
  x << f.q(), f.v(), f.parameters();
  return x;
}

}  // namespace

TEST_CASE("the model is the arm that has these parameters") {
  const Arm bare = two_links(0.0), loaded = two_links(0.3, 0.05);
  const Start at(bare);
  auto p = certain_payload(parameters(bare, 0.3, 0.05, 0.0));
  p.resize(3);
  KalmanFilter filter(Problem(bare), kStep, sensors(bare), p, VectorXd::Zero(bare.nv()));
  KalmanFilter other(Problem(loaded), kStep, sensors(loaded), {}, VectorXd::Zero(bare.nv()));
  for (KalmanFilter* f : {&filter, &other}) {
    f->start(at.q, at.v, at.q_deviation, at.v_deviation);
    for (int k = 0; k < 20; ++k) REQUIRE(f->predict(at.tau) == Status::ok);
  }
  CHECK((filter.q() - at.q).norm() > 0.01);
  CHECK((filter.q() - other.q()).norm() < 1e-9 * other.q().norm());
  CHECK((filter.v() - other.v()).norm() < 1e-8 * other.v().norm());
}

TEST_CASE("predictions are of fourth order") {
  const Arm arm = two_links(0.0);
  const Start at(arm);
  Workspace ws(arm);
  VectorXd q = at.q, v = at.v;
  OneStep fine("rk4", arm, 1e-6);
  for (int k = 0; k < 2000; ++k) REQUIRE(fine(ws, q, v, at.tau) == Status::ok);
  double before = 0.0;
  for (const int steps : {5, 10, 20}) {
    KalmanFilter filter(Problem(arm), 2e-3 / steps, sensors(arm), {}, VectorXd::Zero(arm.nv()));
    filter.start(at.q, at.v, at.q_deviation, at.v_deviation);
    for (int k = 0; k < steps; ++k) REQUIRE(filter.predict(at.tau) == Status::ok);
    const double error = (filter.q() - q).norm();
    if (steps > 5) CHECK(before / error == doctest::Approx(16.0).epsilon(0.2));
    before = error;
  }
}

TEST_CASE("derivatives by states, parameters and filters are those of differences") {
  const Arm arm = two_links(0.0);
  const Start at(arm);
  const Eigen::Index n = arm.nv();
  KalmanOptions options;
  options.friction_speed = 0.3;  // across its bend
  const auto run = [&](const VectorXd& x, MatrixXd* A) {
    auto p = certain_payload(parameters(arm, 0.0, 0.0, 0.0));
    for (std::size_t k = 0; k < p.size(); ++k) p[k].start = x[2 * n + static_cast<Eigen::Index>(k)];
    KalmanFilter filter(Problem(arm), kStep, sensors(arm), p, VectorXd::Zero(n), options);
    filter.start(x.head(n), x.segment(n, n), at.q_deviation, at.v_deviation);
    REQUIRE(filter.predict(at.tau) == Status::ok);
    if (A) *A = filter.transition();
    return state(filter);
  };
  VectorXd x(2 * n + 5);
  x << at.q, at.v, 0.3, 0.05, 0.2, 0.02, 0.1;
  MatrixXd A;
  run(x, &A);
  REQUIRE(A.rows() == x.size() + 2);
  for (Eigen::Index j = 0; j < x.size(); ++j) {
    CAPTURE(j);
    const double h = 1e-5;
    VectorXd up = x, down = x;
    up[j] += h;
    down[j] -= h;
    const VectorXd slope = (run(up, nullptr) - run(down, nullptr)) / (2 * h);
    const VectorXd exact = A.col(j).head(x.size());
    CHECK((exact - slope).norm() < 1e-5 * slope.norm());
  }
}

TEST_CASE("the square root is that of the covariance in full") {
  const Arm arm = two_links(0.0);
  const Start at(arm);
  const Eigen::Index n = arm.nv();
  const auto p = certain_payload(parameters(arm, 0.3, 0.05, 0.2));
  const VectorXd noise = VectorXd::Constant(n, 0.03);
  KalmanFilter filter(Problem(arm), kStep, sensors(arm), p, noise);
  filter.start(at.q, at.v, at.q_deviation, at.v_deviation);
  const MatrixXd P0 = filter.root() * filter.root().transpose();
  const Eigen::Index states = filter.states();
  REQUIRE(states == 2 * n + 7);
  REQUIRE(filter.predict(at.tau) == Status::ok);
  const MatrixXd A = filter.transition();
  // noise enters as forces do, by the difference of an offset of the force of each rate
  MatrixXd Q = MatrixXd::Zero(states, states);
  Q(2 * n + 1, 2 * n + 1) = 1e-4 * kStep;
  {
    auto none = p;
    for (auto& one : none) one.start = 0.0;
    auto plain = sensors(arm);
    KalmanFilter without(Problem(arm), kStep, plain, none, noise);
    without.start(at.q, at.v, 0.0 * at.q_deviation, 0.0 * at.v_deviation);
    for (auto& one : none) one.deviation = one.drift = 0.0;
    KalmanFilter still(Problem(arm), kStep, plain, none, noise);
    still.start(at.q, at.v, 0.0 * at.q_deviation, 0.0 * at.v_deviation);
    REQUIRE(still.predict(at.tau) == Status::ok);
    MatrixXd B(2 * n, n);
    for (Eigen::Index j = 0; j < n; ++j) {
      VectorXd ends[2];
      for (const int sign : {0, 1}) {
        without.start(at.q, at.v, 0.0 * at.q_deviation, 0.0 * at.v_deviation);
        REQUIRE(without.predict(at.tau + (sign == 0 ? 0.01 : -0.01) * VectorXd::Unit(n, j)) == Status::ok);
        ends[sign] = state(without).head(2 * n);
      }
      B.col(j) = (ends[0] - ends[1]) / 0.02;
    }
    const MatrixXd by_noise = (still.root() * still.root().transpose()).topLeftCorner(2 * n, 2 * n);
    const MatrixXd expected = B * B.transpose() * (0.03 * 0.03 / kStep);
    CHECK((by_noise - expected).norm() < 1e-6 * expected.norm());
  }
  auto still = p;
  for (auto& one : still) one.deviation = one.drift = 0.0;
  KalmanFilter only_noise(Problem(arm), kStep, sensors(arm), still, noise);
  only_noise.start(at.q, at.v, 0.0 * at.q_deviation, 0.0 * at.v_deviation);
  REQUIRE(only_noise.predict(at.tau) == Status::ok);
  Q += only_noise.root() * only_noise.root().transpose();
  MatrixXd P = A * P0 * A.transpose() + Q;
  CHECK((filter.root() * filter.root().transpose() - P).norm() < 1e-10 * P.norm());

  // readings, all at once; the camera's row by differences of the place
  const auto instruments = sensors(arm);
  MatrixXd H = MatrixXd::Zero(5, states);
  VectorXd expected(5), R(5);
  Workspace ws(arm);
  const PlacedSlice end(arm, 1);
  const auto height = [&](const VectorXd& q) {
    move_arm(arm, ws, q, VectorXd::Zero(n));
    return slice_pose(ws, end).p[2];
  };
  for (Eigen::Index k = 0; k < 5; ++k) {
    const KalmanSensor& s = instruments[static_cast<std::size_t>(k)];
    R[k] = s.noise * s.noise;
    if (s.F.rows() > 0) continue;
    H.row(k).head(n) = s.by_q.transpose();
    H.row(k).segment(n, n) = s.by_v.transpose();
  }
  for (Eigen::Index j = 0; j < n; ++j) {
    const VectorXd turn = VectorXd::Unit(n, j) * 1e-6;
    H(3, j) = (height(filter.q() + turn) - height(filter.q() - turn)) / 2e-6;
  }
  H(4, states - 2) = 1.0;
  VectorXd y(5);
  y << filter.q()[0] + 1e-3, filter.v()[arm.first(1)] - 2e-2, instruments[2].by_q.dot(filter.q()) + 2e-6,
      height(filter.q()) + 1e-9, std::numeric_limits<double>::quiet_NaN();
  VectorXd off(5);
  off << 1e-3, -2e-2, 2e-6, 1e-9, 0.0;
  const MatrixXd H4 = H.topRows(4);
  const MatrixXd S = H4 * P * H4.transpose() + MatrixXd(R.head(4).asDiagonal());
  const MatrixXd K = P * H4.transpose() * S.inverse();
  const VectorXd before = state(filter);
  REQUIRE(filter.update(y) == Status::ok);
  CHECK(filter.used() == 4);
  CHECK(std::isnan(filter.innovations()[4]));
  const MatrixXd after = P - K * S * K.transpose();
  CHECK((filter.root() * filter.root().transpose() - after).norm() < 1e-6 * after.norm());
  const VectorXd turn = K * off.head(4);
  CHECK((state(filter) - before - turn.head(before.size())).norm() < 1e-3 * turn.norm());
  CHECK(filter.nis() == doctest::Approx(off.head(4).dot(S.inverse() * off.head(4))).epsilon(1e-3));
}

TEST_CASE("steps through the bend of friction are found") {
  RigidBody light = flexarm_test::body(0.02, {0.1, 0, 0});
  std::vector<Link> links;
  links.emplace_back(Joint::revolute({0, 0, 1}), light, std::nullopt, std::nullopt);
  const Arm arm(std::move(links));
  const VectorXd none = VectorXd::Zero(1);
  KalmanFilter filter(Problem(arm), kStep, {KalmanSensor::encoder(arm, 0, 1e-3)},
                      {{KalmanParameter::coulomb, 0, 0.1, 0.0}}, none);
  int turned = 0;
  for (int k = 0; k < 400; ++k) {
    VectorXd v(1), tau(1);
    v[0] = 0.05 * std::sin(1.0 * k);
    tau[0] = 0.3 * std::sin(0.37 * k);
    filter.start(none, v, none, none);
    REQUIRE(filter.predict(tau) == Status::ok);
    turned += v[0] * filter.v()[0] < 0.0;
  }
  CHECK(turned > 50);
}

TEST_CASE("a place has the covariance of its coordinates") {
  const Arm arm = two_links(0.0);
  const Start at(arm);
  KalmanFilter filter(Problem(arm), kStep, sensors(arm), parameters(arm, 0.3, 0.0, 0.0), VectorXd::Zero(arm.nv()));
  filter.start(at.q, at.v, at.q_deviation, at.v_deviation);
  const PlacedSlice end(arm, 1);
  Eigen::Vector3d p;
  Eigen::Matrix3d C;
  filter.place(end, p, C);
  Workspace ws(arm);
  move_arm(arm, ws, at.q, at.v);
  Mat6X<double> J(6, arm.nv());
  slice_jacobian(arm, ws, end, J);
  CHECK((p - slice_pose(ws, end).p).norm() < 1e-15);
  const MatrixXd expected = 1e-4 * J.topRows<3>() * J.topRows<3>().transpose();
  CHECK((C - expected).norm() < 1e-12 * expected.norm());
}

TEST_CASE("what cannot be filtered is named") {
  const Arm arm = two_links(0.0), ball = flexarm_test::floating_arm();
  const VectorXd zero = VectorXd::Zero(arm.nv());
  const auto says = [&](const std::string& what, auto make) {
    std::string text;
    try {
      make();
    } catch (const std::invalid_argument& e) {
      text = e.what();
    }
    CHECK(text.find(what) != std::string::npos);
  };
  const auto make = [&](std::vector<KalmanSensor> s, std::vector<KalmanParameter> p, VectorXd noise) {
    KalmanFilter(Problem(arm), kStep, s, p, noise);
  };
  auto some = sensors(arm);
  says("sensors", [&] { make({}, {}, zero); });
  some[1].noise = 0.0;
  says("sensors[1].noise = 0", [&] { make(some, {}, zero); });
  says("force_noise", [&] { make(sensors(arm), {}, zero.head(2)); });
  says("force_noise", [&] { make(sensors(arm), {}, VectorXd::Constant(arm.nv(), -1.0)); });
  says("parameters[0].rate = 2", [&] { make(sensors(arm), {{KalmanParameter::damping, 2, 0.0, 1.0}}, zero); });
  const KalmanParameter payload{KalmanParameter::payload, 0, 0.0, 1.0};
  says("twice", [&] { make(sensors(arm), {payload, payload}, zero); });
  says("rate = 1", [&] { KalmanSensor::encoder(arm, 1, 1e-3); });
  says("ball", [&] {
    KalmanFilter(Problem(ball), kStep, {KalmanSensor::encoder(ball, 4, 1e-3)}, {}, VectorXd::Zero(ball.nv()));
  });
}

TEST_CASE("a step that fails leaves the estimate as it was") {
  const Arm arm = two_links(0.0);
  const Start at(arm);
  KalmanFilter filter(Problem(arm), kStep, sensors(arm), parameters(arm, -50.0, 0.0, 0.0), VectorXd::Zero(arm.nv()));
  filter.start(at.q, at.v, at.q_deviation, at.v_deviation);
  const MatrixXd root = filter.root();
  CHECK(filter.predict(at.tau) == Status::singular);
  CHECK((filter.q() == at.q && filter.v() == at.v && filter.root() == root));
  KalmanFilter other(Problem(arm), kStep, sensors(arm), parameters(arm, 0.0, 0.0, 0.0), VectorXd::Zero(arm.nv()));
  other.start(at.q, at.v, at.q_deviation, at.v_deviation);
  CHECK(other.predict(at.tau * std::numeric_limits<double>::quiet_NaN()) == Status::not_finite);
  CHECK((other.q() == at.q && other.v() == at.v));
}

#ifdef FLEXARM_WATCHES

TEST_CASE("a cycle asks nothing of the system") {
  JointForce rough;
  rough.coulomb = 0.1;
  std::vector<Link> many;
  for (int n = 0; n < 15; ++n)  // 90 rates
    many.emplace_back(Joint({{true, {0, n % 2 ? 1.0 : 0.0, n % 2 ? 0.0 : 1.0}}}, false, {"r"}, {rough}),
                      flexarm_test::body(0.1, {0.02, 0, 0}), flexarm_test::beam({2, 2, 1, 0, 0}, 2, 0.02),
                      std::nullopt);
  const Arm small = two_links(0.0), large(std::move(many));
  for (const Arm* arm : {&small, &large}) {
    Start at(*arm);
    at.q *= 0.1;
    at.v *= 0.1;
    at.tau *= 0.01;
    KalmanFilter filter(Problem(*arm), 1e-4, sensors(*arm), parameters(*arm, 0.1, 0.01, 0.01),
                        VectorXd::Constant(arm->nv(), 1e-3));
    VectorXd y = wave(5, 0.2, 1e-6);
    y[1] = std::numeric_limits<double>::quiet_NaN();
    const PlacedSlice end(*arm, 1);
    Eigen::Vector3d p;
    Eigen::Matrix3d C;
    Status status = Status::ok;
    const auto cycle = [&] {
      filter.start(at.q, at.v, at.q_deviation, at.v_deviation);
      for (int k = 0; k < 3 && status == Status::ok; ++k) {
        status = filter.predict(at.tau);
        if (status == Status::ok) status = filter.update(y);
        filter.place(end, p, C);
      }
    };
    const auto asked = flexarm_test::watch(cycle);
    CHECK(asked.allocations == 0);
    CHECK(asked.locks == 0);
    CHECK(asked.throws == 0);
    CHECK(status == Status::ok);
    CHECK(flexarm_test::system_calls(cycle) != flexarm_test::Calls::some);
  }
}

#endif

}  // namespace test_kalman
