// What the C++ benchmarks share.
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <stdexcept>
#include <utility>
#include <vector>

#include "flexarm/ab.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/derivatives.hpp"

namespace flexarm {

/// A chain of equal links with hinges along z and y in turn, or along z alone, with gravity in that plane.
inline Arm chain(int links, flexarm::StrainCounts modes, int order, bool planar = false,
                 Basis basis = Basis::clamped_free) {
  BeamOptions o;
  o.modes = modes;
  o.order = order;
  o.basis = basis;
  std::optional<Beam> beam;
  if (*std::max_element(modes.begin(), modes.end()) > 0)
    beam.emplace(0.5, Section::rectangle(0.004, 0.01), Material(7850, 209e9, 0.3), o);
  std::vector<Link> parts;
  for (int k = 0; k < links; ++k) {
    RigidBody hub;
    hub.mass = 0.3;
    hub.inertia = Eigen::Vector3d(1e-4, 2e-4, 2e-4).asDiagonal();
    hub.end = {0.075, 0, 0};
    const Joint joint = Joint::revolute(k % 2 && !planar ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitZ());
    parts.emplace_back(joint, hub, beam, std::nullopt);
  }
  return Arm(std::move(parts), planar ? Eigen::Vector3d(0, -9.81, 0) : Eigen::Vector3d(0, 0, -9.81));
}

inline double median(std::vector<double> x) {
  std::nth_element(x.begin(), x.begin() + static_cast<long>(x.size() / 2), x.end());
  return x[x.size() / 2];
}

template <class F>
double microseconds(const F& f, int repeat) {
  const auto start = std::chrono::steady_clock::now();
  for (int k = 0; k < repeat; ++k) f();
  return std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start).count() / repeat;
}

/// The same in CPU time, which others on the machine disturb less.
template <class F>
double cpu_microseconds(const F& f, int repeat) {
  const std::clock_t start = std::clock();
  for (int k = 0; k < repeat; ++k) f();
  return 1e6 / CLOCKS_PER_SEC * static_cast<double>(std::clock() - start) / repeat;
}

inline void must(Status status) {
  if (status != Status::ok) throw std::runtime_error("a step failed");
}

/// Coordinates and rates of an arm in some motion, which bends beams by parts of a millimetre.
inline std::pair<Eigen::VectorXd, Eigen::VectorXd> some_motion(const Arm& arm) {
  std::pair<Eigen::VectorXd, Eigen::VectorXd> out{arm.nv(), arm.nv()};
  for (int i = 0; i < arm.nv(); ++i) {
    out.first[i] = 0.001 * std::sin(1.7 * i + 1.0);
    out.second[i] = 0.01 * std::cos(2.3 * i);
  }
  return out;
}

}  // namespace flexarm
