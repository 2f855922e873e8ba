// Latency of one step of 1 ms of a control loop that never sleeps: the 7-link flexible arm, driven at its joints.
//   cmake --preset release && cmake --build --preset release && build/release/bench_latency [steps]
// Prints CSV on stdout: for each scene and clock (the wall's, and the thread's own, which others on the processor do
// not disturb) quantiles in microseconds, and a histogram. bench/speed/latency.py draws it.
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
  wall.reserve(static_cast<std::size_t>(steps));
  own.reserve(static_cast<std::size_t>(steps));
  long iterations = 0, of_one = 0;
  int most = 0;
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
    iterations += step.iterations();
    of_one += step.iterations() == 1;
    most = std::max(most, step.iterations());
  }
  print(scene, "wall", std::move(wall));
  print(scene, "thread", std::move(own));
  std::printf("# %s: %d coordinates, %d steps, %.2f iterations a step: one in %.0f %% of them, at most %d\n", scene,
              arm.nv(), steps, static_cast<double>(iterations) / steps, 100.0 * static_cast<double>(of_one) / steps,
              most);
}

}  // namespace

int main(int argc, char** argv) {
  const int steps = argc > 1 ? std::stoi(argv[1]) : 100000;
  std::printf("scene,clock,kind,at,value\n");
  run("7 links of 3 + 3 + 1 modes", held({3, 3, 1, 0, 0}), steps);
  run("rigid, 7 links", held({}), steps);
}
