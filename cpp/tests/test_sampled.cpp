// The kernels at order 3 and "exact".
#include "batches.hpp"
#include "flexarm/derivatives.hpp"
#include "kernels.hpp"

namespace test_sampled {
using namespace flexarm;
using namespace flexarm_test;

namespace {

/// A beam with enough points for turns by tens of radians.
Beam fine_beam(flexarm::StrainCounts modes, int order, int points, const std::vector<Patch>& patches = {},
               bool tapered = false) {
  BeamOptions o;
  o.modes = modes;
  o.order = order;
  o.basis = Basis::legendre;
  o.gauss_points = points;
  const Section thick = Section::rectangle(0.006, 0.01), thin = Section::rectangle(0.002, 0.008);
  if (!tapered) return {0.5, thick, flexarm_test::steel(), o, patches};
  const SectionProfile section{[=](double x) { return x < 0.2 ? thick : thin; }, {0.2}};
  return {0.5, section, flexarm_test::steel(), o, patches};
}

Arm of_beams(const Beam& first, const Beam& second) {
  std::vector<Link> links;
  links.emplace_back(Joint::revolute({0, 0, 1}), flexarm_test::body(0.5, {0.075, 0.01, -0.02}), first,
                     flexarm_test::body(0.2, {0.04, 0, 0.01}));
  links.emplace_back(Joint::revolute({0, 1, 0}), std::nullopt, second, std::nullopt);
  return Arm(std::move(links), {1.0, 2.0, -9.81});
}

Patch patch(double start, double end) {
  PatchLayer layer;
  layer.width = 0.008;
  layer.thickness = 0.4e-3;
  layer.inner = 3e-3;
  const Piezo pzt(60.6e9, 0.3, 7500.0, -274e-12, 0.0, 0.0, 3e-8);
  return {start, end, [=](double) { return patch_section(pzt, layer); }};
}

TEST_CASE("planar arms of order 3 and exact") {
  for (int order : {3, kExact})
    for (double damping : {0.0, 0.02}) {
      CAPTURE(order);
      check(flat({0, 0, 1}, {3, 0, 0, 0, 0}, order, damping), true);
      check(flat({0, 1, 0}, {0, 2, 0, 0, 1}, order, damping), true);
      check(flat({0, 0, 1}, {2, 0, 0, 2, 0}, order, damping), true);
    }
  std::vector<bool> first(9, false);
  first[0] = true;
  check(flat({0, 0, 1}, {3, 0, 0, 0, 0}, kExact), true, first);
}

TEST_CASE("arms in space of order 3 and exact") {
  for (int order : {3, kExact}) {
    CAPTURE(order);
    check(flexarm_test::spatial_arm(order), false);
    check(flat({0, 0, 1}, {3, 3, 1, 0, 0}, order, 0.01), false);
    check(flat({0, 1, 0}, {2, 0, 0, 0, 0}, order), false);  // bends out of the plane of its joints
    check(flat({0, 0, 1}, {0, 0, 2, 0, 0}, order), false);
    check(flat({0, 0, 1}, {0, 0, 0, 1, 1}, order), false);
    std::vector<bool> second(15, false);
    second[7] = true;
    check(flat({0, 0, 1}, {2, 1, 1, 1, 1}, order), false, second);
  }
}

TEST_CASE("patches and tapered beams of order 3 and exact: slices that are not at the series' points") {
  const std::vector<Patch> patches{patch(0.03, 0.12), patch(0.2, 0.41)};
  for (int order : {3, kExact})
    for (bool tapered : {false, true})
      for (const std::vector<Patch>& on : {patches, {}}) {
        if (!tapered && on.empty()) continue;
        for (int points : {17, 24}) {
          if (kSanitized && points == 24) continue;
          CAPTURE(order);
          CAPTURE(tapered);
          CAPTURE(points);
          check(
              of_beams(fine_beam({2, 2, 1, 1, 0}, order, points, on, tapered), flexarm_test::beam({1, 1, 1, 0, 0}, 2)),
              false);
          check_slopes(of_beams(fine_beam({1, 1, 1, 0, 1}, order, points, on, tapered),
                                flexarm_test::beam({2, 0, 0, 0, 0}, kExact)));
          std::vector<Link> links;
          links.emplace_back(Joint::revolute({0, 0, 1}), flexarm_test::body(0.5, {0.075, 0.01, 0}),
                             fine_beam({3, 0, 0, 1, 0}, order, points, on, tapered), std::nullopt);
          check(Arm(std::move(links), {1, 2, 3}), true);
        }
      }
}

TEST_CASE("derivatives at order 3 and exact") {
  for (int order : {3, kExact}) {
    CAPTURE(order);
    for (double bent : {1e-9, 1e-4, 0.3, 3.0}) {
      if (kSanitized && bent != 0.3) continue;
      CAPTURE(bent);
      check_slopes(flexarm_test::spatial_arm(order), bent);
      check_slopes(flat({0, 0, 1}, {2, 1, 1, 0, 0}, order, 0.01), bent);
      check_slopes(flat({0, 0, 1}, {0, 0, 2, 0, 0}, order), bent);
      check_slopes(flat({0, 1, 0}, {0, 2, 0, 0, 1}, order), bent);
    }
  }
}

TEST_CASE("beams twisted and bent by many turns") {
  const Beam straight = flexarm_test::beam({1, 0, 0, 0, 0}, 2);
  for (double turned : {1.0, 2.0, 2.9, 3.3, 6.3, 9.4, 21.0, 30.0}) {
    if (kSanitized && turned != 3.3 && turned != 21.0) continue;
    CAPTURE(turned);
    const int points = 40 + static_cast<int>(4 * turned);
    check(flat({0, 0, 1}, {2, 0, 0, 0, 0}, kExact), true, {}, turned);
    check(of_beams(fine_beam({0, 0, 1, 0, 0}, kExact, points), straight), false, {}, turned);
    check(of_beams(fine_beam({3, 0, 0, 0, 0}, kExact, points), straight), false, {}, turned);
    check(of_beams(fine_beam({2, 1, 1, 1, 1}, 3, 24), straight), false, {}, turned);
    if (turned < 5.0) check(of_beams(fine_beam({2, 2, 1, 1, 1}, kExact, points), straight), false, {}, turned);
  }
}

TEST_CASE(
    "an exact beam's points are enough, or too few, but its digits are right, to 30 rad of all coordinates together") {
  const Beam straight = flexarm_test::beam({1, 0, 0, 0, 0}, 2);
  for (double turned : {6.0, 12.0, 20.0, 30.0}) {
    CAPTURE(turned);
    const Arm arm = of_beams(fine_beam({1, 1, 1, 0, 0}, kExact, 90), straight),
              finer = of_beams(fine_beam({1, 1, 1, 0, 0}, kExact, 130), straight);
    Eigen::VectorXd q, v, a = flexarm_test::wave(arm.nv(), 0.7, 1.0), tau = a, expected = a;
    place(arm, 0.4, q, v, turned / 1.7);
    const Eigen::VectorXd truth = oracle::Oracle(arm).inverse(q, v, a);
    for (const lanes::Kernels* kernels : all_kernels()) {
      CAPTURE(std::string(kernels->name));
      OnKernels on(arm, *kernels, {}), fine(finer, *kernels, {});
      kernels->inverse(on.memory.get(), q.data(), v.data(), a.data(), tau.data());
      kernels->inverse(fine.memory.get(), q.data(), v.data(), a.data(), expected.data());
      CHECK((tau - expected).cwiseAbs().maxCoeff() < 1e-12 * expected.cwiseAbs().maxCoeff());
      CHECK((tau - truth).cwiseAbs().maxCoeff() < 1e-11 * expected.cwiseAbs().maxCoeff());
    }
  }
}

TEST_CASE("turns beyond what the series of the rotation keeps digits of are not a number") {
  const Arm arm = of_beams(fine_beam({2, 2, 1, 0, 0}, kExact, 60), flexarm_test::beam({1, 0, 0, 0, 0}, 2));
  for (const lanes::Kernels* kernels : all_kernels()) {
    OnKernels on(arm, *kernels, {});
    Eigen::VectorXd q, v, tau = Eigen::VectorXd::Zero(arm.nv()), a = tau;
    place(arm, 0.4, q, v, 100.0);
    kernels->forward(on.memory.get(), q.data(), v.data(), tau.data(), a.data());
    CHECK(a.array().isNaN().all());
  }
}

/// Steps of many scenarios in packs: each as by itself, whatever the others do.
void check_lanes(const std::vector<const Arm*>& arms, double h) {
  constexpr int kScenarios = 11, kSteps = 10;
  const Arm& one = *arms[0];
  const int nq = one.nq(), nv = one.nv();
  Eigen::MatrixXd q0(nq, kScenarios), v0(nv, kScenarios);
  for (int b = 0; b < kScenarios; ++b) {
    Eigen::VectorXd q, v;
    place(one, 0.3 * b, q, v, b == 3 ? 4.0 : 0.2 + 0.1 * b);  // one far from small turns
    q0.col(b) = q;
    v0.col(b) = v;
  }
  v0(0, 4) = std::numeric_limits<double>::infinity();  // runs away, and spoils no other
  const Eigen::VectorXd tau = flexarm_test::wave(nv, 0.5, 1e-3);
  const auto run = [&](int first, int count, bool side_by_side) {
    std::vector<const Arm*> mine;
    for (int b = 0; b < count; ++b) mine.push_back(arms[static_cast<std::size_t>(first + b) % arms.size()]);
    BatchProblem p = flexarm_test::batch_of(mine, count, h, kSteps);
    flexarm_test::begin_at(p, q0, v0, first);
    p.tau = {tau.data(), 0, 0};
    p.method.name = "rk4";
    p.lanes = side_by_side;
    p.whole = kScenarios;
    Eigen::MatrixXd q(2 * nq, count);  // start and end
    std::vector<int> status(static_cast<std::size_t>(count));
    BatchOutput out;
    out.q = q.data();
    out.status = status.data();
    run_batch(p, out, 1);
    for (int b = 0; b < count; ++b) CHECK((status[static_cast<std::size_t>(b)] == 0) == (first + b != 4));
    return Eigen::MatrixXd(q.bottomRows(nq));
  };
  const Eigen::MatrixXd all = run(0, kScenarios, true), alone = run(0, kScenarios, false);
  for (int b = 0; b < kScenarios; ++b) {
    CAPTURE(b);
    if (b == 4) continue;
    CHECK((all.col(b) - q0.col(b)).norm() > 0.0);
    CHECK((all.col(b) - alone.col(b)).cwiseAbs().maxCoeff() < 1e-10 * alone.col(b).cwiseAbs().maxCoeff());
    CHECK(run(b, 1, true) == all.col(b));
  }
}

TEST_CASE("arms in lanes at order 3 and exact") {
  for (int order : {3, kExact}) {
    CAPTURE(order);
    const Arm plane = flat({0, 0, 1}, {2, 0, 0, 0, 0}, order), space = flexarm_test::spatial_arm(order);
    check_lanes({&plane}, 1e-7);
    check_lanes({&space}, 1e-7);
    BeamOptions o;
    o.modes = {2, 1, 1, 0, 0};
    o.order = order;
    o.basis = Basis::loaded;  // shapes differ as well
    std::vector<Arm> arms;
    for (double length : {0.5, 0.4, 0.7}) {
      o.tip.mass = length;
      const Beam beam(length, Section::rectangle(0.004, 0.01 * length), flexarm_test::steel(), o, {patch(0.1, 0.3)});
      arms.push_back(of_beams(beam, beam));
    }
    check_lanes({&arms[0], &arms[1], &arms[2]}, 1e-7);
    o.gauss_points = 36;
    o.modes = {2, 1, 1, 0, 0, 1};  // that stretch; and, where that can be, are curved, near to straight and far from it
    arms.clear();
    for (double K : {1.0, 2.5, -20.0}) {
      if (order == kExact) {
        o.curvature.resize(2, 3);
        o.curvature << K, 0.3, 1.0, 0.5, K, 0.2;
      }
      const Beam beam(0.5, Section::rectangle(0.004, 0.006 + 1e-4 * K), flexarm_test::steel(), o);
      arms.push_back(of_beams(beam, beam));
    }
    check_lanes({&arms[0], &arms[1], &arms[2]}, 1e-7);
  }
}

TEST_CASE("operations are counted at order 3 and exact, fewer where beams bend little") {
  for (int order : {3, kExact}) {
    BeamOptions o;
    o.modes = {3, 3, 1, 0, 0};
    o.order = order;
    const Beam beam(0.5, Section::rectangle(0.004, 0.01), flexarm_test::steel(), o);
    const Arm arm = of_beams(beam, beam);
    const auto count = [&](double x) {
      return operation_count(arm, Eigen::VectorXd::Constant(arm.nq(), x), Eigen::VectorXd::Constant(arm.nv(), x));
    };
    CHECK(count(1e-3) > 1000);
    if (order == kExact) CHECK(2 * count(1e-3) < count(0.1));
  }
}

}  // namespace

}  // namespace test_sampled
