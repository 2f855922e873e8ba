#include "flexarm/ida.hpp"

#include <algorithm>
#include <chrono>
#include <sstream>
#include <utility>

#include "events.hpp"
#include "flexarm/check.hpp"
#include "flexarm/dry_friction.hpp"
#include "friction.hpp"
#include "ida_linear.hpp"
#include "ida_tangents.hpp"
#include "loops_told.hpp"

namespace flexarm {

namespace {

constexpr int kLook = 200;          // most steps between two calls of `alive`
constexpr long kSlow = 20000;       // steps after which somebody is told
constexpr double kLookTime = 0.02;  // s: about the longest time between them
constexpr int kFollow = 1000;       // times in a run at which events are looked at where nothing is integrated
constexpr double kAnyForce = 1e20;  // an absolute tolerance (N, N m)
constexpr double kOneTime = 1e-13;  // parts of the time by which two zeros of one event are still one

int residual(sunrealtype t, N_Vector y, N_Vector yp, N_Vector r, void* data) {
  return IdaSystem::answer(data, [&](IdaSystem& s) {
    s.set(t, N_VGetArrayPointer(y), N_VGetArrayPointer(yp));
    return s.residual(N_VGetArrayPointer(yp), N_VGetArrayPointer(r)) ? 0 : 1;  // 1: IDA tries a smaller step
  });
}

int event_values(sunrealtype t, N_Vector y, N_Vector, sunrealtype* values, void* data) {
  return IdaSystem::answer(data, [&](IdaSystem& s) {
    s.set(t, N_VGetArrayPointer(y), nullptr);
    s.evaluate(*s.events, t, values);
    return 0;
  });
}

#if SUNDIALS_VERSION_MAJOR < 7
void keep_message(int, const char*, const char*, char* text, void* data) {
  static_cast<IdaSystem*>(data)->message = text;
}
#endif

/// Owns the objects of SUNDIALS.
struct Solver {
  SUNContext context = nullptr;
  N_Vector y = nullptr, yp = nullptr, special = nullptr;
  std::optional<LinearPart> linear;
  std::optional<TangentPart> tangents;
  void* memory = nullptr;

