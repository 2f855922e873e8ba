// Loads on the kernels, against the oracle.
#include <doctest/doctest.h>

#include "batches.hpp"
#include "flexarm/ab.hpp"
#include "flexarm/derivatives.hpp"
#include "flexarm/inverse.hpp"
#include "kernels.hpp"

namespace test_loads {
using namespace flexarm;
using Eigen::Vector3d;

namespace {

/// Everywhere on an arm, in both axes.
std::vector<Load> everywhere(const Arm& arm) {
  std::vector<Load> loads;
  for (const bool world : {true, false})
    for (std::size_t n = 0; n < arm.size(); ++n) {
      loads.push_back(Load::at_end(arm, n, world));
      if (!arm.link(n).beam()) continue;
      const double length = arm.link(n).beam()->length();
      loads.push_back(Load::at_slice(arm, n, 0.37 * length, world));
      loads.push_back(Load::along(arm, n, 0.2 * length, 0.9 * length, world));
    }
  return loads;
}

void check(const Arm& arm, bool planar, const std::vector<bool>& given = {}) {
  CHECK(lanes::KernelArm::of(arm).layout().planar == planar);
  const std::vector<Load> all = everywhere(arm);
  std::vector<std::vector<Load>> cases{all};
  for (const Load& load : all) cases.push_back({load});
  const int nv = arm.nv();
  for (const std::vector<Load>& loads : cases)
    for (const bool moments : {true, false}) {
      CAPTURE(loads.size());
      CAPTURE(loads[0].link);
      CAPTURE(loads[0].world_axes);
      CAPTURE(loads[0].points.size());
      CAPTURE(moments);
      std::vector<double> wrenches;
      for (std::size_t i = 0; i < 6 * loads.size(); ++i)
        wrenches.push_back(i % 6 < 3 || moments ? 5.0 * std::sin(1.3 * static_cast<double>(i)) : 0.0);
      oracle::Oracle truth(arm, given, loads);
      InverseDerivatives slopes(arm, loads);
      for (std::size_t k = 0; k < loads.size(); ++k) {
        truth.wrenches[k] = Eigen::Map<const Vec6<double>>(wrenches.data() + 6 * k);
        slopes.set_wrench(k, truth.wrenches[k]);
      }
      Eigen::VectorXd q, v, tau = flexarm_test::wave(nv, 0.4, 1.0), forces(nv);
      flexarm_test::place(arm, 0.7, q, v);
      const Eigen::VectorXd expected = truth.inverse(q, v, tau), accelerations = truth.forward(q, v, tau, tau);
      slopes(arm, q, v, tau);
      const auto forces_at = [&](const Eigen::VectorXd& x) { return truth.inverse(x, v, tau); };
      for (int i = 0; i < arm.nq() && loads.size() > 1; ++i) {
        const Eigen::VectorXd column = flexarm_test::slope(forces_at, q, Eigen::VectorXd::Unit(arm.nq(), i), 1e-5);
        CHECK((slopes.dq.col(i) - column).cwiseAbs().maxCoeff() < 1e-8 * slopes.dq.cwiseAbs().maxCoeff());
      }
      for (const lanes::Kernels* kernels : flexarm_test::all_kernels()) {
        CAPTURE(std::string(kernels->name));
        flexarm_test::OnKernels on(arm, *kernels, given, loads);
        kernels->load(on.memory.get(), wrenches.data());
        kernels->inverse(on.memory.get(), q.data(), v.data(), tau.data(), forces.data());
        CHECK((forces - expected).cwiseAbs().maxCoeff() < 1e-12 * expected.cwiseAbs().maxCoeff());
        Eigen::VectorXd a = tau;
        CHECK(kernels->forward(on.memory.get(), q.data(), v.data(), tau.data(), a.data()) == lanes::Outcome::good);
        CHECK((a - accelerations).cwiseAbs().maxCoeff() < 1e-8 * accelerations.cwiseAbs().maxCoeff());
      }
    }
}

/// Links in one plane about `axis`; one is rigid with a beam that does not bend.
Arm flat(const Vector3d& axis, flexarm::StrainCounts modes, int order) {
  Placement seat;
  seat.position = {0.03, 0.02, 0.01};
  seat.rotation = Eigen::AngleAxisd(0.4, axis).toRotationMatrix();
  std::vector<Link> links;
  links.emplace_back(Joint::revolute(-axis), flexarm_test::body(0.5, {0.075, 0.01, -0.02}),
                     flexarm_test::beam(modes, order), flexarm_test::body(0.2, {0.04, 0.01, 0.01}));
  links.emplace_back(Joint({{true, axis}}, false, {"turn"}, {}, seat, seat), std::nullopt,
                     flexarm_test::beam({0, 0, 0, 0, 0}, order), flexarm_test::body(0.2, {0.04, 0, 0.01}));
  links.emplace_back(Joint::prismatic({0.6 * (1 - axis[0]), 0.8 * axis[2], 0.8 * axis[1]}),
                     flexarm_test::body(0.3, {0.1, 0, 0}), std::nullopt, std::nullopt);
  links.emplace_back(Joint::revolute(axis), std::nullopt, flexarm_test::beam(modes, order), std::nullopt);
  return Arm(std::move(links), {1.0, 2.0, -9.81});
}

}  // namespace

TEST_CASE("loads of all kinds, in the plane") {
  for (int order : {1, 2}) {
    check(flat({0, 0, 1}, {3, 0, 0, 0, 0}, order), true);
    check(flat({0, 1, 0}, {0, 2, 0, 0, 1}, order), true);
  }
  std::vector<bool> first(10, false);
  first[0] = true;
  check(flat({0, 0, 1}, {3, 0, 0, 0, 0}, 2), true, first);
  // rigid, also in the third plane
  const Arm rigid(
      {Link(Joint::revolute({-1, 0, 0}), flexarm_test::body(0.5, {0.1, 0.2, 0.3}), std::nullopt, std::nullopt),
       Link(Joint::revolute({1, 0, 0}), flexarm_test::body(0.5, {0.1, 0.2, 0.3}), std::nullopt,
            flexarm_test::body(0.1, {0.1, 0.1, 0}))});
  check(rigid, true);
  check(flexarm_test::flat_tree(), true);
}

TEST_CASE("loads of all kinds, in space") {
  for (int order : {1, 2}) {
    check(flexarm_test::spatial_arm(order), false);
    check(flat({0, 0, 1}, {2, 1, 1, 1, 1}, order), false);
  }
  std::vector<bool> second(16, false);
  second[7] = true;
  check(flat({0, 0, 1}, {2, 2, 2, 0, 0}, 2), false, second);
  check(flexarm_test::tree_arm(), false);
}

TEST_CASE("scenarios under loads, side by side and one by one") {
  const Arm one = flat({0, 0, 1}, {2, 0, 0, 0, 0}, 2), other = flexarm_test::spatial_arm(),
            tree = flexarm_test::tree_arm();
  for (const Arm* arm : {&one, &other, &tree})
    for (const bool places : {false, true}) {
      constexpr int kScenarios = 11, kSteps = 20;
      const double h = 1e-5;
      std::vector<Eigen::MatrixXd> ends;
      for (const bool side_by_side : {true, false}) {
        BatchProblem p = flexarm_test::batch_of(std::vector<const Arm*>(kScenarios, arm), kScenarios, h, kSteps);
        const Problem bare = *p.problems[0];
        p.lanes = side_by_side;
        const std::size_t last = arm->size() - 1;
        for (int b = 0; b < kScenarios; ++b) {
          auto loaded = std::make_shared<Problem>(bare);
          const auto wave = [h](double phase) {
            return [=](double t) { return Vec6<double>(flexarm_test::wave(6, phase + 0.7 * t / h, 1.0)); };
          };
          loaded->loads.push_back({Load::at_end(*arm, last, true), wave(b)});
          const double x = places ? b : 0.0;
          loaded->loads.push_back({places && b % 4 == 3 ? Load::along(*arm, last, 0.0, 0.05 + 0.01 * x, false)
                                                        : Load::at_slice(*arm, last, 0.03 * x, false),
                                   wave(0.5)});
          p.problems[static_cast<std::size_t>(b)] = loaded;
        }
        Eigen::MatrixXd q(2 * arm->nq(), kScenarios), tau(2 * arm->nv(), kScenarios);  // start and end
        std::vector<int> status(kScenarios);
        BatchOutput out;
        out.q = q.data();
        out.tau = tau.data();
        out.status = status.data();
        const BatchStats stats = run_batch(p, out, 1);
        CHECK((stats.lanes > 1) == side_by_side);
        for (int s : status) CHECK(s == 0);
        ends.push_back(q.bottomRows(arm->nq()));
      }
      CHECK(ends[0].norm() > 0.0);
      CHECK((ends[0] - ends[1]).cwiseAbs().maxCoeff() < 1e-10 * ends[1].cwiseAbs().maxCoeff());
    }
}

}  // namespace test_loads
