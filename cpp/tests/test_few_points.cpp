// Sampled bodies take fewer points where coordinates are small: no one can tell.
#include <functional>

#include "batches.hpp"
#include "flexarm/load.hpp"
#include "kernels.hpp"
#include "setup/sampled_tables.hpp"

namespace test_few_points {
using namespace flexarm;
using namespace flexarm_test;
using Eigen::VectorXd;

namespace {

BeamOptions options(StrainCounts modes, Basis basis, int order) {
  BeamOptions o;
  o.modes = modes;
  o.basis = basis;
  o.order = order;
  if (basis == Basis::loaded) o.tip.mass = 0.3;
  return o;
}

/// A beam between two hinges, with bodies at both ends.
Arm arm_of(const BeamOptions& o, const Eigen::Vector3d& first, const Eigen::Vector3d& second) {
  const Beam beam(0.5, Section::rectangle(0.004, 0.01), steel(), o);
  std::vector<Link> links;
  links.emplace_back(Joint::revolute(first), body(0.5, {0.075, 0.01, -0.02}), beam, body(0.2, {0.04, 0, 0.01}));
  links.emplace_back(Joint::revolute(second), body(0.5, {0.1, 0, 0}), std::nullopt, std::nullopt);
  return Arm(std::move(links), {1.0, 2.0, -9.81});
}

/// Elastic coordinates whose sizes sum up to `part` of the bound.
VectorXd small(const Arm& arm, const VectorXd& direction, double part) {
  const VectorXd& bounds = lanes::PointTables::of(*arm.link(0).beam()).bounds;
  return direction * (part / direction.cwiseAbs().dot(bounds));
}

/// How wrong the kernels' inertias and forces are: parts of the coordinates' own inertias, and of motions that have in
/// each coordinate as much energy. The worst instruction set's.
double wrong(const Arm& arm, const VectorXd& qe) {
  const oracle::Oracle truth(arm);
  const int nv = arm.nv();
  double out = 0.0;
  for (double phase : {0.3, 1.9}) {
    if (kSanitized && phase > 1.0) continue;
    VectorXd q = wave(nv, phase, 1.0), v = wave(nv, phase + 0.7, 1.0), a = VectorXd::Zero(nv), tau(nv);
    q.segment(1, qe.size()) = qe;
    const Eigen::MatrixXd M = truth.mass_matrix(q);
    const VectorXd scale = M.diagonal().cwiseSqrt().cwiseInverse();
    v = v.cwiseProduct(scale).eval();
    VectorXd still = VectorXd::Zero(nv), at_rest(nv);
    const VectorXd expected = truth.inverse(q, v, a) - truth.inverse(q, still, a);
    for (const lanes::Kernels* kernels : all_kernels()) {
      OnKernels on(arm, *kernels, {});
      Eigen::MatrixXd found(nv, nv);
      kernels->move(on.memory.get(), q.data(), v.data());
      kernels->mass_matrix(on.memory.get(), found.data());
      out = std::max(out, (scale.asDiagonal() * (found - M) * scale.asDiagonal()).cwiseAbs().maxCoeff());
      kernels->inverse(on.memory.get(), q.data(), v.data(), a.data(), tau.data());
      kernels->inverse(on.memory.get(), q.data(), still.data(), a.data(), at_rest.data());
      const VectorXd force = tau - at_rest;
      const double size = 1.0 + expected.cwiseProduct(scale).cwiseAbs().maxCoeff(),
                   rounding = 1e-15 * at_rest.cwiseProduct(scale).cwiseAbs().maxCoeff();  // of elastic forces
      out = std::max(out, ((force - expected).cwiseProduct(scale).cwiseAbs().maxCoeff() - rounding) / size);
    }
  }
  return out;
}

TEST_CASE("few points are as right as all, up to their bound") {
  const Eigen::Vector3d y = Eigen::Vector3d::UnitY(), z = Eigen::Vector3d::UnitZ();
  std::vector<StrainCounts> all{{0, 0, 3, 0, 0}, {2, 0, 0, 2, 0}, {2, 1, 2, 1, 1}};
  for (int n = 1; n <= 6; ++n) all.push_back({n, 0, 0, 0, 0});
  for (int n = 1; n <= 4; ++n) all.push_back({n, n, 1, 0, 0});
  int with_few = 0;
  for (Basis basis : {Basis::clamped_free, Basis::legendre, Basis::loaded})
    for (int order : {3, kExact})
      for (const StrainCounts& modes : all) {
        if (kSanitized && modes[0] > 2) continue;
        const Arm arm = arm_of(options(modes, basis, order), modes[1] ? y : z, z);
        const int ne = arm.link(0).ne();
        const lanes::PointTables& tables = lanes::PointTables::of(*arm.link(0).beam());
        if (tables.few.empty()) continue;
        ++with_few;
        CAPTURE(int(basis));
        CAPTURE(order);
        CAPTURE(modes[0]);
        CAPTURE(ne);
        for (int k = -1; k < ne; ++k) {
          CAPTURE(k);
          const VectorXd together = wave(ne, 0.7, 1.0).cwiseQuotient(tables.bounds),
                         way = k < 0 ? together : VectorXd(VectorXd::Unit(ne, k));
          for (double part : {0.999, 1.001}) CHECK(wrong(arm, small(arm, way, part)) < 2e-12);
        }
      }
  CHECK(with_few > (kSanitized ? 20 : 40));
}

bool has_few(const Beam& beam, const std::function<std::vector<Load>(const Arm&)>& loads = {}) {
  const Arm arm({Link(Joint::revolute({0, 0, 1}), body(0.5, {0.1, 0, 0}), beam, std::nullopt)}, {0, 0, -9.81});
  const lanes::KernelArm known = lanes::KernelArm::of(arm).loaded(arm, loads ? loads(arm) : std::vector<Load>{});
  return known.layout().node[0].sampled.few != nullptr;
}

TEST_CASE("which beams have few points") {
  const Section section = Section::rectangle(0.004, 0.01);
  BeamOptions o = options({3, 3, 1, 0, 0}, Basis::clamped_free, kExact);
  const Beam beam(0.5, section, steel(), o);
  CHECK(has_few(beam));
  CHECK(has_few(beam, [](const Arm& arm) { return std::vector<Load>{Load::at_end(arm, 0, true)}; }));
  CHECK(!has_few(beam, [](const Arm& arm) { return std::vector<Load>{Load::along(arm, 0, 0.1, 0.5, true)}; }));
  CHECK(!has_few({0.5, {[=](double) { return section; }, {}}, steel(), o}));
  o.gauss_points = beam.points();
  CHECK(!has_few({0.5, section, steel(), o}));
  o.gauss_points = 0;
  o.shapes[0] = Eigen::MatrixXd::Identity(4, 3);
  CHECK(has_few({0.5, section, steel(), o}));
}

TEST_CASE("derivatives with few points, and beyond") {
  const Arm arm = arm_of(options({2, 2, 1, 0, 0}, Basis::clamped_free, kExact), {0, 0, 1}, {0, 1, 0});
  for (double part : {0.5, 1.5}) {
    VectorXd q = wave(arm.nq(), 0.3, 1.0);
    q.segment(1, 5) = small(arm, wave(5, 0.2, 1.0), part);
    check_slopes(arm, q, wave(arm.nv(), 1.0, 1.0));
  }
}

TEST_CASE("who shares a pack does not change a bit where some arms take few points and others all") {
  constexpr int kScenarios = 11;
  for (int order : {3, kExact})
    for (const StrainCounts& modes : {StrainCounts{3, 0, 0, 0, 0}, {2, 2, 1, 0, 0}}) {
      const Arm arm = arm_of(options(modes, Basis::clamped_free, order), {0, 0, 1}, {0, 0, 1});
      const int nq = arm.nq(), nv = arm.nv(), ne = arm.link(0).ne();
      Eigen::MatrixXd q0(nq, kScenarios), v0(nv, kScenarios);
      for (int b = 0; b < kScenarios; ++b) {
        q0.col(b) = wave(nq, b, 1.0);
        q0.col(b).segment(1, ne) = small(arm, wave(ne, b, 1.0), b % 3 == 1 ? 1.4 : 0.6);
        v0.col(b) = wave(nv, b + 1.0, 0.1);
      }
      const auto run = [&](int first, int count, bool side_by_side) {
        constexpr int kSteps = 3;
        BatchProblem p = flexarm_test::batch_of(std::vector<const Arm*>(count, &arm), count, 1e-6, kSteps);
        flexarm_test::begin_at(p, q0, v0, first);
        p.method.name = "rk4";
        p.lanes = side_by_side;
        p.whole = kScenarios;
        Eigen::MatrixXd v(2 * nv, count);  // start and end
        BatchOutput out;
        std::vector<int> status(static_cast<std::size_t>(count));
        out.status = status.data();
        out.v = v.data();
        run_batch(p, out, 1);
        return Eigen::MatrixXd(v.bottomRows(nv));
      };
      const Eigen::MatrixXd all = run(0, kScenarios, true), alone = run(0, kScenarios, false);
      for (int b = 0; b < kScenarios; ++b) {
        CAPTURE(b);
        CHECK((all.col(b) - v0.col(b)).norm() > 0.0);
        CHECK((all.col(b) - alone.col(b)).cwiseAbs().maxCoeff() < 1e-11 * alone.col(b).cwiseAbs().maxCoeff());
        CHECK(run(b, 1, true) == all.col(b));
      }
    }
}

}  // namespace

}  // namespace test_few_points