  Solver(IdaSystem& s, const IdaOptions& o, double t0, const Eigen::VectorXd& y0, const Eigen::VectorXd& yp0,
         double t_end) {
    const sunindextype n = y0.size();
#if SUNDIALS_VERSION_MAJOR < 7
    check_flag(SUNContext_Create(nullptr, &context));
#else
    check_flag(SUNContext_Create(SUN_COMM_NULL, &context));
    SUNContext_ClearErrHandlers(context);
#endif
    y = N_VNew_Serial(n, context);
    yp = N_VNew_Serial(n, context);
    memory = s.memory = IDACreate(context);
    if (!y || !yp || !memory) throw std::bad_alloc();
    Eigen::Map<Eigen::VectorXd>(N_VGetArrayPointer(y), n) = y0;
    Eigen::Map<Eigen::VectorXd>(N_VGetArrayPointer(yp), n) = yp0;
    check_flag(IDASetUserData(memory, &s));
#if SUNDIALS_VERSION_MAJOR < 7
    check_flag(IDASetErrHandlerFn(memory, keep_message, &s));
#endif
    s.message.reserve(500);  // no step allocates
    check_flag(IDAInit(memory, residual, t0, y, yp));
    if (s.n_loops() == 0) {
      check_flag(IDASStolerances(memory, o.rtol, o.atol));
    } else {
      tell_loops(s, o);
    }
    linear.emplace().attach(memory, s, y, context);
    check_flag(IDASetMaxOrd(memory, o.max_order));
    check_flag(IDASetStopTime(memory, t_end));
  }
  ~Solver() {
    if (memory) IDAFree(&memory);
    linear.reset();
    tangents.reset();
    if (special) N_VDestroy(special);
    if (yp) N_VDestroy(yp);
    if (y) N_VDestroy(y);
    if (context) SUNContext_Free(&context);
  }
  /// Forces of loops have no error of their own, and in short steps more rounding than any tolerance allows. Nor are
  /// elastic rates tested: those of stiff strains follow these forces, and leap where the length of a step changes.
  void tell_loops(const IdaSystem& s, const IdaOptions& o) {
    special = N_VClone(y);
    if (!special) throw std::bad_alloc();
    double* forces = N_VGetArrayPointer(special) + s.size() - 2 * s.n_loops();
    N_VConst(o.atol, special);
    std::fill_n(forces, 2 * s.n_loops(), kAnyForce);
    check_flag(IDASVtolerances(memory, o.rtol, special));
    N_VConst(1.0, special);
    std::fill_n(forces, 2 * s.n_loops(), 0.0);
    for (int k = 0; k < s.n_v(); ++k)
      if (s.yielding[s.ws.free[k]] < 1.0) N_VGetArrayPointer(special)[s.n_q() + k] = 0.0;
    check_flag(IDASetId(memory, special));
    check_flag(IDASetSuppressAlg(memory, SUNTRUE));
  }
  Solver(const Solver&) = delete;
  Solver& operator=(const Solver&) = delete;
};

std::string reason(int flag, const IdaSystem& s) {
  switch (flag) {
    case IDA_ILL_INPUT:
      return "the first step came out as zero: forces or tolerances are too extreme";
    case IDA_TOO_MUCH_ACC:
      return "the tolerances are too small for double precision";
    case IDA_ERR_FAIL:
      return "the error test failed too often: the solution changes faster than any step can follow";
    case IDA_CONV_FAIL:
    case IDA_REP_RES_ERR:
      return "the equations could not be solved at the smallest step: the solution may diverge";
    case IDA_LSETUP_FAIL:
    case IDA_LSOLVE_FAIL:
      return "the Jacobian became singular";
    default:
      return s.message.empty() ? "IDA stopped with flag " + std::to_string(flag) : s.message;
  }
}

void check_options(const IdaOptions& o) {
  positive("rtol", o.rtol);
  if (o.rtol < 1e-14) bad_value("rtol", o.rtol, "must be at least 1e-14: double precision has no more");
  positive("atol", o.atol);
  if (o.max_order < 1 || o.max_order > 5) bad_value("max_order", o.max_order, "must be from 1 to 5");
}

/// The time behind `reached` that no step may pass over, or a driven arm at rest would sleep through a pulse: a sample
/// of drives, loads and controllers, or, where one of these is a function, an output time.
double stop_time(const System& s, double reached, const Eigen::VectorXd& t, bool functions) {
  const double from = reached + kOneTime * std::abs(reached), end = t[t.size() - 1];
  const double next = next_sample(s.drives, s.loads, s.control, std::nextafter(from, end));
  return std::min(next, functions ? *std::upper_bound(t.begin(), t.end() - 1, from) : end);
}

/// Finds events from now on.
void watch(void* memory, const std::vector<Event>& events) {
  if (events.empty()) return;
  std::vector<int> directions;
  for (const Event& e : events) directions.push_back(e.direction);
  check_flag(IDARootInit(memory, static_cast<int>(events.size()), event_values));
  check_flag(IDASetRootDirection(memory, directions.data()));
  check_flag(IDASetNoInactiveRootWarn(memory));
}

/// Watches how the steps get on.
class Watch {
 public:
  Watch(double t0, double span) : since_(t0), least_(kLook * 1e-12 * span) {}

  /// Steps until the next look around, by the time that the last ones took (s).
  int next(long steps, double took) const {
    return static_cast<int>(
        std::clamp(static_cast<double>(steps) * kLookTime / std::max(took, 1e-9), 1.0, 1.0 * kLook));
  }

  /// After some steps, of which the last ended at t: why there is no point in going on, or nothing.
  std::string judge(long steps, double t) {
    steps_ += steps;
    if (steps_ < kLook) return {};
    const double gained = t - std::exchange(since_, t);
    steps_ = 0;
    if (gained < least_) return "the step size fell below 1e-12 of the time asked for: the solution changes too fast";
    return {};
  }

