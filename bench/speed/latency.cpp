// Latency of one step of 1 ms of a control loop that never sleeps: the 7-link flexible arm, driven at its joints.
//   cmake --preset release && cmake --build --preset release && build/release/bench_latency [steps]
// Prints CSV on stdout: for each scene and clock (the wall's, and the thread's own, which others on the processor do
// not disturb) quantiles in microseconds, and a histogram; of the thread's clock also the median of the steps that took
// so many iterations, and how many these were: the work of a step, which nothing else on the machine changes.
// bench/speed/latency.py draws it.
#include <time.h>

#include <cmath>
#include <cstdio>
#include <string>

#include "common.hpp"
#include "flexarm/step.hpp"

using namespace flexarm;

namespace {

double now(clockid_t clock) {
  timespec t;
  clock_gettime(clock, &t);
  return 1e6 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_nsec);
}

void print(const char* scene, const char* clock, std::vector<double> us) {
  std::sort(us.begin(), us.end());
  const auto quantile = [&](double p) {
    return us[static_cast<std::size_t>(p * static_cast<double>(us.size() - 1) + 0.5)];
  };
  for (double p : {0.0, 0.5, 0.9, 0.99, 0.999, 0.9999, 1.0})
    std::printf("\"%s\",%s,quantile,%.6g,%.5g\n", scene, clock, p, quantile(p));
  constexpr double kRatio = 1.05;  // of a bin's edges
  std::size_t at = 0;
  for (double edge = us.front() * kRatio; at < us.size(); edge *= kRatio) {
    std::size_t count = 0;
    while (at < us.size() && us[at] <= edge) ++at, ++count;
    if (count > 0) std::printf("\"%s\",%s,bin,%.6g,%zu\n", scene, clock, edge, count);
  }
}

/// The links of `chain` on hinges with springs and dampers, as motors with a stiff loop of their own have them.
Arm held(flexarm::StrainCounts modes) {
  const JointForce motor{20.0, 0.0, 2.0};
  std::vector<Link> links;
  const Arm from = chain(7, modes, 2);
  for (std::size_t n = 0; n < from.size(); ++n) {
    const Eigen::Vector3d axis = n % 2 ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitZ();
    const Link& link = from.link(n);
    links.emplace_back(Joint({{true, axis}}, false, {"angle"}, {motor}), link.hub(), link.beam(), std::nullopt);
  }
  return Arm(std::move(links));
}

void run(const char* scene, const Arm& arm, int steps) {
  constexpr double h = 1e-3;
  Workspace ws(arm);
  ImplicitOptions options;
  options.spectral_radius = 0.9;
  ImplicitStep step(arm, h, options);
  Eigen::VectorXd q = arm.zero(), v = Eigen::VectorXd::Zero(arm.nv()), tau = v;
  std::vector<double> wall, own;
  std::vector<std::vector<double>> by_iterations;
  wall.reserve(static_cast<std::size_t>(steps));
  own.reserve(static_cast<std::size_t>(steps));
  for (int k = -100; k < steps; ++k) {  // the first hundred warm up
    for (std::size_t n = 0; n < arm.size(); ++n)
      tau[arm.first(n)] = 0.5 * std::sin(3.0 * h * k + static_cast<double>(n));
    const double before = now(CLOCK_THREAD_CPUTIME_ID), start = now(CLOCK_MONOTONIC);
    const Status status = step(ws, q, v, tau);
    const double end = now(CLOCK_MONOTONIC), after = now(CLOCK_THREAD_CPUTIME_ID);
    if (status != Status::ok) throw std::runtime_error("step " + std::to_string(k) + " failed");
    if (k < 0) continue;
    wall.push_back(end - start);
    own.push_back(after - before);
    const std::size_t iterations = static_cast<std::size_t>(step.iterations());
    if (by_iterations.size() <= iterations) by_iterations.resize(iterations + 1);
    by_iterations[iterations].push_back(own.back());
  }
  print(scene, "wall", std::move(wall));
  print(scene, "thread", std::move(own));
  for (std::size_t n = 0; n < by_iterations.size(); ++n) {
    if (by_iterations[n].empty()) continue;
    std::printf("\"%s\",thread,steps,%zu,%zu\n", scene, n, by_iterations[n].size());
    std::printf("\"%s\",thread,median,%zu,%.5g\n", scene, n, median(by_iterations[n]));
  }
}

}  // namespace

int main(int argc, char** argv) {
  const int steps = argc > 1 ? std::stoi(argv[1]) : 100000;
  std::printf("scene,clock,kind,at,value\n");
  run("7 links of 3 + 3 + 1 modes", held({3, 3, 1, 0, 0}), steps);
  run("rigid, 7 links", held({}), steps);
}
