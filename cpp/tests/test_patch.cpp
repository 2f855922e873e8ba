#include <doctest/doctest.h>

#include "arms.hpp"
#include "flexarm/patch.hpp"
#include "flexarm/simulate.hpp"

namespace test_patch {
using namespace flexarm;

namespace {

const Piezo pzt(60.6e9, 0.3, 7500.0, -274e-12, 0.0, 0.0, 3e-8);

Patch pair(double start, double end, double electrode = 1.0) {
  PatchLayer layer;
  layer.width = 0.02;
  layer.thickness = 0.2e-3;
  layer.inner = 0.5e-3;
  layer.electrode = electrode;
  return {start, end, [layer](double) { return patch_section(pzt, layer); }};
}

Beam strip(const std::vector<Patch>& patches, int modes = 4) {
  BeamOptions options;
  options.modes[bending_y] = modes;
  options.basis = Basis::legendre;
  return Beam(0.5, Section::rectangle(0.001, 0.02), Material(7850.0, 209e9), options, patches);
}

}  // namespace

TEST_CASE("a pair's moment per volt is the published one, and its force vector the integral of P_k over it") {
  const Beam beam = strip({pair(0.02, 0.07)});
  const Eigen::VectorXd f = beam.patch_forces().col(0) / 3.985056e-4;
  const double a = 2 * 0.02 / 0.5 - 1, b = 2 * 0.07 / 0.5 - 1;
  CHECK(f[0] == doctest::Approx(0.05).epsilon(1e-13));
  CHECK(f[1] == doctest::Approx(0.25 * (b * b - a * a) / 2).epsilon(1e-13));
  CHECK(f[2] == doctest::Approx(0.25 * ((b * b * b - b) - (a * a * a - a)) / 2).epsilon(1e-13));
  CHECK(beam.mass() == doctest::Approx(7850 * 1e-5 + 7500 * 0.05 * 8e-6).epsilon(1e-13));
}

TEST_CASE("a beam without patches is left as it was, and one patch is as good as its pieces") {
  const Beam bare = strip({}), whole = strip({pair(0.1, 0.4)}), parts = strip({pair(0.1, 0.23), pair(0.23, 0.4)});
  CHECK(bare.patch_forces().cols() == 0);
  CHECK(whole.slices().size() > bare.slices().size());
  CHECK((parts.stiffness() - whole.stiffness()).norm() < 1e-13 * whole.stiffness().norm());
  CHECK((parts.patch_forces().rowwise().sum() - whole.patch_forces()).norm() < 1e-15);
  CHECK(parts.patch_capacitances().sum() == doctest::Approx(whole.patch_capacitances()[0]).epsilon(1e-13));
  CHECK_THROWS_AS(strip({pair(0.1, 0.6)}), std::invalid_argument);
  CHECK_THROWS_AS(strip({pair(0.1, 0.2, 1.5)}), std::invalid_argument);
}

TEST_CASE("a drive with a column pushes every coordinate in proportion") {
  const Arm arm({Link(Joint::revolute({0, 0, 1}), RigidBody{}, strip({pair(0.02, 0.07)}, 2), {})});
  const Eigen::MatrixXd B = arm.patch_matrix();
  REQUIRE(B.rows() == arm.nv());
  CHECK(B(0, 0) == 0.0);
  Drive volts{};
  volts.force = [](double) { return 5.0; };
  volts.column = B.col(0);
  Rk4Step step(arm, 1e-6);
  const Eigen::VectorXd t = Eigen::Vector2d(0.0, 1e-5);
  Problem problem(arm);
  problem.drives = {volts};
  const Trajectory out = simulate_fixed(problem, t, step, 1e-6);
  CHECK(out.failure.empty());
  CHECK((out.tau.row(1).transpose() - 5.0 * B.col(0)).norm() < 1e-18);
  problem.drives[0].column = Eigen::VectorXd::Ones(1);
  CHECK_THROWS_AS(simulate_fixed(problem, t, step, 1e-6), std::invalid_argument);
}

}  // namespace test_patch