 private:
  double since_, least_;
  long steps_ = 0;
};

/// Logs the events that IDA has found at time t.
void occurred(const Solver& solver, IdaSystem& s, double t, std::vector<int>& found, Trajectory& out) {
  IDAGetRootInfo(solver.memory, found.data());
  s.set(t, N_VGetArrayPointer(solver.y), nullptr);
  normalise(s.arm, s.q);
  for (std::size_t k = 0; k < found.size(); ++k)
    if (found[k] != 0 && (out.events[k].t.empty() || t - out.events[k].t.back() > kOneTime * std::abs(t)))
      s.log(*s.events, k, t, out);
}

/// Keeps the tangents of events that have just been logged. The solver's are those of this time; prescribed
/// rates have their own at any.
void differentiate(IdaSystem& s, Trajectory& out) {
  if (!s.tangents) return;
  for (EventLog& log : out.events)
    for (std::size_t k = log.a.size(); k < log.t.size(); ++k) {
      s.drive(log.t[k], log.q[k], log.v[k]);
      if (s.accelerate() == Status::ok) s.a = s.ws.a;
      out.ends = empty_trajectory(s.arm, Eigen::VectorXd::Constant(1, log.t[k]), {}, out.tangents.size()).tangents;
      s.tangents->record(log.t[k], out.ends, 0);
      log.a.push_back(s.a);
      log.q_by.emplace_back(s.arm.nq(), s.tangents->size());
      log.v_by.emplace_back(s.arm.nv(), s.tangents->size());
      for (std::size_t p = 0; p < out.ends.size(); ++p) {
        log.q_by.back().col(static_cast<Eigen::Index>(p)) = out.ends[p].q.row(0);
        log.v_by.back().col(static_cast<Eigen::Index>(p)) = out.ends[p].v.row(0);
      }
    }
  s.driven = std::nan("");
}

/// Adds the solver's counts since it began, or began anew.
void count_work(void* memory, const IdaSystem& s, SimulationStats& stats) {
  const auto count = [memory](int (*get)(void*, long*), long& sum) {
    long n = 0;
    get(memory, &n);
    sum += n;
  };
  count(IDAGetNumSteps, stats.steps);
  count(IDAGetNumResEvals, stats.residuals);
  count(IDAGetNumNonlinSolvIters, stats.newton_iterations);
  count(IDAGetNumErrTestFails, stats.failed_steps);
  if (s.dense) {
    count(IDAGetNumJacEvals, stats.jacobians);
  } else {
    count(IDAGetNumPrecEvals, stats.jacobians);
    count(IDAGetNumLinIters, stats.linear_iterations);
    count(IDAGetNumJtimesEvals, stats.residuals);
  }
}

/// Runs the sampled controllers that are due up to time t, those of the parameters' neighbours, too.
/// @return whether a force has jumped
bool sample_all(IdaSystem& s, double t) {
  const bool near = s.tangents && s.tangents->sample(t);
  return s.sample(t) || near;
}

/// Runs the sampled controllers that are due at time t; where a force jumps, the solver begins anew, and events that
/// jump with it over zero are logged.
/// @return whether it has jumped
bool sample(Solver& solver, IdaSystem& s, double t, Trajectory& out) {
  const double about = t + kOneTime * std::abs(t);
  if (!s.control.due(about)) return false;
  s.driven = std::nan("");
  s.set(t, N_VGetArrayPointer(solver.y), N_VGetArrayPointer(solver.yp));
  const std::vector<Event>& events = *s.events;
  std::vector<double> before(events.size()), after(events.size());
  s.evaluate(events, t, before.data());
  if (s.tangents) solver.tangents->get(solver.memory, s);
  if (!sample_all(s, about) || forward_dynamics(s.arm, s.ws, s.q, s.v, s.tau) != Status::ok) return false;
  s.a = s.ws.a;
  const auto [y, yp] = s.state();
  Eigen::Map<Eigen::VectorXd>(N_VGetArrayPointer(solver.y), y.size()) = y;
  Eigen::Map<Eigen::VectorXd>(N_VGetArrayPointer(solver.yp), y.size()) = yp;
  count_work(solver.memory, s, out.stats);
  check_flag(IDAReInit(solver.memory, t, solver.y, solver.yp));
  if (s.tangents) {
    s.tangents->linearise(t);
    if (!s.tangents->accelerate()) return false;
    solver.tangents->restart(solver.memory, s);
  }
  s.evaluate(events, t, after.data());
  for (std::size_t k = 0; k < events.size(); ++k)
    if (crosses(before[k], after[k], events[k].direction)) s.log(events, k, t, out);
  differentiate(s, out);
  return true;
}

/// The linear solver asked for; the chain's is the faster one from a single link on (bench/speed/scaling.py).
void choose_solver(IdaSystem& s, LinearSolver wanted) {
  if (wanted == LinearSolver::dense || !s.rows.empty())
    s.dense.emplace(s.arm, places(s.loads));
  else
    s.chain.emplace(s.arm, s.ws.prescribed, s.control);
}

/// Adds a row, and those of the tangents.
bool record(IdaSystem& s, double t, Trajectory& out) {
  if (!s.record(out)) return false;
  if (!s.tangents || s.tangents->record(t, out.tangents, out.done - 1)) return true;
  --out.done;
  out.failure = "the derivatives by parameters are no longer finite numbers";
  return false;
}

/// Everything is prescribed: nothing to integrate. Events are looked at at the samples of drives, the output times,
/// and in between where a drive is a function.
void follow(IdaSystem& s, const Eigen::VectorXd& t, const std::vector<Event>& events, const Alive& alive,
            Trajectory& out) {
  StepEvents seen(s, events, out);
  seen.start(t[0]);
  const double span = t[t.size() - 1] - t[0];
  int looked = 0;
  const auto next_look = [&](double until) {
    double next = std::min(until, next_sample(s.drives, s.loads, s.control, std::nextafter(out.reached, until)));
    const auto grid = [&] { return events.empty() ? until : t[0] + span * looked / kFollow; };
    while (grid() <= out.reached) ++looked;
    return std::min(next, grid());
  };
  for (Eigen::Index k = 1; k < t.size(); ++k) {
    for (double next; (next = next_look(t[k])) < t[k];) {
      s.drive(next);
      if (seen.look(next)) return;
      out.reached = next;
      sample_all(s, next);
    }
    s.drive(t[k]);
    if (seen.look(t[k]) && out.reached < t[k]) return;
    sample_all(s, t[k]);
    out.reached = t[k];
    if (!record(s, t[k], out) || out.terminated) return;
    if (alive && !alive(t[k]) && out.done < t.size()) {
      out.failure = kInterrupted;
      return;
    }
  }
}

double seconds_since(std::chrono::steady_clock::time_point clock) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - clock).count();
}

