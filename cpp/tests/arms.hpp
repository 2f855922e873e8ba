// Arms for the tests.
#pragma once

#include "flexarm/arm.hpp"

namespace flexarm_test {

inline flexarm::Material steel() { return {7850.0, 209e9, 0.3}; }

inline flexarm::Beam beam(flexarm::StrainCounts modes, int order, double damping_ratio = 0.0,
                          flexarm::Basis basis = flexarm::Basis::legendre) {
  flexarm::BeamOptions o;
  o.damping_ratio = damping_ratio;
  o.modes = modes;
  o.order = order;
  o.basis = basis;
  return {0.5, flexarm::Section::rectangle(0.004, 0.01), steel(), o};
}

inline flexarm::RigidBody body(double mass, const Eigen::Vector3d& end) {
  flexarm::RigidBody b;
  b.mass = mass;
  b.com = {0.01, 0.02, -0.01};
  b.inertia = mass * Eigen::Vector3d(1e-3, 2e-3, 1.5e-3).asDiagonal();
  b.end = end;
  return b;
}

/// Three links in space with every strain.
inline flexarm::Arm spatial_arm(int order = 2) {
  using flexarm::Joint;
  std::vector<flexarm::Link> links;
  links.emplace_back(Joint::prismatic({1, 0, 0}), body(1.0, {0.1, 0.05, 0}), std::nullopt, std::nullopt);
  links.emplace_back(Joint::revolute({0, 0.6, 0.8}), body(0.5, {0.075, 0, 0}), beam({2, 2, 1, 1, 1}, order),
                     body(0.2, {0.04, 0, 0.01}));
  links.emplace_back(Joint::revolute({0, 1, 0}), std::nullopt, beam({2, 1, 1, 0, 0}, order), body(0.1, {0.02, 0, 0}));
  return flexarm::Arm(std::move(links), {0, 0, -9.81});
}

/// Two flexible links, the first floating, joined by a ball with damping.
inline flexarm::Arm floating_arm() {
  using flexarm::Joint;
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX(), y = Eigen::Vector3d::UnitY(), z = Eigen::Vector3d::UnitZ();
  const Joint free({{false, x}, {false, y}, {false, z}}, true, {"x", "y", "z", "wx", "wy", "wz"});
  const flexarm::JointForce damper{0.0, 0.0, 0.1};
  flexarm::Placement seat;
  seat.position = {0.1, 0.2, 0.3};
  const Joint ball({}, true, {"wx", "wy", "wz"}, {damper, damper, damper}, seat);
  std::vector<flexarm::Link> links;
  links.emplace_back(free, body(1.0, {0.1, 0.05, 0}), beam({2, 2, 1, 1, 1}, 2), body(0.2, {0.04, 0, 0.01}));
  links.emplace_back(ball, std::nullopt, beam({2, 1, 1, 0, 0}, flexarm::kExact), body(0.1, {0.02, 0, 0}));
  return flexarm::Arm(std::move(links), {0, 0, -9.81});
}

/// A hub that carries two branches, one of which forks again, at its end and at slices of its beam; and a branch on the
/// world. The children of a link are not all consecutive.
inline flexarm::Arm tree_arm(int order = 2) {
  using flexarm::Joint;
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX(), y = Eigen::Vector3d::UnitY(), z = Eigen::Vector3d::UnitZ();
  flexarm::Placement seat;
  seat.position = {0.05, -0.1, 0.02};
  seat.rotation = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 2) / 3.0).toRotationMatrix();
  const flexarm::JointForce spring{2.0, 0.1, 0.2};
  std::vector<flexarm::Link> links;
  links.emplace_back(Joint::prismatic(x), body(1.0, {0.1, 0.05, 0}), std::nullopt, std::nullopt);
  links.emplace_back(Joint::revolute(z), body(0.5, {0.1, 0, 0}), beam({2, 1, 1, 0, 0}, order),
                     body(0.2, {0.04, 0, 0.01}));
  links.emplace_back(Joint({{true, y}}, false, {"b"}, {spring}, seat), std::nullopt, beam({1, 1, 0, 0, 0}, order),
                     body(0.1, {0.02, 0, 0}));
  links.emplace_back(Joint({{true, y}, {true, x}}, false, {"c", "d"}), body(0.3, {0.1, 0, 0}), std::nullopt,
                     std::nullopt);
  links.emplace_back(Joint({{true, x}}, false, {"e"}, {}, seat), body(0.3, {0.1, 0, 0}), beam({2, 0, 0, 0, 0}, order),
                     std::nullopt);
  links.emplace_back(Joint::fixed(), body(0.2, {0.1, 0, 0}), beam({0, 1, 1, 0, 0}, order), body(0.1, {0.02, 0, 0}));
  links.emplace_back(Joint({{true, y}}, false, {"h"}, {spring}), body(0.2, {0.1, 0, 0}), std::nullopt, std::nullopt);
  links.emplace_back(Joint({{true, x}}, false, {"i"}, {}, seat), std::nullopt, beam({1, 0, 1, 0, 0}, order),
                     body(0.1, {0.02, 0, 0}));
  links.emplace_back(Joint::prismatic(z), body(0.1, {0.1, 0, 0}), std::nullopt, std::nullopt);
  links.emplace_back(Joint({{true, z}}, false, {"g"}, {}, seat), std::nullopt, beam({2, 0, 0, 0, 0}, order),
                     body(0.1, {0.02, 0, 0}));
  return flexarm::Arm(std::move(links), {1.0, 2.0, -9.81}, {-1, 0, 0, 1, 2, 1, {1, 0.3}, {1, 0.15}, {7, 0.4}, -1});
}

