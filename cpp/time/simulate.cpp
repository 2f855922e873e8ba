#include "flexarm/simulate.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "events.hpp"
#include "flexarm/check.hpp"
#include "flexarm/quadrature.hpp"
#include "friction.hpp"

namespace flexarm {

namespace {

constexpr double kSameTime = 1e-6;  // parts of a step by which two times are still one
constexpr double kMostSteps = 1e10;
constexpr double kResolved = 1e-6;   // parts of a motion's velocity that a step may miss
constexpr double kSlow = 1e-3;       // parts of a motion's largest speed: what is slower counts as that fast
constexpr double kInBetween = 1e-4;  // the same, at its samples
constexpr int kLooks = 5;            // halvings of a step that does not see the motion; then it is taken to jump
constexpr int kLooksInside = 8;      // places of an interpolated step at which events are looked at
constexpr int kSplits = 8;           // halvings of a step whose equations cannot be solved

void check_step(double step, const Eigen::VectorXd& t) {
  positive("step", step);
  const double span = t[t.size() - 1] - t[0];
  if (step > span) bad_value("step", step, "must be at most the time simulated, " + std::to_string(span) + " s");
  if (span / step > kMostSteps) bad_value("step", step, "is too small: it would take more than 1e10 steps");
}

std::string reason(Status status, double h, const Step& method, const System& s) {
  std::ostringstream text;
  switch (status) {
    case Status::not_converged:
      text << "the equations of a step of " << h << " s could not be solved: take a smaller step";
      break;
    case Status::not_finite:
      text << "the motion ran away in steps of " << h << " s";
      if (const std::string who = s.arm.farthest_out(s.q, s.v); !who.empty()) text << "; " << who << " and grows";
      text << ": " << method.remedy();
      break;
    default:
      text << "the mass matrix is singular";
  }
  return text.str();
}

/// Times that steps end at, each once: the samples and the output times (the last alone, if `inside` tells the rest).
std::vector<double> stops(const std::vector<double>& samples, const Eigen::VectorXd& t, double step,
                          bool interpolates) {
  std::vector<double> out;
  std::size_t next = 0;
  double last = t[0];
  for (Eigen::Index k = interpolates ? t.size() - 1 : 1; k < t.size(); ++k) {
    for (; next < samples.size() && samples[next] < t[k]; ++next) {
      if (samples[next] < last + kSameTime * step || samples[next] > t[k] - kSameTime * step) continue;
      last = samples[next];
      out.push_back(last);
    }
    last = t[k];
    out.push_back(last);
  }
  return out;
}

/// Whether the Gauss points of a step see a prescribed motion for what it is: what they make of its acceleration and
/// velocity is its change of velocity and place, and at its samples in between (some of them, if they are many) its
/// velocity is the polynomial through theirs. A motion whose samples lie closer than the steps is looked at so, instead
/// of stopping at each.
/// @param speeds  of each motion, as its samples tell: what is far below is no motion
bool resolved(const std::vector<Drive>& drives, const std::vector<double>& speeds, double from, double h) {
  static const GaussRule rule(4);
  constexpr int kNodes = 6, kSamples = 8;
  const double x[kNodes] = {0.0, rule.points[0], rule.points[1], rule.points[2], rule.points[3], 1.0};
  for (std::size_t n = 0; n < drives.size(); ++n) {
    const Drive& d = drives[n];
    if (!d.motion) continue;
    MotionValue at[kNodes];
    double speed = 0.0, turn = 0.0, size = kSlow * speeds[n];
    for (int i = 0; i < kNodes; ++i) {
      at[i] = d.motion(from + h * x[i]);
      size = std::max({size, std::abs(at[i].v), h * std::abs(at[i].a)});
      if (i == 0 || i + 1 == kNodes) continue;
      speed += h * rule.weights[i - 1] * at[i].a;
      turn += h * rule.weights[i - 1] * at[i].v;
    }
    const double missed =
        std::max(std::abs(at[kNodes - 1].v - at[0].v - speed), std::abs(at[kNodes - 1].q - at[0].q - turn) / h);
    if (!(missed <= kResolved * size + 1e-12 * std::abs(at[0].q) / h)) return false;
    const double *begin = d.breaks.data(), *end = begin + d.breaks.size();
    const double *first = std::upper_bound(begin, end, from), *last = std::lower_bound(first, end, from + h);
    for (int k = 0; k < kSamples && last > first; ++k) {
      const double t = first[(last - first) * (2 * k + 1) / (2 * kSamples)];
      double through = 0.0;
      for (int i = 0; i < kNodes; ++i) {
        double lagrange = at[i].v;
        for (int j = 0; j < kNodes; ++j)
          if (j != i) lagrange *= ((t - from) / h - x[j]) / (x[i] - x[j]);
        through += lagrange;
      }
      if (!(std::abs(through - d.motion(t).v) <= kInBetween * size)) return false;
    }
  }
  return true;
}

/// Largest speed of each motion, from some of its samples and of the output times.
std::vector<double> speeds(const std::vector<Drive>& drives, const Eigen::VectorXd& t) {
  std::vector<double> out;
  for (const Drive& d : drives) {
    double largest = 0.0;
    for (const Eigen::VectorXd* times : {&d.breaks, &t})
      for (Eigen::Index k = 0; d.motion && k < times->size(); k += 1 + times->size() / 500)
        largest = std::max(largest, std::abs(d.motion((*times)[k]).v));
    out.push_back(largest);
  }
  return out;
}

/// Writes the row of results that has just been recorded, of the last entry.
void write_row(const System& s, const Step* inside, double c, double t, Tape& tape) {
  write_row(s, inside, static_cast<Eigen::Index>(tape.entries.size()) - 1, c, t, tape);
}

/// Records the output times inside the step of h from `from`, and leaves the state as it was.
bool record_inside(System& s, const Step& method, double from, double h, Trajectory& out, const Eigen::VectorXd& t,
                   bool composite, const std::function<void()>& look, Tape* tape) {
  const Eigen::VectorXd q = s.q, v = s.v;
  bool good = true;
  for (; good && out.done + 1 < t.size() &&
         (t[out.done] < out.reached || (out.terminated && t[out.done] == out.reached));) {
    const double at = t[out.done];
    look();
    method.inside((at - from) / h, s.q, s.v);
    s.drive(at);
    good = s.record(out, composite);
    if (tape && good) write_row(s, &method, (at - from) / h, at, *tape);
  }
  s.q = q;
  s.v = v;
  s.drive(out.reached);  // the forces of the end again, which the row of the last output time has
  return good;
}

/// Looks for events at several places of a step, as it may hold more than one zero, and leaves the state at its end.
void look_inside(System& s, const Step& method, double from, double h, Trajectory& out, StepEvents& seen) {
  const Eigen::VectorXd q = s.q, v = s.v;
  const double end = out.reached;
  for (int k = 1; k < kLooksInside && !out.terminated; ++k) {
    const double c = static_cast<double>(k) / kLooksInside;
    method.inside(c, s.q, s.v);
    s.drive(from + c * h);
    seen.look(from + c * h);
  }
  s.q = q;
  s.v = v;
  s.drive(end);
  if (!out.terminated) seen.look(end);
}

/// A run, or one part of it between two switches of dry friction.
Trajectory simulate_smooth(const Problem& problem, const Eigen::VectorXd& t, Step& method, double step, bool composite,
                           const Alive& alive, Control& control, Tape* tape) {
  const auto started = std::chrono::steady_clock::now();
  const Step::Counts before = method.counts();
  const std::vector<Drive>& drives = problem.drives;
  const std::vector<Event>& events = problem.events;
  System s(problem, control);
  s.rubbing = method.rubbing();
  Trajectory out = empty_trajectory(*problem.arm, t, events);
  out.rubs = s.rubbing != nullptr;
  s.q = problem.q0;
  s.v = problem.v0;
  s.drive(t[0]);
  s.sample(t[0] + kSameTime * step);
  if (!s.record(out, composite)) return out;

  struct {
    System& system;
    double from, h, last;  // of the step; `last`: the next stop when the step ends there, so that it is met exactly
  } now{s, t[0], step, std::nan("")};
  const Step::Given given = [&now](double c) {
    now.system.drive(c == 1.0 && !std::isnan(now.last) ? now.last : now.from + c * now.h);
  };
  bool functions = false;
  const std::vector<double> motion_speeds = method.interpolates() ? speeds(drives, t) : std::vector<double>{};
  std::vector<Drive> sampled;  // whose samples steps must end at
  for (const Drive& d : drives)
    if (!d.motion || !method.interpolates()) sampled.push_back(d);
  const std::function<void()> look = [&] {
    if (alive && !alive(out.reached)) throw Interrupted();
  };
  method.look_with(look);
  method.record(tape);
  const struct Forget {
    Step& method;
    ~Forget() {
      method.look_with({});
      method.record(nullptr);
    }
  } forget{method};
  if (tape) {
    tape->now = t[0];
    write_row(s, nullptr, 1.0, t[0], *tape);
  }
  Status status = method.start(s.ws, s.q, s.v, s.tau);
  StepEvents seen(s, events, out, tape, method.interpolates() ? &method : nullptr);
  seen.start(t[0]);
  bool going = true;
  for (const double stop :
       stops(sample_times(sampled, problem.loads, control, t, functions), t, step, method.interpolates())) {
    const double start = out.reached;
    const long count = std::max(1L, static_cast<long>(std::ceil((stop - start) / step - kSameTime)));
    // One step, or, where its equations cannot be solved, two of half its length, and so on. (Not of the implicit
    // method: an iteration that fails on modes too fast for the step, and loud, may find a solution that is none.)
    const auto advance = [&](const auto& again, double from, double h, double last, int level) -> Status {
      now.from = from;
      now.h = h;
      now.last = last;
      if (tape) tape->now = from;
      const bool visible = !method.interpolates() || level >= kLooks || resolved(drives, motion_speeds, from, h);
      const Status found = visible ? method.advance(h, s.ws, s.q, s.v, s.tau, given) : Status::not_converged;
      if (found == Status::ok) {
        out.reached = std::isnan(last) ? from + h : last;
        ++out.stats.steps;
        if (!method.interpolates()) {
          seen.look(out.reached);
          return found;
        }
        if (!events.empty()) look_inside(s, method, from, h, out, seen);
        return record_inside(s, method, from, h, out, t, composite, look, tape) ? found : Status::not_finite;
      }
      if (found != Status::not_converged || level == kSplits || !method.interpolates()) return found;
      ++out.stats.failed_steps;
      s.drive(from);
      const Status half = again(again, from, 0.5 * h, std::nan(""), level + 1);
      return half == Status::ok && !out.terminated ? again(again, from + 0.5 * h, 0.5 * h, last, level + 1) : half;
    };
    const double step_now = (stop - start) / static_cast<double>(count);
    for (long k = 0; k < count && status == Status::ok && going && !out.terminated; ++k) {
      const double from = start + static_cast<double>(k) * step_now;
      try {
        status = advance(advance, from, step_now, k + 1 == count ? stop : std::nan(""), 0);
      } catch (const Interrupted&) {
        going = false;
        break;
      }
      if (status != Status::ok) break;
      going = !alive || alive(out.reached);
    }
    if (status != Status::ok) out.failure = reason(status, now.h, method, s);
    if (!going && (out.reached < t[t.size() - 1] || t[out.done] < out.reached)) out.failure = kInterrupted;
    if ((!out.failure.empty() || out.terminated) && out.reached != stop) break;
    try {
      if (s.sample(stop + kSameTime * step)) status = method.jump(s.ws, s.q, s.v, s.tau);
    } catch (const Interrupted&) {
      out.failure = kInterrupted;
    }
    while (out.done < t.size() && t[out.done] <= stop && out.failure.empty())
      if (!s.record(out, composite))
        out.failure = reason(Status::not_finite, now.h, method, s);
      else if (tape)
        write_row(s, nullptr, 1.0, stop, *tape);
    if (status != Status::ok) out.failure = reason(status, now.h, method, s);
    if (!out.failure.empty() || out.terminated) break;
  }
  const Step::Counts& after = method.counts();
  out.stats.residuals = after.evaluations - before.evaluations;
  out.stats.jacobians = after.factorisations - before.factorisations;
  out.stats.newton_iterations = after.iterations - before.iterations;
  out.stats.switches = after.switches - before.switches;
  out.stats.wall_time = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  return out;
}

}  // namespace

Trajectory simulate_fixed(const Problem& problem, const Eigen::VectorXd& t, Step& method, double step, bool composite,
                          const Alive& alive, Tape* tape) {
  problem.check();
  check_times(t);
  check_step(step, t);
  Control control = problem.control();
  if (method.rubbing() || rubs(*problem.arm).empty())
    return simulate_smooth(problem, t, method, step, composite, alive, control, tape);
  const SmoothPart part = [&](const Problem& of, const Eigen::VectorXd& times, const std::vector<Parameter>&) {
    const double left = times[times.size() - 1] - times[0];  // it may be shorter than a step
    return simulate_smooth(of, times, method, std::min(step, left), composite, alive, control, tape);
  };
  return simulate_with_friction(problem, t, part, control, composite, step, {});
}

}  // namespace flexarm
