// Predictive control: its predictions and their derivatives, its quadratic programs, what it does where there is
// nothing to be done, and what it asks of the system.
#include <doctest/doctest.h>

#include "acted_on.hpp"
#include "flexarm/mpc.hpp"
#include "prediction.hpp"
#include "qp.hpp"
#include "watch.hpp"

namespace test_mpc {
using namespace flexarm;
using Eigen::MatrixXd;
using Eigen::VectorXd;

TEST_CASE("derivatives of a prediction through sampled laws are those of differences") {
  Problem problem = flexarm_test::acted_on();
  const Arm& arm = *problem.arm;
  const Eigen::Index n = arm.nv();
  for (const double delay : {0.0, 0.0025}) {  // an integral, and a gain at its limit
    LinearLaw law{MatrixXd::Identity(1, 1),
                  0.1 * MatrixXd::Identity(1, 2),
                  MatrixXd::Constant(2, 1, 20.0),
                  3.0 * MatrixXd::Identity(2, 2),
                  MatrixXd::Zero(n, 2),
                  MatrixXd::Zero(2, arm.nq()),
                  MatrixXd::Zero(2, n),
                  VectorXd::Constant(2, 50.0),
                  [](double, VectorXd& r) { r = Eigen::Vector2d(0.1, 9.0); },
                  {}};
    law.columns(2, 0) = law.columns(4, 1) = law.by_q(0, 2) = law.by_v(1, 4) = 1.0;
    law.limit[1] = 1.0;
    law.windup = MatrixXd::Constant(1, 2, 0.01);
    law.reach = law.limit;
    problem.samplers.push_back({0.001, 0.002, delay, law});
  }
  MpcOptions options;
  options.stages = 6;
  options.blocks = 3;
  options.horizon = 0.02;
  options.columns = MatrixXd::Identity(n, n).middleCols(3, 3);
  std::vector<MpcOutput> outputs;
  std::vector<MpcRow> rows;
  for (int axis = 0; axis < 3; ++axis) {
    outputs.push_back(MpcOutput::place(arm, 1, {}, Eigen::Vector3d::Unit(axis)));
    for (const bool rate : {false, true}) rows.push_back({outputs.size() - 1, rate, 1.0, -1.0, 1.0});
  }
  const Grid grid(options);
  Prediction prediction(problem, grid, outputs, rows, options);
  const Eigen::Index all = 2 * n + prediction.zero().z.size();
  REQUIRE(all == 2 * n + 3 + 3 + 2 * 2);
  VectorXd start = VectorXd::Zero(all);
  start.tail(all - 2 * n) = flexarm_test::wave(static_cast<int>(all - 2 * n), 0.7, 0.3);
  MatrixXd plan(3, 3);
  for (Eigen::Index k = 0; k < 9; ++k) plan(k % 3, k / 3) = 0.5 * std::sin(2.0 * static_cast<double>(k));
  const auto values = [&](const MatrixXd& u, const VectorXd& d) {
    const auto [q, v] = flexarm_test::displaced(problem, d.head(2 * n));
    CHECK(prediction(0.04, {q, v, d.tail(all - 2 * n)}, u) == Status::ok);
    return VectorXd(prediction.values);
  };
  values(plan, start);
  const MatrixXd by = prediction.by_plan;
  MatrixXd differences = by, free(by.rows(), all), off = free;
  for (Eigen::Index k = 0; k < all; ++k) {
    VectorXd column = VectorXd::Zero(by.rows());
    prediction.add_free(VectorXd::Unit(all, k), column);
    free.col(k) = column;
  }
  for (Eigen::Index k = 0; k < 9; ++k) {
    MatrixXd more = plan, less = plan;
    more(k % 3, k / 3) += 1e-3;
    less(k % 3, k / 3) -= 1e-3;
    differences.col(k) = (values(more, start) - values(less, start)) / 2e-3;
  }
  for (Eigen::Index k = 0; k < all; ++k) {
    const VectorXd d = 1e-5 * VectorXd::Unit(all, k);
    off.col(k) = (values(plan, start + d) - values(plan, start - d)) / 2e-5;
  }
  CHECK((by - differences).norm() < 1e-6 * by.norm());
  CHECK((free - off).norm() < 1e-5 * free.norm());
  CHECK(free.rightCols(all - 2 * n).norm() > 1e-3);
}

namespace {

struct Case {
  Arm arm = flexarm_test::spatial_arm();
  MpcOptions options;
  std::vector<MpcOutput> outputs;
  VectorXd q = flexarm_test::wave(arm.nv(), 0.1, 1e-4), v = flexarm_test::wave(arm.nv(), 0.4, 1e-3);

