// Time of one evaluation of AB and CI, of one step of IDA with either linear solver, and of one implicit step, against
// the number of links; a CSV table on stdout, which bench/speed/scaling.py draws.
//   cmake --preset release && cmake --build --preset release && build/release/bench_scaling
// Medians of several rounds, all algorithms in turn, so that ratios hold on a noisy machine. The chain falls from rest.
#include <cmath>
#include <cstdio>
#include <optional>
#include <string>
#ifdef __GLIBC__
#include <malloc.h>
#endif

#include "common.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/ida.hpp"
#include "flexarm/step.hpp"

using namespace flexarm;

namespace {

constexpr double kLongest = 0.5;  // s: an algorithm whose one evaluation or run took longer is not asked again
constexpr double kSpan = 0.004;   // s, of IDA's runs: about fifty steps

/// Time per step of a run (us), and its counts.
double ida_step(const Arm& arm, LinearSolver solver, SimulationStats& stats) {
  const Eigen::VectorXd t = Eigen::VectorXd::LinSpaced(2, 0.0, kSpan);
  Problem problem(arm);
  problem.v0[0] = 1.0;
  IdaOptions options;
  options.linear_solver = solver;
  const Trajectory r = simulate_ida(problem, t, options);
  if (!r.failure.empty()) throw std::runtime_error(r.failure);
  stats = r.stats;
  return 1e6 * stats.wall_time / static_cast<double>(stats.steps);
}

struct Column {
  std::vector<double> rounds;
  bool too_long = false;
  std::string text() const {
    if (rounds.empty()) return "";
    char out[32];
    std::snprintf(out, sizeof out, "%.4g", median(rounds));
    return out;
  }
};

void row(const char* kind, int links, const flexarm::StrainCounts& modes, Column& ab, Column& ci, Column& dense,
         Column& chained, Column& implicit) {
  const Arm arm = chain(links, modes, 2);
  Workspace ws(arm);
  Eigen::VectorXd q(arm.nv()), v(arm.nv());
  const Eigen::VectorXd tau = Eigen::VectorXd::Zero(arm.nv());
  for (int i = 0; i < arm.nv(); ++i) {
    q[i] = 0.001 * std::sin(1.7 * i);
    v[i] = 0.01 * std::cos(2.3 * i);
  }
  Eigen::VectorXd qi = arm.zero(), vi = tau;
  ImplicitStep step(arm, 1e-3);
  Workspace wi(arm);
  must(step(wi, qi, vi, tau));
  SimulationStats dense_stats, chain_stats;
  for (Column* c : {&ab, &ci, &dense, &chained, &implicit}) c->rounds.clear();
  const int repeat = std::max(1, 400 / links);
  for (int round = 0; round < 5; ++round) {
    ab.rounds.push_back(microseconds([&] { must(forward_dynamics_ab(arm, ws, q, v, tau)); }, repeat));
    implicit.rounds.push_back(microseconds([&] { must(step(wi, qi, vi, tau)); }, std::max(1, repeat / 4)));
    if (!ci.too_long) {
      ci.rounds.push_back(
          microseconds([&] { must(forward_dynamics_ci(arm, ws, q, v, tau)); }, repeat > 20 ? repeat : 1));
      ci.too_long = ci.rounds.back() > 1e6 * kLongest;
    }
    if (round == 0 || chain_stats.wall_time < kLongest)
      chained.rounds.push_back(ida_step(arm, LinearSolver::chain, chain_stats));
    if (!dense.too_long) {
      dense.rounds.push_back(ida_step(arm, LinearSolver::dense, dense_stats));
      dense.too_long = dense_stats.wall_time > kLongest;
    }
  }
  std::printf("%s,%d,%d,%s,%s,%s,%s,%s,%ld,%ld\n", kind, links, arm.nv(), ab.text().c_str(), ci.text().c_str(),
              dense.text().c_str(), chained.text().c_str(), implicit.text().c_str(), dense_stats.steps,
              chain_stats.steps);
  std::fflush(stdout);
}

/// AB on 1000 links as one arm, and as 20 arms of 50 in turn, which is as much memory but no longer chain (us).
void apart(const char* kind, const flexarm::StrainCounts& modes) {
  std::vector<double> times;
  for (int links : {1000, 50}) {
    std::vector<Arm> arms;
    std::vector<Workspace> workspaces;
    for (int k = 0; k < 1000 / links; ++k) arms.push_back(chain(links, modes, 2));
    for (const Arm& arm : arms) workspaces.emplace_back(arm);
    const Eigen::VectorXd q = Eigen::VectorXd::Constant(arms[0].nv(), 1e-4), tau = Eigen::VectorXd::Zero(q.size());
    std::vector<double> rounds;
    const auto all = [&] {
      for (std::size_t k = 0; k < arms.size(); ++k) must(forward_dynamics_ab(arms[k], workspaces[k], q, q, tau));
    };
    for (int round = 0; round < 15; ++round) rounds.push_back(microseconds(all, 1));
    times.push_back(median(rounds));
  }
  std::printf("# %s, 1000 links: %.4g us as one arm, %.4g us as 20 arms of 50\n", kind, times[0], times[1]);
}

/// Bytes that are allocated now, where the C library tells.
double allocated() {
#if defined(__GLIBC__) && (__GLIBC__ > 2 || __GLIBC_MINOR__ >= 33)
  const struct mallinfo2 m = mallinfo2();
  return static_cast<double>(m.uordblks + m.hblkhd);
#else
  return std::nan("");
#endif
}

/// What it takes to make an arm of 1000 links, and the workspace of AB, inverse dynamics and steps.
void set_up(const char* kind, const flexarm::StrainCounts& modes) {
  const Arm links = chain(1000, modes, 2);
  std::optional<Arm> arm;
  std::optional<Workspace> ws;
  double at = allocated();
  const double arm_us = microseconds([&] { arm.emplace(links.links(), links.gravity()); }, 1);
  const double arm_bytes = allocated() - at;
  at = allocated();
  const double ws_us = microseconds([&] { ws.emplace(*arm); }, 1);
  std::printf("# %s, 1000 links, set-up: %.3g ms and %.3g MB for the arm, %.3g ms and %.3g MB for a workspace\n", kind,
              1e-3 * arm_us, 1e-6 * arm_bytes, 1e-3 * ws_us, 1e-6 * (allocated() - at));
}

}  // namespace

int main() {
  std::printf("kind,links,coordinates,ab_us,ci_us,ida_dense_us,ida_chain_us,implicit_us,dense_steps,chain_steps\n");
  for (const auto& [kind, modes] : {std::pair<const char*, flexarm::StrainCounts>{"rigid", {}},
                                    std::pair<const char*, flexarm::StrainCounts>{"flexible", {2, 2, 1, 0, 0}}}) {
    Column ab, ci, dense, chained, implicit;
    for (int links : {1, 2, 3, 5, 7, 10, 20, 50, 100, 200, 300, 500, 1000})
      row(kind, links, modes, ab, ci, dense, chained, implicit);
    apart(kind, modes);
    set_up(kind, modes);
  }
}
