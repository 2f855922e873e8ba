// Time of one evaluation of forward dynamics (AB, CI) and inverse dynamics, by order and by number of links; and of one
// fixed step.
//   cmake --preset release && cmake --build --preset release && build/release/bench_dynamics
//   build/release/bench_dynamics steps
//   build/release/bench_dynamics derivatives
// Prints a CSV table (order 4 stands for exact); medians of several rounds, all algorithms in turn, so that ratios hold
// on a noisy machine. `steps`: the time per step of a falling chain, and the exponents of its growth with the links.
// `derivatives`: exact Jacobians of inverse dynamics, in times of one inverse dynamics.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <vector>

#include "common.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/derivatives.hpp"
#include "flexarm/step.hpp"

using namespace flexarm;

namespace {

/// Time per step of a chain that falls from rest, stretched out: implicit at 1e-3 s, rk4 at a step that it can follow.
void steps() {
  constexpr double h = 1e-3, h_rk4 = 2e-6;
  std::printf("links,modes,coordinates,implicit_us,iterations,rk4_us,inverse_us,factor_us,solve_us\n");
  const std::array<int, 5> rigid{}, planar{3, 0, 0, 0, 0}, spatial{3, 3, 1, 0, 0};
  for (const auto& modes : {rigid, planar, spatial}) {
    double log_50 = 0.0, ab_50 = 0.0;
    for (int links : {1, 7, 50, 100, 1000}) {
      const Arm arm = chain(links, modes, 2);
      Workspace ws(arm), ws_rk4(arm);
      Eigen::VectorXd q = arm.zero(), v = Eigen::VectorXd::Zero(arm.nv()), x(arm.nv());
      Eigen::VectorXd q_rk4 = q, v_rk4 = v;
      const Eigen::VectorXd tau = v, r = Eigen::VectorXd::Ones(arm.nv());
      ImplicitStep implicit(arm, h);
      Rk4Step rk4(arm, h_rk4);
      must(implicit(ws, q, v, tau));
      const Shift shift{0.5 * h, 0.25 * h * h};
      const int repeat = std::max(1, 200 / links);
      std::vector<double> ti, tr, tid, tf, ts, ab;
      const long before = implicit.counts().iterations;
      for (int round = 0; round < 9; ++round) {
        ti.push_back(microseconds([&] { must(implicit(ws, q, v, tau)); }, repeat));
        tr.push_back(microseconds([&] { must(rk4(ws_rk4, q_rk4, v_rk4, tau)); }, repeat));
        tid.push_back(microseconds([&] { inverse_dynamics<double>(arm, ws, q, v, ws.a); }, repeat));
        tf.push_back(microseconds([&] { must(factor_shifted(arm, ws, q, v, shift)); }, repeat));
        ts.push_back(microseconds([&] { solve_shifted(arm, ws, r, x); }, repeat));
        ab.push_back(microseconds([&] { must(forward_dynamics_ab(arm, ws, q, v, tau)); }, repeat));
      }
      const double iterations = static_cast<double>(implicit.counts().iterations - before) / (9.0 * repeat);
      std::printf("%d,%d+%d+%d,%d,%.3g,%.2f,%.3g,%.3g,%.3g,%.3g\n", links, modes[0], modes[1], modes[2], arm.nv(),
                  median(ti), iterations, median(tr), median(tid), median(tf), median(ts));
      const double now = std::log(median(ti) / iterations);
      if (links == 50) {
        log_50 = now;
        ab_50 = std::log(median(ab));
      }
      if (links == 1000)
        std::printf("# exponent from 50 to 1000 links: one iteration of an implicit step %.3f, AB %.3f\n",
                    (now - log_50) / std::log(20.0), (std::log(median(ab)) - ab_50) / std::log(20.0));
    }
  }
}

void evaluations() {
  std::printf("links,modes,order,coordinates,ab_us,ci_us,inverse_us,ci/ab\n");
  const std::array<int, 5> rigid{}, planar{3, 0, 0, 0, 0}, spatial{3, 3, 1, 0, 0};
  for (const auto& modes : {rigid, planar, spatial})
    for (int order : {0, 1, 2, 3, kExact})
      for (int links : {1, 2, 7, 20, 50}) {
        if (modes == rigid && order != 2) continue;
        const Arm arm = chain(links, modes, order);
        Workspace ws(arm);
        Eigen::VectorXd q(arm.nv()), v(arm.nv()), tau = Eigen::VectorXd::Zero(arm.nv());
        for (int i = 0; i < arm.nv(); ++i) {
          q[i] = 0.001 * std::sin(1.7 * i);
          v[i] = 0.01 * std::cos(2.3 * i);
        }
        if (forward_dynamics_ab(arm, ws, q, v, tau) != Status::ok ||
            forward_dynamics_ci(arm, ws, q, v, tau) != Status::ok)
          throw std::runtime_error("singular mass matrix");
        const int repeat = std::max(1, 2000 / (links * links));
        std::vector<double> ab, ci, id;
        for (int round = 0; round < 9; ++round) {
          ab.push_back(microseconds([&] { forward_dynamics_ab(arm, ws, q, v, tau); }, repeat));
          ci.push_back(microseconds([&] { forward_dynamics_ci(arm, ws, q, v, tau); }, repeat));
          id.push_back(microseconds([&] { inverse_dynamics<double>(arm, ws, q, v, tau); }, repeat));
        }
        std::printf("%d,%d+%d+%d,%d,%d,%.3g,%.3g,%.3g,%.2f\n", links, modes[0], modes[1], modes[2], order, arm.nv(),
                    median(ab), median(ci), median(id), median(ci) / median(ab));
      }
}

void derivatives() {
  std::printf("links,modes,order,coordinates,inverse_us,derivatives_us,derivatives/inverse\n");
  const std::array<int, 5> rigid{}, planar{3, 0, 0, 0, 0}, spatial{2, 2, 2, 0, 0};
  for (const auto& modes : {rigid, planar, spatial})
    for (int order : {0, 1, 2, 3, kExact})
      for (int links : {2, 7}) {
        if (modes == rigid && order != 2) continue;
        const Arm arm = chain(links, modes, order);
        Workspace ws(arm);
        InverseDerivatives jacobians(arm);
        Eigen::VectorXd q(arm.nv()), v(arm.nv()), a = Eigen::VectorXd::Ones(arm.nv());
        for (int i = 0; i < arm.nv(); ++i) {
          q[i] = 0.001 * std::sin(1.7 * i);
          v[i] = 0.01 * std::cos(2.3 * i);
        }
        std::vector<double> id, jd;
        for (int round = 0; round < 9; ++round) {
          id.push_back(cpu_microseconds([&] { inverse_dynamics<double>(arm, ws, q, v, a); }, 200));
          jd.push_back(cpu_microseconds([&] { jacobians(arm, q, v, a); }, 10));
        }
        std::printf("%d,%d+%d+%d,%d,%d,%.3g,%.3g,%.1f\n", links, modes[0], modes[1], modes[2], order, arm.nv(),
                    median(id), median(jd), median(jd) / median(id));
      }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::string(argv[1]) == "steps")
    steps();
  else if (argc > 1 && std::string(argv[1]) == "derivatives")
    derivatives();
  else
    evaluations();
}
