#include <doctest/doctest.h>

#include <Eigen/Geometry>

#include "arms.hpp"
#include "flexarm/quadrature.hpp"
#include "oracle/sections.hpp"

namespace test_beam {
using namespace flexarm;

TEST_CASE("Gauss-Legendre rules integrate polynomials of degree 2n - 1") {
  for (int n : {1, 2, 5, 24, 64}) {
    const GaussRule rule(n, 2.0);
    for (int d = 0; d < 2 * n; ++d) {
      double sum = 0.0;
      for (int i = 0; i < n; ++i) sum += rule.weights[i] * std::pow(rule.points[i] / 2.0, d);
      CHECK(sum == doctest::Approx(2.0 / (d + 1)).epsilon(1e-13));
    }
  }
}

TEST_CASE("sections by their shape: limits that are known") {
  const auto same = [](const Section& a, const Section& b, double relative) {
    CHECK(a.area == doctest::Approx(b.area).epsilon(relative));
    CHECK(a.second_moment_y == doctest::Approx(b.second_moment_y).epsilon(relative));
    CHECK(a.second_moment_z == doctest::Approx(b.second_moment_z).epsilon(relative));
    CHECK(a.torsion_constant == doctest::Approx(b.torsion_constant).epsilon(relative));
  };
  same(Section::tube(0.1, 0.03), Section::circle(0.1, 0.07), 1e-14);
  same(Section::ellipse(0.2, 0.2), Section::circle(0.1), 1e-14);
  same(Section::i_beam(0.2, 0.1, 0.01, 0.1 - 1e-9), Section::rectangle(0.2, 0.1), 1e-3);  // all web
  const Section thin = Section::box(0.2, 0.1, 1e-5, 2e-5);                                // Bredt: 4 A^2 / (int ds/t)
  CHECK(thin.torsion_constant == doctest::Approx(4 * 4e-4 / (0.4 / 2e-5 + 0.2 / 1e-5)).epsilon(1e-3));
  CHECK(Section::tube(1.0, 1e-6).shear_correction.y == doctest::Approx(0.5).epsilon(1e-4));
  const Section flat = Section::i_beam(0.2, 0.1, 0.01, 0.005, ShearCorrection(0.3, 0.6));
  BeamOptions o;
  o.modes[shear_y] = o.modes[shear_z] = 1;
  o.basis = Basis::legendre;
  const Material steel = flexarm_test::steel();
  const Eigen::MatrixXd stiffness = Beam(1.0, flat, steel, o).stiffness();
  CHECK(stiffness(0, 0) == doctest::Approx(0.3 * flat.area * steel.shear_modulus));
  CHECK(stiffness(1, 1) == doctest::Approx(0.6 * flat.area * steel.shear_modulus));
  CHECK_THROWS_WITH(Section::box(0.2, 0.1, 0.01, 0.05),
                    "thickness = 0.05: must be less than half of z; a full section is a Rectangle");
  CHECK_THROWS_WITH(Section::i_beam(0.2, 0.1, 0.1, 0.01),
                    "flange = 0.1: must be less than half of y; a full section is a Rectangle");
}

TEST_CASE("shape functions are clamped, and each row is the derivative of the one above") {
  const double L = 0.7, h = 1e-4;
  for (Basis basis : {Basis::clamped_free, Basis::legendre})
    for (int strain = 0; strain < kStrains; ++strain) {
      const int n = 5;
      const ShapeSet set(strain, basis, n, L);
      const ShapeValues root = set.at(0.0);
      CHECK(root.slope.norm() < 1e-12);
      if (is_bending(strain)) CHECK(root.deflection.norm() < 1e-12);
      for (double x : {0.1, 0.35, 0.6}) {
        const ShapeValues at = set.at(x), up = set.at(x + h), down = set.at(x - h);
        const double size = at.strain.cwiseAbs().maxCoeff();
        CHECK(((up.slope - down.slope) / (2 * h) - at.strain).norm() < 1e-4 * size);
        if (is_bending(strain)) CHECK(((up.deflection - down.deflection) / (2 * h) - at.slope).norm() < 1e-4 * size);
      }
      if (basis == Basis::clamped_free) {
        const ShapeValues tip = set.at(L);
        const Eigen::VectorXd& end = is_bending(strain) ? tip.deflection : tip.slope;
        CHECK((end - Eigen::VectorXd::Ones(n)).norm() < 1e-10);
        CHECK(tip.strain.norm() < 1e-9 * root.strain.norm());  // free of moment
      }
    }
}

TEST_CASE("clamped-free modes keep their digits: orthogonal up to the fortieth") {
  const GaussRule rule(200);
  const ShapeSet set(bending_y, Basis::clamped_free, 40, 1.0);
  Eigen::MatrixXd G = Eigen::MatrixXd::Zero(40, 40);
  for (int g = 0; g < 200; ++g) {
    const Eigen::VectorXd d = set.at(rule.points[g]).deflection;
    G += rule.weights[g] * d * d.transpose();
  }
  CHECK((G - 0.25 * Eigen::MatrixXd::Identity(40, 40)).cwiseAbs().maxCoeff() < 1e-12);
}

TEST_CASE("a slice's Jacobians and convective terms are the derivatives of its motion (Eq. 35-40)") {
  for (const auto& [order, modes] : std::vector<std::pair<int, StrainCounts>>{{1, {2, 2, 2, 1, 1}},
                                                                              {2, {2, 2, 2, 1, 1}},
                                                                              {1, {0, 3, 0, 0, 2}},
                                                                              {2, {3, 0, 0, 2, 0}},
                                                                              {2, {0, 3, 0, 0, 2}},
                                                                              {3, {2, 2, 2, 1, 1}},
                                                                              {kExact, {2, 2, 2, 1, 1}},
                                                                              {3, {3, 0, 0, 2, 0}},
                                                                              {3, {0, 3, 0, 0, 2}},
                                                                              {kExact, {3, 0, 0, 2, 0}},
                                                                              {kExact, {0, 3, 0, 0, 2}},
                                                                              {0, {2, 1, 1, 1, 1, 2}},
                                                                              {1, {2, 1, 1, 1, 1, 2}},
                                                                              {2, {2, 2, 1, 1, 1, 2}},
                                                                              {2, {3, 0, 0, 2, 0, 2}},
                                                                              {3, {2, 2, 1, 1, 1, 2}},
                                                                              {kExact, {2, 2, 1, 1, 1, 2}},
                                                                              {3, {3, 0, 0, 2, 0, 2}},
                                                                              {kExact, {0, 2, 0, 0, 1, 2}}}) {
    const Beam b = flexarm_test::beam(modes, order);
    const SliceTable table = b.slice_at(0.4);
    const int ne = b.ne();
    const Eigen::Vector3d origin(0.1, -0.2, 0.3);
    const Eigen::VectorXd q = flexarm_test::wave(ne, 0.3, 0.4), dq = flexarm_test::wave(ne, 1.1, 0.6);
    oracle::Sections sections(b);
    const auto at = [&](double e) {  // along q + e dq, with constant dq
      sections.move(q + e * dq, dq);
      return sections.at(table).from(origin);
    };
    const double h = 1e-4;
    const oracle::Section p = at(0.0), up = at(h), down = at(-h), far_up = at(2 * h), far_down = at(-2 * h);
    const auto slope = [&](const auto& field) {
      return ((8.0 * (field(up) - field(down)) - (field(far_up) - field(far_down))) / (12.0 * h)).eval();
    };
    using S = const oracle::Section&;
    CHECK((slope([](S s) { return s.x; }) - p.u_dot).norm() < 1e-11);
    CHECK((slope([](S s) { return s.u_dot; }) - p.u_bias).norm() < 1e-11);
    CHECK((slope([](S s) { return s.Omega; }) - p.Omega_bias).norm() < 1e-10);
    CHECK((slope([](S s) { return s.R; }) * p.R.transpose() - tilde(p.Omega)).norm() < 1e-10);
    CHECK((p.R * p.R.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-13);
    CHECK((p.J.topRows<3>() * dq - p.u_dot).norm() < 1e-14);
    CHECK((p.J.bottomRows<3>() * dq - p.Omega).norm() < 1e-14);
  }
}

TEST_CASE("position follows the strains: orders against the integral of R [1 + eps, phi12, phi13] (Eq. 22-27)") {
  // fine integration of R' = R K~, x' = R [1 + eps, phi12, phi13]; the error of order n is of order n + 1
  for (int order : {1, 2, 3}) {
    const Beam b = flexarm_test::beam({2, 2, 2, 1, 1, 2}, order);
    const Eigen::VectorXd shape = flexarm_test::wave(b.ne(), 0.3, 1.0);
    double error[2], turn[2];
    for (int run = 0; run < 2; ++run) {
      const Eigen::VectorXd q = (run == 0 ? 0.2 : 0.1) * shape;
      Eigen::Vector3d x = Eigen::Vector3d::Zero();
      Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
      const int n = 4000;
      const double h = b.length() / n;
      for (int i = 0; i < n; ++i) {  // midpoint rule
        const Eigen::VectorXd e = b.slice_at((i + 0.5) * h).strains * q;
        const Eigen::Vector3d half = 0.5 * h * e.head<3>(), full = h * e.head<3>();
        const auto turned = [](const Eigen::Vector3d& t) {
          return Eigen::AngleAxisd(t.norm(), t.normalized()).toRotationMatrix();
        };
        const Eigen::Matrix3d Rm = R * turned(half);
        x += h * Rm * Eigen::Vector3d(1.0 + e[StrainRow::eps], e[3], e[4]);
        R = R * turned(full);
      }
      oracle::Sections sections(b);
      sections.move(q, Eigen::VectorXd::Zero(b.ne()));
      const oracle::Section tip = sections.at(b.tip());
      error[run] = (tip.x - x).norm();
      turn[run] = (tip.R - R).norm();
    }
    CHECK(error[0] / error[1] == doctest::Approx(std::pow(2.0, order + 1)).epsilon(0.1));
    CHECK(turn[0] / turn[1] == doctest::Approx(std::pow(2.0, order + 1)).epsilon(0.1));
    CHECK(error[0] < 1e-2);
  }
}

TEST_CASE("bad numbers are named") {
  CHECK_THROWS_WITH_AS(Section::rectangle(-0.001, 0.02), "y = -0.001: must be positive and finite",
                       std::invalid_argument);
  CHECK_THROWS_WITH_AS(Material(7850, 209e9, 0.7), "poisson_ratio = 0.7: must be above -1 and at most 0.5",
                       std::invalid_argument);
  CHECK_THROWS_AS(Material(7850, 209e9, 0.3, 80e9), std::invalid_argument);
  CHECK_THROWS_AS(flexarm_test::beam({1, 0, 0, 0, 0}, 5), std::invalid_argument);
  CHECK_THROWS_AS(flexarm_test::beam({-1, 0, 0, 0, 0}, 2), std::invalid_argument);
  CHECK_THROWS_AS(flexarm_test::beam({1, 0, 0, 0, 0}, 2).slice_at(0.6), std::invalid_argument);
}

}  // namespace test_beam
