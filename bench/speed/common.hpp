// What the C++ benchmarks share.
#pragma once

#include <algorithm>
#include <chrono>
#include <ctime>
#include <stdexcept>
#include <vector>

#include "flexarm/ab.hpp"

namespace flexarm {

/// A chain of equal links with hinges along z and y in turn.
inline Arm chain(int links, std::array<int, 5> modes, int order) {
  BeamOptions o;
  o.modes = modes;
  o.order = order;
  std::optional<Beam> beam;
  if (*std::max_element(modes.begin(), modes.end()) > 0)
    beam.emplace(0.5, Section::rectangle(0.004, 0.01), Material(7850, 209e9, 0.3), o);
  std::vector<Link> parts;
  for (int k = 0; k < links; ++k) {
    RigidBody hub;
    hub.mass = 0.3;
    hub.inertia = Eigen::Vector3d(1e-4, 2e-4, 2e-4).asDiagonal();
    hub.end = {0.075, 0, 0};
    const Joint joint = Joint::revolute(k % 2 ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitZ());
    parts.emplace_back(joint, hub, beam, std::nullopt);
  }
  return Arm(std::move(parts), {0, 0, -9.81});
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

}  // namespace flexarm