/// From the state in `solver` to the last of t, or until something stops it.
void integrate(Solver& solver, IdaSystem& s, const Eigen::VectorXd& t, bool functions, const IdaOptions& options,
               const Alive& alive, Trajectory& out) {
  long steps = 0, told = kSlow;
  std::vector<int> found(s.events->size());
  Watch pace(t[0], t[t.size() - 1] - t[0]);
  int look = 1;
  const bool sticks = s.arm.has_contact_friction();  // then each step counts by itself
  while (out.done < t.size() && out.failure.empty()) {
    const double goal = t[out.done];
    const double stop = stop_time(s, out.reached, t, functions);
    IDASetStopTime(solver.memory, sticks ? std::min(stop, goal) : stop);
    check_flag(IDASetMaxNumSteps(solver.memory, look));
    sunrealtype now = out.reached;
    long before = 0, after = 0;
    IDAGetNumSteps(solver.memory, &before);
    const auto clock = std::chrono::steady_clock::now();
    const int flag = IDASolve(solver.memory, goal, &now, solver.y, solver.yp, sticks ? IDA_ONE_STEP : IDA_NORMAL);
    out.reached = now;
    if (s.thrown) std::rethrow_exception(s.thrown);
    IDAGetNumSteps(solver.memory, &after);
    if (after > before) look = pace.next(after - before, seconds_since(clock));
    const bool going = !alive || alive(now);
    if (flag < 0 && flag != IDA_TOO_MUCH_WORK) {  // that one: time to look around, no more
      out.failure = reason(flag, s);
    } else if (!s.within_reach(N_VGetArrayPointer(solver.y))) {
      s.set(now, N_VGetArrayPointer(solver.y), nullptr);
      out.failure = "the motion ran away: " + s.arm.farthest_out(s.q, s.v) + " and grows: look for what drives it";
    } else if (flag >= 0) {
      if (sticks) s.remember(now, N_VGetArrayPointer(solver.y));
      if (flag == IDA_ROOT_RETURN) occurred(solver, s, now, found, out);
      if (flag == IDA_ROOT_RETURN && s.tangents) {
        solver.tangents->get(solver.memory, s);
        differentiate(s, out);
      }
      const bool jumped = !out.terminated && sample(solver, s, now, out);
      // a zero at an output time would be found again and again if that were asked for once more
      if (now >= goal - (flag == IDA_ROOT_RETURN || jumped ? kOneTime * (std::abs(goal) + goal - t[0]) : 0.0)) {
        s.set(goal, N_VGetArrayPointer(solver.y), nullptr);
        if (s.tangents && !jumped) solver.tangents->get(solver.memory, s);
        sunrealtype last = 0.0;
        IDAGetLastStep(solver.memory, &last);
        if (!s.loops_closed(options.rtol)) {
          out.failure = "loops whose equations depended on others at the start are open: take another integrator";
          break;
        }
        s.close_loops(last);
        record(s, goal, out);
      }
    }
    if (out.done == t.size() || !out.failure.empty()) break;
    if (!going) out.failure = kInterrupted;
    if (!going || out.terminated) break;
    steps += after - before;
    if (steps >= told && options.slow) {
      options.slow(now, steps);
      told = 2 * steps;
    }
    out.failure = pace.judge(after - before, now);
  }
}

