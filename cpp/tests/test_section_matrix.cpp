// Sections given by matrices: couplings, and centres of mass off the axis.
#include <doctest/doctest.h>

#include "flexarm/section.hpp"
#include "kernels.hpp"

namespace test_section_matrix {
using namespace flexarm;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using flexarm_test::check;
using flexarm_test::check_slopes;
using Matrix = SectionMatrix::Matrix;

namespace {

Matrix3d tilde(const Vector3d& a) {
  Matrix3d m;
  m << 0, -a[2], a[1], a[2], 0, -a[0], -a[1], a[0], 0;
  return m;
}

/// A rectangle of steel, with couplings of so much of what they could be.
Matrix stiffness(double coupled) {
  Matrix out = Matrix::Zero();
  out.diagonal() << 8.4e6, 2.7e6, 2.7e6, 15.0, 11.0, 70.0;
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < i; ++j)
      out(i, j) = out(j, i) = 0.2 * coupled * std::sin(1.0 + i + 2.3 * j) * std::sqrt(out(i, i) * out(j, j));
  return out;
}

/// Of 0.3 kg/m, with its centre of mass at c and products of inertia of so much.
Matrix inertia(const Vector3d& c, double products) {
  const double m = 0.3;
  Matrix3d J = Vector3d(6e-6, 2e-6, 5e-6).asDiagonal();
  J(1, 2) = J(2, 1) = products * 2e-6;
  J(0, 1) = J(1, 0) = products * 0.5e-6;
  Matrix out = Matrix::Zero();
  out.topLeftCorner<3, 3>() = m * Matrix3d::Identity();
  out.bottomLeftCorner<3, 3>() = m * tilde(c);
  out.topRightCorner<3, 3>() = -m * tilde(c);
  out.bottomRightCorner<3, 3>() = J - m * tilde(c) * tilde(c);
  return out;
}

BeamOptions options(StrainCounts modes, int order, bool rotary = true, double damping_ratio = 0.0) {
  BeamOptions o;
  o.modes = modes;
  o.order = order;
  o.basis = Basis::legendre;
  o.rotary_inertia = rotary;
  o.damping_ratio = damping_ratio;
  return o;
}

Arm arm_of(const Beam& first, const Beam& second) {
  std::vector<Link> links;
  links.emplace_back(Joint::revolute({0, 0.6, 0.8}), flexarm_test::body(0.5, {0.075, 0.01, -0.02}), first,
                     flexarm_test::body(0.2, {0.04, 0, 0.01}));
  links.emplace_back(Joint::revolute({0, 1, 0}), std::nullopt, second, std::nullopt);
  return Arm(std::move(links), {1.0, 2.0, -9.81});
}

const Vector3d kOff(0.0, 0.01, -0.006);
const StrainCounts kAll{2, 2, 1, 1, 1, 2};

TEST_CASE("couplings of stiffness, at every order") {
  const SectionMatrix section(stiffness(1.0), inertia(Vector3d::Zero(), 0.0));
  for (int order : {0, 1, 2, 3, kExact})
    check(arm_of({0.5, section, options(kAll, order)}, flexarm_test::beam({1, 0, 0, 0, 0}, 2)), false, {},
          order == 0 ? 0.003 : 0.1);
}

TEST_CASE("centres of mass off the axis, and products of inertia") {
  for (int order : {3, kExact})
    for (double products : {0.0, 0.6})
      for (bool rotary : {true, false})
        for (const StrainCounts& modes :
             {rotary ? kAll : StrainCounts{2, 2, 1, 0, 0, 1}, StrainCounts{3}, StrainCounts{0, 0, 2}}) {
          CAPTURE(order);
          const SectionMatrix section(stiffness(1.0), inertia(kOff, products));
          const Beam beam(0.5, section, options(modes, order, rotary, 0.01));
          check(arm_of(beam, flexarm_test::beam({1, 0, 0, 1, 0, 2}, 2)), false);
          if (order < kExact) continue;
          BeamOptions many = beam.options();
          many.gauss_points = 50;
          const Beam bent(0.5, section, many);
          check(arm_of(bent, bent), false, {}, 3.0);
        }
}

TEST_CASE("the same along a tapered beam, and one that is curved at rest") {
  const SectionMatrixProfile profile{
      [](double x) { return SectionMatrix((1.0 - x) * stiffness(1.0), inertia((1.0 + x) * kOff, 0.5)); }, {0.2}};
  BeamOptions o = options(kAll, kExact);
  check(arm_of({0.5, profile, o}, flexarm_test::beam({1, 0, 0, 0, 0}, 2)), false);
  o.curvature = Eigen::RowVector3d(1.0, -2.0, 3.0);
  check(arm_of({0.5, profile, o}, flexarm_test::beam({1, 0, 0, 0, 0}, 2)), false);
  check(arm_of({0.5, SectionMatrix(stiffness(1.0), inertia(kOff, 0.5)), o}, flexarm_test::beam({1, 0, 0, 0, 0}, 2)),
        false);
}

TEST_CASE("derivatives, with many Gauss points and with few") {
  const SectionMatrix section(stiffness(1.0), inertia(kOff, 0.5));
  for (int order : {3, kExact})
    for (double bent : {1e-4, 0.3})
      check_slopes(arm_of({0.5, section, options({2, 1, 1, 0, 1, 2}, order)}, flexarm_test::beam({1, 0, 0, 0, 0}, 2)),
                   bent);
}

TEST_CASE("a doubly symmetric section by its matrices is that section") {
  const Section s = Section::rectangle(0.004, 0.01);
  const Material m = flexarm_test::steel();
  Matrix K = Matrix::Zero(), M = Matrix::Zero();
  const double kGA = m.shear_modulus * s.shear_correction.y * s.area, E = m.youngs_modulus;
  K.diagonal() << E * s.area, kGA, kGA, m.shear_modulus * s.torsion_constant, E * s.second_moment_y,
      E * s.second_moment_z;
  const double rho = m.density, iy = s.second_moment_y, iz = s.second_moment_z;
  M.diagonal() << rho * s.area, rho * s.area, rho * s.area, rho * (iy + iz), rho * iy, rho * iz;
  for (int order : {0, 1, 2, 3, kExact}) {
    const BeamOptions o = options({2, 2, 1, 1, 1, 1}, order, true, 0.01);
    const Beam one(0.5, s, m, o), other(0.5, SectionMatrix(K, M), o);
    CHECK(one.stiffness().isApprox(other.stiffness(), 1e-14));
    CHECK(one.damping().isApprox(other.damping(), 1e-12));
    CHECK(one.mass() == doctest::Approx(other.mass()).epsilon(1e-14));
    CHECK(one.slices()[1].inertia.isApprox(other.slices()[1].inertia, 1e-13));
  }
}

TEST_CASE("what no section can be is told") {
  const auto says = [](const Matrix& K, const Matrix& M, const char* word) {
    try {
      SectionMatrix(K, M);
    } catch (const std::invalid_argument& e) {
      CHECK(std::string(e.what()).find(word) != std::string::npos);
      return;
    }
    FAIL(word);
  };
  const Matrix K = stiffness(1.0), M = inertia(kOff, 0.5);
  Matrix bad = K;
  bad(0, 3) *= 1.001;
  says(bad, M, "stiffness[3][0]");
  bad = K;
  bad(2, 4) = bad(4, 2) = 1e6;
  says(bad, M, "eigenvalue");
  bad = K;
  bad(1, 1) = std::nan("");
  says(bad, M, "finite");
  bad = M;
  bad(1, 1) *= 2.0;
  says(K, bad, "inertia[1][1]");
  bad = M;
  bad.bottomRightCorner<3, 3>() *= 0.1;
  says(K, bad, "inertia");
  says(K, inertia({0.01, 0.0, 0.0}, 0.0), "must lie in the section");
  bad = K;
  bad.row(3).setZero();
  bad.col(3).setZero();  // no mode twists: it may
  CHECK_NOTHROW(Beam(0.5, SectionMatrix(bad, M), options({2, 2, 0, 1, 1, 1}, kExact)));
  CHECK_THROWS_AS(Beam(0.5, SectionMatrix(bad, M), options(kAll, kExact)), std::invalid_argument);
  CHECK_THROWS_AS(Beam(0.5, SectionMatrix(K, M), options(kAll, 2)), std::invalid_argument);
}

}  // namespace

}  // namespace test_section_matrix
