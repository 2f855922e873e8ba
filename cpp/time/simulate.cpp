#include "flexarm/simulate.hpp"

#include <chrono>

#include "events.hpp"
#include "flexarm/check.hpp"
#include "setup/single.hpp"
#include "stepper.hpp"

namespace flexarm {

namespace {

constexpr double kTooMany = 1e10;

void check_step(double step, const Eigen::VectorXd& t) {
  positive("step", step);
  const double span = t[t.size() - 1] - t[0];
  if (step > span) bad_value("step", step, "must be at most the time simulated, " + std::to_string(span) + " s");
  if (span / step > kTooMany) bad_value("step", step, "is too small: it would take more than 1e10 steps");
}

/// Writes the row of results that has just been recorded, of the last entry.
void write_row(const System& s, const Step* inside, double c, double t, Tape& tape) {
  write_row(s, inside, static_cast<Eigen::Index>(tape.entries.size()) - 1, c, t, tape);
}

/// Records the output times inside the step of h from `from`, and leaves the state as it was.
bool record_inside(System& s, const Step& method, double from, double h, Trajectory& out, const Eigen::VectorXd& t,
                   const std::function<void()>& look, Tape* tape) {
  const Eigen::VectorXd q = s.q, v = s.v;
  bool good = true;
  for (; good && out.done + 1 < t.size() &&
         (t[out.done] < out.reached || (out.terminated && t[out.done] == out.reached));) {
    const double at = t[out.done];
    look();
    method.inside((at - from) / h, s.q, s.v);
    s.drive(at);
    const bool closes = tape && s.ws.chain().layout().rigid_rows > 0;
    const Eigen::VectorXd open_q = closes ? s.q : Eigen::VectorXd(), open_v = closes ? s.v : open_q;
    s.close_loops(h);
    good = s.record(out);
    if (tape && good) write_row(s, &method, (at - from) / h, at, *tape);
    if (closes && good) tape->closings.push_back({tape->points() - 1, 0.0, h * h, {s.q - open_q, s.v - open_v}});
  }
  s.drive(out.reached, q, v);  // the forces of the end again, which the row of the last output time has
  return good;
}

}  // namespace

Trajectory simulate_fixed(const Problem& problem, const Eigen::VectorXd& t, Step& method, double step,
                          const Alive& alive, Tape* tape) {
  problem.check();
  check_times(t);
  if (!method.chooses()) check_step(step, t);
  Control control = problem.control();
  const auto started = std::chrono::steady_clock::now();
  const Step::Counts before = method.counts();
  Stepper way(problem, control, method, step, t);
  System& s = way.s;
  Trajectory out = empty_trajectory(*problem.arm, t, problem.events);
  out.rubs = s.rubbing != nullptr;
  way.record(tape);
  way.begin();
  if (!s.record(out)) return out;
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
  Status status = way.start();
  StepEvents seen(s, problem.events, out, tape, method.interpolates() ? &method : nullptr);
  seen.start(t[0]);
  bool going = true;
  const auto after = [&](double from, double h) {
    out.reached = way.reached;
    seen.look_through(from, h);
    const bool good = !method.interpolates() || record_inside(s, method, from, h, out, t, look, tape);
    way.enough = out.terminated;
    return good ? Status::ok : Status::not_finite;
  };
  const auto each = [&] { return going = !alive || alive(out.reached); };
  const double end = t[t.size() - 1];
  const bool steps_over = method.interpolates() && !(method.chooses() && problem.asks_functions());
  while (status == Status::ok && out.reached < end) {
    const double stop = way.next_stop(steps_over ? end : t[out.done]);
    try {
      status = way.advance(stop, after, each);
    } catch (const Interrupted&) {
      going = false;
    }
    if (status != Status::ok) out.failure = way.reason(status);
    if (!going && (out.reached < end || t[out.done] < out.reached)) out.failure = kInterrupted;
    if ((!out.failure.empty() || out.terminated) && out.reached != stop) break;
    try {
      status = way.sample();
    } catch (const Interrupted&) {
      out.failure = kInterrupted;
    }
    while (out.done < t.size() && t[out.done] <= stop && out.failure.empty())
      if (!s.record(out))
        out.failure = way.reason(status = Status::not_finite);
      else if (tape)
        write_row(s, nullptr, 1.0, stop, *tape);
    if (status != Status::ok) out.failure = way.reason(status);
    if (!out.failure.empty() || out.terminated) break;
  }
  if (status != Status::ok && out.failure.empty()) out.failure = way.reason(status);
  out.status = status;
  const Step::Counts& counts = method.counts();
  out.stats.steps = way.steps;
  out.stats.failed_steps = way.halved + counts.divided - before.divided;
  out.stats.doubt = counts.doubt;
  out.stats.residuals = counts.evaluations - before.evaluations;
  out.stats.jacobians = counts.factorisations - before.factorisations;
  out.stats.newton_iterations = counts.iterations - before.iterations;
  out.stats.switches = counts.switches - before.switches + way.switches;
  out.stats.hasty = way.hasty;
  out.stats.wall_time = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  return out;
}

}  // namespace flexarm