  Case() {
    options.stages = 8;
    options.blocks = 5;
    options.horizon = 0.1;
    options.columns = MatrixXd::Zero(arm.nv(), 3);
    for (std::size_t k = 0; k < 3; ++k) {
      options.columns(arm.first(k), static_cast<Eigen::Index>(k)) = 1.0;
      outputs.push_back(MpcOutput::joint(arm, arm.first(k)));
      outputs.back().weight = 1.0;
      outputs.back().rate_weight = 1e-3;
      outputs.back().rate_upper = 2.0;
    }
    for (int axis = 0; axis < 3; ++axis) {
      outputs.push_back(MpcOutput::place(arm, 2, {}, Eigen::Vector3d::Unit(axis)));
      outputs.back().weight = 0.5;
      outputs.back().rate_weight = 1e-3;
    }
    options.upper = VectorXd::Constant(3, 30.0);
    options.lower = -options.upper;
    options.rate_limit = VectorXd::Constant(3, 5000.0);
    options.effort = VectorXd::Constant(3, 1e-6);
    options.rate_effort = VectorXd::Constant(3, 1e-10);
  }
  Mpc mpc() const {
    return {Problem(arm), outputs, options, [](double t, VectorXd& value, VectorXd& rate) {
              value.setConstant(0.2 * t);
              rate.setConstant(0.2);
            }};
  }
};

}  // namespace

TEST_CASE("derivatives of a prediction are those of differences") {
  const Case c;
  std::vector<MpcRow> rows;
  for (std::size_t k = 0; k < c.outputs.size(); ++k) {
    rows.push_back({k, false, 1.0, -1.0, 1.0});
    rows.push_back({k, true, 1.0, -1.0, 1.0});
  }
  const Grid grid(c.options);
  CHECK(grid.times[8] == doctest::Approx(0.1));
  CHECK((grid.shift.rowwise().sum().array() - 1.0).abs().maxCoeff() < 1e-12);
  CHECK(grid.durations[0] == c.options.period);
  const Problem problem(c.arm);
  Prediction prediction(problem, grid, c.outputs, rows, c.options);
  MatrixXd plan(3, 5);
  for (Eigen::Index k = 0; k < 15; ++k) plan(k % 3, k / 3) = 3.0 * std::sin(2.0 * static_cast<double>(k));
  const auto values = [&](const MatrixXd& u, const VectorXd& q) {
    CHECK(prediction(0.0, {q, c.v, VectorXd()}, u) == Status::ok);
    return VectorXd(prediction.values);
  };
  values(plan, c.q);
  values(plan, c.q);  // again, from what it remembers
  const MatrixXd by = prediction.by_plan;
  VectorXd free = VectorXd::Zero(by.rows());
  prediction.add_free(VectorXd::Unit(2 * c.arm.nv(), 1), free);
  MatrixXd differences = by;
  for (Eigen::Index k = 0; k < 15; ++k) {
    MatrixXd more = plan, less = plan;
    more(k % 3, k / 3) += 1e-3;
    less(k % 3, k / 3) -= 1e-3;
    differences.col(k) = (values(more, c.q) - values(less, c.q)) / 2e-3;
  }
  CHECK((by - differences).norm() < 1e-6 * by.norm());
  const VectorXd turn = 1e-5 * VectorXd::Unit(c.arm.nv(), 1);
  const VectorXd off = (values(plan, c.q + turn) - values(plan, c.q - turn)) / 2e-5 - free;
  CHECK(free.norm() > 0.1);
  CHECK(off.norm() < 1e-5 * free.norm());
}

TEST_CASE("quadratic programs: limits that are soft, limits that are not, and none") {
  // least (z0 - 2)^2 / 2 + (z1 + 1)^2 / 2 with |z| <= 1.5 and z0 + z1 <= 0, soft: by s it costs w s + p s^2 / 2
  const auto solved = [](double w, double p) {
    Qp qp(2, VectorXd::Constant(1, w), VectorXd::Constant(1, p), 100);
    qp.H.setIdentity();
    qp.A.setOnes();
    qp.f << -2.0, 1.0;
    qp.lower << -1.5, -1.5, -1e30;
    qp.upper << 1.5, 1.5, 0.0;
    for (int k = 0; k < 3; ++k) {  // the same again from its active set
      CHECK(qp.prepare());
      CHECK(qp.solve());
    }
    return VectorXd(qp.z);
  };
  CHECK((solved(0.0, 0.0) - Eigen::Vector2d(1.5, -1.5)).norm() < 1e-9);   // hard
  CHECK((solved(10.0, 1.0) - Eigen::Vector2d(1.5, -1.5)).norm() < 1e-9);  // as good as hard
  CHECK((solved(0.1, 0.1) - Eigen::Vector2d(1.5, -1.0 - 0.1 - 0.04 / 1.1)).norm() < 0.01);
  Qp qp(2, VectorXd::Zero(0), VectorXd::Zero(0), 100);
  qp.H << 1.0, 1.0, 1.0, 1.0;  // singular
  CHECK_FALSE(qp.prepare());
  CHECK_FALSE(qp.solve());
  qp.H.setIdentity();
  CHECK(qp.prepare());
  qp.f.setConstant(std::nan(""));
  CHECK_FALSE(qp.solve());
  CHECK(qp.z.allFinite());
}

TEST_CASE("what it applies is finite and within its limits, whatever it is given") {
  Case c;
  Mpc mpc = c.mpc();
  const VectorXd nan = VectorXd::Constant(c.arm.nv(), std::nan(""));
  const auto fine = [&] {
    return mpc.u().allFinite() && mpc.forces().allFinite() && mpc.u().cwiseAbs().maxCoeff() <= 30.0;
  };
  CHECK(mpc.feedback(0.0, nan, c.v) == Status::not_finite);  // before there is a plan
  CHECK(fine());
  CHECK(mpc.prepare() == Status::ok);
  CHECK(mpc.feedback(0.0, c.q, c.v) == Status::ok);
  CHECK(mpc.prepare() == Status::ok);
  CHECK(mpc.feedback(1e-3, c.q, nan) == Status::not_finite);
  CHECK(fine());
  CHECK(mpc.prepare() == Status::ok);
  CHECK(mpc.feedback(2e-3, 1e5 * c.q, 1e300 * c.v) != Status::ok);
  CHECK(fine());
  mpc.prepare();
  CHECK(mpc.feedback(3e-3, c.q, c.v) == Status::ok);
  CHECK(fine());
  CHECK(mpc.failures() == 3);
  c.options.max_qp_iterations = 2;  // too few for its limits
  c.options.upper.setConstant(0.01);
  c.options.lower.setConstant(-0.01);
  Mpc hurried = c.mpc();
  CHECK(hurried.feedback(0.0, c.q, c.v) == Status::not_converged);
  CHECK(hurried.u().cwiseAbs().maxCoeff() <= 0.01);
}

#ifdef FLEXARM_WATCHES
TEST_CASE("after construction nothing is allocated, locked or thrown") {
  Case c;
  for (const bool delayed : {false, true}) {
    c.options.delayed = delayed;
    c.options.iterations = delayed ? 2 : 1;
    Mpc mpc = c.mpc();
    const VectorXd nan = VectorXd::Constant(c.arm.nv(), std::nan(""));
    const flexarm_test::Asked asked = flexarm_test::watch([&] {
      for (int k = 0; k < 5; ++k) {
        mpc.feedback(1e-3 * k, k == 3 ? nan : c.q, c.v);
        mpc.prepare();
      }
    });
    CHECK(mpc.failures() == 1);
    CHECK(asked.allocations == 0);
    CHECK(asked.locks == 0);
    CHECK(asked.throws == 0);
  }
}
#endif

}  // namespace test_mpc
