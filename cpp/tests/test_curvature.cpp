// Beams that are curved or twisted at rest, in the kernels.
#include <doctest/doctest.h>

#include <Eigen/Geometry>

#include "kernels.hpp"

namespace test_curvature {
using namespace flexarm;
using Eigen::Vector3d;
using flexarm_test::check;
using flexarm_test::check_slopes;

namespace {

/// K1, K2, K3 at the clamp and what they change by along the beam.
Eigen::MatrixXd curvature(const Vector3d& at_clamp, const Vector3d& change = Vector3d::Zero()) {
  Eigen::MatrixXd out(2, 3);
  out << (at_clamp + 0.5 * change).transpose(), 0.5 * change.transpose();
  return out;
}

Beam curved(StrainCounts modes, const Eigen::MatrixXd& K, bool tapered = false, double damping_ratio = 0.0) {
  BeamOptions o;
  o.modes = modes;
  o.order = kExact;
  o.basis = Basis::legendre;
  o.curvature = K;
  o.damping_ratio = damping_ratio;
  const Section thick = Section::rectangle(0.006, 0.01);
  if (!tapered) return {0.5, thick, flexarm_test::steel(), o};
  const SectionProfile section{[](double x) { return Section::rectangle(0.006 - 0.004 * x, 0.01); }, {}};
  return {0.5, section, flexarm_test::steel(), o};
}

Arm in_plane(const Vector3d& axis, const Beam& first, const Beam& second) {
  std::vector<Link> links;
  links.emplace_back(Joint::revolute(axis), flexarm_test::body(0.5, {0.075, 0, 0}), first,
                     flexarm_test::body(0.2, {0.04, 0, 0.01}));
  links.emplace_back(Joint::revolute(axis), std::nullopt, second, flexarm_test::body(0.1, {0.02, 0, 0}));
  return Arm(std::move(links), {1.0, 2.0, -9.81});
}

Arm in_space(const Beam& first, const Beam& second) {
  std::vector<Link> links;
  links.emplace_back(Joint::revolute({0, 0.6, 0.8}), flexarm_test::body(0.5, {0.075, 0.01, -0.02}), first,
                     flexarm_test::body(0.2, {0.04, 0, 0.01}));
  links.emplace_back(Joint::revolute({0, 1, 0}), std::nullopt, second, flexarm_test::body(0.1, {0.02, 0, 0}));
  return Arm(std::move(links), {1.0, 2.0, -9.81});
}

TEST_CASE("the shape at rest: an arc, a helix, and what the kernels make of no strain") {
  for (const Vector3d& K : {Vector3d(0, 0, 3), Vector3d(2, 0, 3), Vector3d(-1, 2, 4), Vector3d(9, 2, -30)}) {
    const Beam beam = curved({1, 1, 1, 1, 1, 1}, curvature(K));
    for (double X : {0.0, 0.17, 0.5}) {
      const SliceAtRest rest = beam.slice_at(X).rest;
      const double k = K.norm();
      const Vector3d n = K / k, e = Vector3d::UnitX();
      const Vector3d across = e - n * n[0];
      const Vector3d x = X * n[0] * n + std::sin(k * X) / k * across + (1 - std::cos(k * X)) / k * n.cross(e);
      CHECK((rest.x - x).norm() < 1e-12);
      CHECK((rest.R - Eigen::AngleAxisd(k * X, n).toRotationMatrix()).norm() < 1e-12);
      CHECK((rest.theta - X * K).norm() < 1e-13);
      oracle::Sections sections(beam);
      sections.move(Eigen::VectorXd::Zero(beam.ne()), Eigen::VectorXd::Zero(beam.ne()));
      const oracle::Section still = sections.at(beam.slice_at(X));
      CHECK((still.x - rest.x).norm() < 1e-11);
      CHECK((still.R - rest.R).norm() < 1e-11);
      CHECK((still.J - rest.J).norm() < 1e-11 * (1.0 + rest.J.norm()));
    }
  }
}

TEST_CASE("curved beams in a plane") {
  const Vector3d y = Vector3d::UnitY(), z = Vector3d::UnitZ();
  for (bool tapered : {false, true})
    for (const StrainCounts& modes : {StrainCounts{3, 0, 0, 0, 0, 0}, StrainCounts{2, 0, 0, 1, 0, 2}}) {
      const Beam bent = curved(modes, curvature({0, 0, 2}, {0, 0, -5}), tapered, 0.01);
      check(in_plane(z, bent, curved({2, 0, 0, 0, 0}, curvature({0, 0, -4}))), true);
      check_slopes(in_plane(z, bent, flexarm_test::beam({2, 0, 0, 0, 0}, kExact)));
      check(in_plane(y, bent, bent), false);
    }
  const Beam other = curved({0, 2, 0, 0, 1, 1}, curvature({0, 3, 0}));
  check(in_plane(y, other, flexarm_test::beam({0, 2, 0, 0, 0}, 2)), true);
  check(in_plane(z, curved({2, 0, 0, 0, 0}, curvature({0, 3, 0})), flexarm_test::beam({2, 0, 0, 0, 0}, 2)), false);
  check(in_plane(z, curved({2, 0, 0, 0, 0}, curvature({3, 0, 0})), flexarm_test::beam({2, 0, 0, 0, 0}, 2)), false);
}

TEST_CASE("curved and twisted beams in space") {
  for (bool tapered : {false, true})
    for (const Eigen::MatrixXd& K : {curvature({3, 0, 0}, {4, 0, 0}), curvature({1, -2, 3}, {2, 2, -3}),
                                     curvature({0, 0, 12}), curvature({20, 0, 2})}) {
      const Beam bent = curved({2, 1, 1, 1, 1, 1}, K, tapered, 0.01), bends = curved({3, 0, 0, 0, 0}, K, tapered);
      check(in_space(bent, bends), false);
      check(in_space(bends, curved({0, 0, 2, 0, 0}, K)), false);
      check(in_space(curved({0, 0, 0, 1, 0, 1}, K), bent), false);
      check_slopes(in_space(bent, bends));
    }
  check(in_space(curved({2, 1, 1, 0, 0}, curvature({1, -2, 3})), flexarm_test::beam({2, 2, 1, 0, 0}, 2)), false, {},
        3.0);
}

TEST_CASE("a curved beam without modes is a bent rigid body") {
  const Beam rigid = curved({}, curvature({1, -2, 3}, {2, 2, -3})),
             elastic = curved({1, 1, 1, 0, 0}, rigid.options().curvature);
  check(in_space(rigid, flexarm_test::beam({2, 1, 1, 0, 0}, 2)), false);
  check(in_plane({0, 0, 1}, curved({}, curvature({0, 0, 3})), flexarm_test::beam({2, 0, 0, 0, 0}, 2)), true);
  check(in_plane({0, 0, 1}, rigid, flexarm_test::beam({2, 0, 0, 0, 0}, 2)), false);
  const Arm one = in_space(rigid, rigid), other = in_space(elastic, elastic);
  const Eigen::VectorXd q = Eigen::Vector2d(0.3, -0.8);
  Eigen::VectorXd still = Eigen::VectorXd::Zero(other.nq());
  still[0] = q[0];
  still[other.first_q(1)] = q[1];
  const oracle::Pose a = oracle::Oracle(one).pose(1, nullptr, q), b = oracle::Oracle(other).pose(1, nullptr, still);
  CHECK((a.p - b.p).norm() < 1e-11);
  CHECK((a.R - b.R).norm() < 1e-11);
}

TEST_CASE("curvatures that cannot be are named") {
  BeamOptions o;
  o.modes = {1, 0, 0, 0, 0};
  o.curvature = curvature({0, 0, 3});
  const Section section = Section::rectangle(0.006, 0.01);
  CHECK_THROWS_AS(Beam(0.5, section, flexarm_test::steel(), o), std::invalid_argument);  // order 2
  o.order = kExact;
  CHECK_NOTHROW(Beam(0.5, section, flexarm_test::steel(), o));
  o.curvature = curvature({0, 0, 1.01 / 0.003});
  CHECK_THROWS_AS(Beam(0.05, section, flexarm_test::steel(), o), std::invalid_argument);
  o.curvature = curvature({0, 0, 0.99 / 0.003});
  CHECK_NOTHROW(Beam(0.05, section, flexarm_test::steel(), o));
  o.curvature = curvature({0, std::nan(""), 1});
  CHECK_THROWS_AS(Beam(0.5, section, flexarm_test::steel(), o), std::invalid_argument);
}

}  // namespace

}  // namespace test_curvature
