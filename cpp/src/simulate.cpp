#include "flexarm/simulate.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "flexarm/check.hpp"
#include "system.hpp"

namespace flexarm {

namespace {

constexpr double kSame = 1e-6;  // parts of a step by which two times are still one
constexpr double kMostSteps = 1e10;
constexpr int kSplits = 8;  // halvings of a step whose equations cannot be solved

void check_step(double step, const Eigen::VectorXd& t) {
  positive("step", step);
  const double span = t[t.size() - 1] - t[0];
  if (step > span) bad_value("step", step, "must be at most the time simulated, " + std::to_string(span) + " s");
  if (span / step > kMostSteps) bad_value("step", step, "is too small: it would take more than 1e10 steps");
}

std::string reason(Status status, double h) {
  std::ostringstream text;
  switch (status) {
    case Status::not_converged:
      text << "the equations of a step of " << h << " s could not be solved: take a smaller step";
      break;
    case Status::not_finite:
      text << "the motion ran away in steps of " << h
           << " s: take a smaller step (rk4 is stable below 2.83 over the highest frequency), or an implicit method";
      break;
    default:
      text << "the mass matrix is singular";
  }
  return text.str();
}

/// Times that steps end at, each once: the samples and the output times (the last alone, if `inside` tells the rest);
/// true: an output time.
std::vector<std::pair<double, bool>> stops(const std::vector<double>& samples, const Eigen::VectorXd& t, double step,
                                           bool interpolates) {
  std::vector<std::pair<double, bool>> out;
  std::size_t next = 0;
  double last = t[0];
  for (Eigen::Index k = interpolates ? t.size() - 1 : 1; k < t.size(); ++k) {
    for (; next < samples.size() && samples[next] < t[k]; ++next) {
      if (samples[next] < last + kSame * step || samples[next] > t[k] - kSame * step) continue;
      last = samples[next];
      out.emplace_back(last, false);
    }
    last = t[k];
    out.emplace_back(last, true);
  }
  return out;
}

/// Records the output times inside the step of h from `from`, and leaves the state as it was.
bool record_inside(System& s, const Step& method, double from, double h, Trajectory& out, const Eigen::VectorXd& t,
                   bool composite) {
  const Eigen::VectorXd q = s.q, v = s.v;
  bool good = true;
  for (; good && out.done + 1 < t.size() && t[out.done] <= out.reached;) {
    const double at = t[out.done];
    method.inside((at - from) / h, s.q, s.v);
    s.drive(at);
    good = s.record(out, composite);
  }
  s.q = q;
  s.v = v;
  return good;
}

}  // namespace

Trajectory simulate_fixed(const Arm& arm, const std::vector<Drive>& drives, const Eigen::VectorXd& t,
                          const Eigen::VectorXd& q0, const Eigen::VectorXd& v0, const Eigen::VectorXd& tau,
                          Step& method, double step, bool composite, const Alive& alive,
                          const std::vector<LoadDrive>& loads) {
  check_arguments(arm, drives, t, q0, v0, tau);
  check_step(step, t);
  const auto started = std::chrono::steady_clock::now();
  const Step::Counts before = method.counts();
  System s(arm, drives, loads, tau);
  Trajectory out = empty_trajectory(arm, t);
  s.q = q0;
  s.v = v0;
  s.drive(t[0]);
  if (!s.record(out, composite)) return out;

  struct {
    System& system;
    double from, h, last;  // of the step; `last`: the next stop when the step ends there, so that it is met exactly
  } now{s, t[0], step, std::nan("")};
  const Step::Given given = [&now](double c) {
    now.system.drive(c == 1.0 && !std::isnan(now.last) ? now.last : now.from + c * now.h);
  };
  bool functions = false;
  s.drive(t[0]);  // `record` put the reactions into tau
  Status status = method.start(s.ws, s.q, s.v, s.tau);
  bool going = true;
  for (const auto& [stop, is_output] :
       stops(sample_times(drives, loads, t, functions), t, step, method.interpolates())) {
    const double start = out.reached;
    const long count = std::max(1L, static_cast<long>(std::ceil((stop - start) / step * (1.0 - kSame))));
    // One step, or, where its equations cannot be solved, two of half its length, and so on.
    const auto advance = [&](const auto& again, double from, double h, double last, int level) -> Status {
      now.from = from;
      now.h = h;
      now.last = last;
      const Status found = method.advance(h, s.ws, s.q, s.v, s.tau, given);
      if (found == Status::ok) {
        out.reached = std::isnan(last) ? from + h : last;
        ++out.stats.steps;
        return !method.interpolates() || record_inside(s, method, from, h, out, t, composite) ? found
                                                                                              : Status::not_finite;
      }
      if (found != Status::not_converged || level == kSplits) return found;
      ++out.stats.failed_steps;
      s.drive(from);
      const Status half = again(again, from, 0.5 * h, std::nan(""), level + 1);
      return half == Status::ok ? again(again, from + 0.5 * h, 0.5 * h, last, level + 1) : half;
    };
    const double step_now = (stop - start) / static_cast<double>(count);
    for (long k = 0; k < count && status == Status::ok && going; ++k) {
      const double from = start + static_cast<double>(k) * step_now;
      status = advance(advance, from, step_now, k + 1 == count ? stop : std::nan(""), 0);
      if (status != Status::ok) break;
      going = !alive || alive(out.reached);
    }
    if (status != Status::ok) out.failure = reason(status, now.h);
    if (!going && out.reached < t[t.size() - 1]) out.failure = kInterrupted;
    if (!out.failure.empty() && out.reached != stop) break;
    if (is_output && !s.record(out, composite)) out.failure = reason(Status::not_finite, now.h);
    if (!out.failure.empty()) break;
  }
  const Step::Counts& after = method.counts();
  out.stats.residuals = after.evaluations - before.evaluations;
  out.stats.jacobians = after.factorisations - before.factorisations;
  out.stats.newton_iterations = after.iterations - before.iterations;
  out.stats.wall_time = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  return out;
}

}  // namespace flexarm
