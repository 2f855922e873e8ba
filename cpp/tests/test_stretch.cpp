// Beams that stretch, in the kernels, at every order.
#include <doctest/doctest.h>

#include "kernels.hpp"

namespace test_stretch {
using namespace flexarm;
using flexarm_test::beam;
using flexarm_test::check;
using flexarm_test::check_slopes;
using flexarm_test::flat;

namespace {

/// A beam of which no two sections are alike, so that slices are not at the points of the strains.
Beam tapered(StrainCounts modes, int order) {
  BeamOptions o;
  o.modes = modes;
  o.order = order;
  o.basis = Basis::legendre;
  const SectionProfile section{[](double x) { return Section::rectangle(0.004 - 0.003 * x, 0.01); }, {}};
  return {0.5, section, flexarm_test::steel(), o};
}

Arm arm_of(const Beam& first, const Beam& second) {
  std::vector<Link> links;
  links.emplace_back(Joint::revolute({0, 0.6, 0.8}), flexarm_test::body(0.5, {0.075, 0.01, -0.02}), first,
                     flexarm_test::body(0.2, {0.04, 0, 0.01}));
  links.emplace_back(Joint::revolute({0, 1, 0}), std::nullopt, second, std::nullopt);
  return Arm(std::move(links), {1.0, 2.0, -9.81});
}

TEST_CASE("beams that stretch, alone or with every other strain") {
  for (int order : {1, 2, 3, kExact}) {
    CAPTURE(order);
    const bool planar = order > 2;
    for (double damping : {0.0, 0.02}) {
      check(flat({0, 0, 1}, {2, 0, 0, 0, 0, 2}, order, damping), planar);
      check(flat({0, 1, 0}, {0, 2, 0, 0, 1, 1}, order, damping), planar);
      check(flat({0, 0, 1}, {2, 0, 0, 2, 0, 3}, order, damping), planar);
    }
    check(flat({0, 0, 1}, {0, 0, 0, 0, 0, 2}, order), false);
    check(flat({0, 0, 1}, {0, 0, 1, 0, 1, 2}, order), false);
    for (const StrainCounts& modes : {StrainCounts{2, 2, 1, 1, 1, 2}, StrainCounts{3, 1, 0, 0, 0, 1}}) {
      check(arm_of(beam(modes, order), beam({1, 0, 0, 1, 0, 2}, order)), false);
      check(arm_of(tapered(modes, order), beam({2, 0, 0, 0, 0}, 2)), false);
    }
    std::vector<bool> given(14, false);
    given[6] = true;
    check(flat({0, 0, 1}, {2, 0, 1, 0, 1, 1}, order), false, given);
  }
}

TEST_CASE("beams that stretch, at order 0") {
  check(arm_of(beam({2, 2, 1, 1, 1, 2}, 0), beam({1, 0, 0, 0, 0, 2}, 0)), false, {}, 0.003);
  check(flat({0, 0, 1}, {2, 0, 0, 1, 0, 2}, 0, 0.01), false, {}, 0.003);
}

TEST_CASE("beams that stretch, twisted and bent by many turns") {
  BeamOptions o;
  o.basis = Basis::legendre;
  for (int order : {2, 3, kExact})
    for (double turned : {1.0, 3.3, 9.4, 30.0}) {
      if (flexarm_test::kSanitized && turned != 3.3) continue;
      CAPTURE(order);
      CAPTURE(turned);
      o.order = order;
      o.gauss_points = 40 + static_cast<int>(4 * turned);
      const auto make = [&](StrainCounts modes) {
        o.modes = modes;
        return Beam(0.5, Section::rectangle(0.006, 0.01), flexarm_test::steel(), o);
      };
      const Beam straight = beam({1, 0, 0, 0, 0}, 2);
      check(arm_of(make({2, 0, 0, 1, 0, 1}), straight), false, {}, turned);
      if (order < kExact || turned < 5.0) check(arm_of(make({2, 1, 1, 1, 1, 1}), straight), false, {}, turned);
    }
}

TEST_CASE("derivatives of beams that stretch") {
  for (int order : {0, 1, 2, 3, kExact})
    for (double bent : {1e-4, 0.3}) {
      CAPTURE(order);
      CAPTURE(bent);
      check_slopes(flat({0, 0, 1}, {2, 0, 0, 1, 0, 2}, order, 0.01), bent);
      check_slopes(arm_of(beam({2, 1, 1, 0, 1, 2}, order), beam({1, 0, 0, 0, 0, 1}, order)), bent);
    }
}

}  // namespace

}  // namespace test_stretch