/// The same in the plane: beams that bend about z, hinges about z.
inline flexarm::Arm flat_tree(int order = 2) {
  using flexarm::Joint;
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX(), z = Eigen::Vector3d::UnitZ();
  std::vector<flexarm::Link> links;
  links.emplace_back(Joint::revolute(z), body(0.5, {0.1, 0, 0}), beam({2, 0, 0, 0, 0}, order), body(0.2, {0.04, 0, 0}));
  links.emplace_back(Joint::revolute(z), std::nullopt, beam({2, 0, 0, 0, 0}, order), body(0.1, {0.02, 0, 0}));
  links.emplace_back(Joint::revolute(z), body(0.3, {0.1, 0, 0}), std::nullopt, std::nullopt);
  links.emplace_back(Joint::prismatic(x), body(0.3, {0.1, 0, 0}), std::nullopt, std::nullopt);
  links.emplace_back(Joint::revolute(z), body(0.2, {0.1, 0, 0}), std::nullopt, std::nullopt);
  links.emplace_back(Joint::revolute(z), std::nullopt, beam({1, 0, 0, 0, 0}, order), body(0.1, {0.02, 0, 0}));
  links.emplace_back(Joint::prismatic(x), body(0.1, {0.1, 0, 0}), std::nullopt, std::nullopt);
  links.emplace_back(Joint::revolute(-z), body(0.3, {0.1, 0, 0}), beam({1, 0, 0, 0, 0}, order), std::nullopt);
  return flexarm::Arm(std::move(links), {1.0, 2.0, -9.81}, {-1, 0, 0, 1, {0, 0.2}, {1, 0.35}, {0, 0.2}, 0});
}

/// An arm with struts from the world to its ends, a rope over all its links that is taut, and one that is slack.
inline flexarm::Arm tied(const flexarm::Arm& arm) {
  using P = flexarm::Strut::Point;
  const int last = static_cast<int>(arm.size()) - 1;
  const auto slice = [&](int n, double part, const Eigen::Vector3d& offset) {
    const auto& beam = arm.link(static_cast<std::size_t>(n)).beam();
    return beam ? P{n, P::slice, part * beam->length(), offset} : P{n, P::origin, 0.0, offset};
  };
  flexarm::Strut jack{
      {{-1, P::end, 0.0, {0.3, -0.8, 0.5}}, {last, P::end, 0.0, {0.02, 0.03, 0.01}}}, 30.0, 2.0, 0.4, 5.0};
  flexarm::Strut spring{{slice(0, 0.4, {0.0, 0.02, 0.01}), slice(last, 0.7, {0.01, -0.02, 0.0})}, 20.0, 1.0, 3.0, 0.0};
  flexarm::Strut rope{{{-1, P::end, 0.0, {-0.5, 0.4, 0.1}}}, 50.0, 3.0, 0.2, -1.0, true}, loose = rope;
  for (int n = 0; n <= last; ++n) {
    rope.points.push_back(slice(n, 0.3, {0.0, 0.03, 0.02}));
    rope.points.push_back({n, P::end, 0.0, {0.0, 0.02, 0.01}});
  }
  loose.points = {slice(last, 0.2, {0, 0, 0}), {-1, P::end, 0.0, {0.1, 0.2, 0.1}}};
  loose.length = 50.0;
  loose.force = 0.0;
  return flexarm::Arm(arm.links(), arm.gravity(), arm.seats(), {jack, spring, rope, loose});
}

/// Small reproducible numbers.
inline Eigen::VectorXd wave(int n, double phase, double size = 0.05) {
  Eigen::VectorXd x(n);
  for (int i = 0; i < n; ++i) x[i] = size * std::sin(1.7 * i + phase);
  return x;
}

/// The same, `joints` at joints and `size` at the coordinates of beams.
inline Eigen::VectorXd wave_of(const flexarm::Arm& arm, double phase, double joints, double size) {
  Eigen::VectorXd x = wave(arm.nv(), phase, size);
  for (std::size_t k = 0; k < arm.size(); ++k) x.segment(arm.first(k), arm.link(k).nj()) *= joints / size;
  return x;
}

}  // namespace flexarm_test