/// Of a run that failed at the system's state, after a step of h: the failure is that of loops, if it is.
void blame_loops(const IdaSystem& s, const Problem& problem, double h, Trajectory& out) {
  const std::string why = told_of_loops(s, problem.q0, out.reached, h);
  if (!why.empty()) out.failure = why;
}

/// A run, or one part of it between two switches of dry friction.
Trajectory simulate_smooth(const Problem& problem, const Eigen::VectorXd& t, const IdaOptions& options,
                           const Alive& alive, Control& control, const std::vector<Parameter>& parameters) {
  const std::vector<Event>& events = problem.events;
  const auto started = std::chrono::steady_clock::now();
  IdaSystem s(problem, control);
  s.events = &events;
  Trajectory out = empty_trajectory(*problem.arm, t, events, parameters.size());
  if (!parameters.empty()) s.tangents.emplace(s, parameters);
  s.drive(t[0], problem.q0, problem.v0);
  s.System::remember();
  sample_all(s, t[0]);
  if (!record(s, t[0], out)) return out;
  if (s.size() == 0) {
    follow(s, t, events, alive, out);
    if (!out.failure.empty() && out.failure != kInterrupted) blame_loops(s, problem, t[1] - t[0], out);
    differentiate(s, out);
    return out;
  }

  s.choose_rows();
  choose_solver(s, options.linear_solver);
  const auto [y0, yp0] = s.state();
  Solver solver(s, options, t[0], y0, yp0, t[t.size() - 1]);
  if (s.tangents) solver.tangents.emplace().attach(solver.memory, s, solver.y, solver.context, options, parameters);
  watch(solver.memory, events);
  try {
    integrate(solver, s, t, problem.asks_functions(), options, alive, out);
  } catch (const Interrupted&) {
    out.failure = kInterrupted;
  }
  if (!out.failure.empty() && out.failure != kInterrupted) {
    s.set(out.reached, N_VGetArrayPointer(solver.y), nullptr);
    double last = 0.0;
    IDAGetLastStep(solver.memory, &last);
    blame_loops(s, problem, last, out);
  }
  count_work(solver.memory, s, out.stats);
  out.stats.wall_time = seconds_since(started);
  return out;
}

}  // namespace

Trajectory simulate_ida(const Problem& problem, const Eigen::VectorXd& t, const IdaOptions& options, const Alive& alive,
                        const std::vector<Parameter>& parameters) {
  problem.check();
  check_times(t);
  check_options(options);
  Control control = problem.control();
  const SmoothPart part = [&](const Problem& of, const Eigen::VectorXd& times, const std::vector<Parameter>& by) {
    return simulate_smooth(of, times, options, alive, control, by);
  };
  if (!parameters.empty()) refuse_contact_friction(*problem.arm, "the derivatives of a run");
  if (!parameters.empty()) refuse_loops(*problem.arm, "the derivatives of a run");
  if (rubs(*problem.arm).empty()) return part(problem, t, parameters);
  const std::string beside = "\"ida\", beside dry friction of joints (which \"gauss\" and \"implicit\" run),";
  refuse_contact_friction(*problem.arm, beside);
  refuse_loops(*problem.arm, beside);
  return simulate_with_friction(problem, t, part, control, parameters);
}

}  // namespace flexarm
