#include "flexarm/simulation.hpp"

#include <limits>

#include "arrays.hpp"
#include "flexarm/check.hpp"
#include "flexarm/collocation.hpp"
#include "stepper.hpp"

namespace flexarm {

std::unique_ptr<Step> Method::on(const Arm& arm, double step) const {
  constexpr DryFriction friction = DryFriction::left_to_caller;  // which Stepper is
  if (name == "gauss") {
    CollocationOptions options;
    options.stages = stages;
    options.tolerance = tolerance;
    if (rtol != 0.0) options.rtol = rtol;
    return std::make_unique<CollocationStep>(arm, options, friction);
  }
  ImplicitOptions options;
  options.spectral_radius = spectral_radius;
  if (rtol != 0.0) options.rtol = rtol;
  return std::make_unique<OneStep>(name, arm, step, options, friction);
}

struct Simulation::Motion {
  static constexpr std::size_t kLogged = 100;  // occurrences of an event, for which there is memory from the start

  /// Inputs that replace the problem's functions; nan: not set.
  struct Inputs {
    std::vector<double> force, reference;
    std::vector<Vec6<double>> load;
  };

  /// The problem, whose functions look at the inputs first.
  static Problem with_inputs(Problem problem, Inputs& in) {
    const double none = std::nan("");
    in.force.assign(problem.drives.size(), none);
    in.reference.assign(problem.feedback.size(), none);
    in.load.assign(problem.loads.size(), Vec6<double>::Constant(none));
    for (std::size_t k = 0; k < problem.drives.size(); ++k)
      if (auto& f = problem.drives[k].force)
        f = [&set = in.force[k], own = f](double t) { return std::isnan(set) ? own(t) : set; };
    for (std::size_t k = 0; k < problem.feedback.size(); ++k) {
      auto& f = problem.feedback[k].reference;
      f = [&set = in.reference[k], own = f](double t) { return !std::isnan(set) ? set : own ? own(t) : 0.0; };
    }
    for (std::size_t k = 0; k < problem.loads.size(); ++k) {
      auto& f = problem.loads[k].wrench;
      f = [&set = in.load[k], own = f](double t) -> Vec6<double> { return std::isnan(set[0]) ? own(t) : set; };
    }
    return problem;
  }

  Inputs in;
  const Problem problem;
  Control control;
  const std::unique_ptr<Step> method;
  const double step;
  Stepper way;
  Trajectory events;  // occurrences; nothing else of it is used
  StepEvents seen;
  Status status = Status::ok;
  double anchor;                        // a time from which steps are counted
  long counted = 0;                     // steps since
  bool known = false, changed = false;  // the outputs; the inputs

  Motion(const Problem& given, const Method& by, double h, double t)
      : problem(with_inputs(given, in)),
        control(problem.control()),
        method(by.on(*problem.arm, h)),
        step(h),
        way(problem, control, *method, h, Eigen::VectorXd::Constant(1, t)),
        seen(way.s, problem.events, events, nullptr, method->interpolates() ? method.get() : nullptr),
        anchor(t) {
    events.events.resize(problem.events.size());
    for (EventLog& log : events.events) {
      log.t.reserve(kLogged);
      log.q.reserve(kLogged, way.s.q.size());
      log.v.reserve(kLogged, way.s.v.size());
    }
    if (!std::isfinite(t)) bad_value("t", t, "must be finite");
    way.begin();
    status = way.start();
    if (status != Status::ok) bad_value("q0, v0", "this start", way.reason(status));
    seen.start(t);
  }

  /// @param one  by one step, of those that are chosen
  Status go(double until, const Alive& alive, bool one = false) {
    known = false;
    events.terminated = false;
    if (changed) {
      changed = false;
      way.s.drive(way.reached);
      status = way.jump();
    } else {
      status = Status::ok;
    }
    bool going = true;
    const auto after = [&](double from, double h) {
      events.reached = way.reached;
      seen.look_through(from, h);
      way.enough = events.terminated;
      return Status::ok;
    };
    const auto each = [&] { return going = !one && (!alive || alive(way.reached)); };
    while (status == Status::ok && going && way.reached < until && !events.terminated) {
      status = way.advance(way.next_stop(until), after, each);
      if (status == Status::ok && !events.terminated) status = way.sample();
    }
    if (events.terminated) end_at_event();
    if (status != Status::ok) way.s.drive(way.reached);
    return status;
  }

  /// The same; where a function of the problem throws, steps go on from there.
  Status go_or_count(double until, const Alive& alive) {
    try {
      return go(until, alive);
    } catch (...) {
      count_from_here();
      throw;
    }
  }

  /// The state is that of the terminal event, from which the next step goes on.
  void end_at_event() {
    for (const EventLog& log : events.events)
      if (!log.t.empty() && log.t.back() == events.reached) {
        way.s.q = log.q.back();
        way.s.v = log.v.back();
      }
    way.reached = events.reached;
    way.s.drive(way.reached);
    remember_contacts(way.s.arm, way.s.ws, way.s.q, way.s.v);
    const Status begun = way.jump();
    if (status == Status::ok) status = begun;
    seen.start(way.reached);
  }

  void look() {
    if (known) return;
    known = way.s.react() == nullptr;
    if (!known) way.s.a.setConstant(std::nan(""));
  }

  /// Other forces act from now on.
  void change() {
    changed = true;
    known = false;
  }

  void count_from_here() {
    anchor = way.reached;
    counted = 0;
  }

  void numbers(const std::function<void(double&)>& f) {
    System& s = way.s;
    f(anchor);
    for (Eigen::VectorXd* x : {&s.q, &s.v, &s.a, &s.constant_tau, &s.ws.a})
      for (double& number : *x) f(number);
    for (std::vector<double>* x : {&in.force, &in.reference, &s.ws.remembered})
      for (double& number : *x) f(number);
    for (Vec6<double>& x : in.load)
      for (double& number : x) f(number);
    f(way.wanted);
    f(way.error);
    double flags[] = {static_cast<double>(counted), changed ? 1.0 : 0.0};
    for (double& number : flags) f(number);
    counted = static_cast<long>(flags[0]);
    changed = flags[1] != 0.0;
    method->memory(f);
  }
};

Simulation::Simulation(const Problem& problem, const Method& method, double step, double t) {
  problem.check();
  if (method.tolerance == 0.0) positive("step", step);
  motion_ = std::make_unique<Motion>(problem, method, step, t);
}
Simulation::Simulation(Simulation&&) noexcept = default;
Simulation::~Simulation() = default;

Status Simulation::step() {
  Motion& m = *motion_;
  if (m.method->chooses()) return m.go(std::numeric_limits<double>::infinity(), {}, true);
  const double until = m.anchor + static_cast<double>(m.counted + 1) * m.step;
  if (m.go_or_count(until, {}) == Status::ok) ++m.counted;
  if (m.events.terminated) m.count_from_here();
  return m.status;
}

Status Simulation::advance(double until, const Alive& alive) {
  Motion& m = *motion_;
  if (!(until >= m.way.reached)) bad_value("until", until, "must not be before t = " + std::to_string(m.way.reached));
  m.go_or_count(until, alive);
  m.count_from_here();
  return m.status;
}

double Simulation::t() const { return motion_->way.reached; }
const Eigen::VectorXd& Simulation::q() const { return motion_->way.s.q; }
const Eigen::VectorXd& Simulation::v() const { return motion_->way.s.v; }
const Eigen::VectorXd& Simulation::a() {
  motion_->look();
  return motion_->way.s.a;
}
const Eigen::VectorXd& Simulation::tau() {
  motion_->look();
  return motion_->way.s.ws.total;
}
const Eigen::VectorXd& Simulation::friction() {
  motion_->look();
  return motion_->way.s.friction;
}
std::string Simulation::failure() const {
  return motion_->status == Status::ok ? "" : motion_->way.reason(motion_->status);
}
const Step::Counts& Simulation::counts() const { return motion_->method->counts(); }
long Simulation::steps() const { return motion_->way.steps; }
long Simulation::failed_steps() const { return motion_->way.halved + counts().divided; }
const std::vector<EventLog>& Simulation::events() const { return motion_->events.events; }
bool Simulation::terminated() const { return motion_->events.terminated; }

void Simulation::set_tau(const Eigen::VectorXd& tau) {
  Motion& m = *motion_;
  if (tau.size() != m.way.s.constant_tau.size() || !tau.allFinite())
    bad_value("tau", tau.size(), "numbers; must be " + std::to_string(m.way.s.constant_tau.size()) + ", finite");
  m.way.s.constant_tau = tau;
  m.change();
}

namespace {

template <class T>
void set_input(const char* name, std::size_t k, std::vector<T>& values, const T& value) {
  if (k >= values.size()) bad_value(name, k, "must be below " + std::to_string(values.size()));
  values[k] = value;
}

}  // namespace

void Simulation::set_force(std::size_t drive, double value) {
  Motion& m = *motion_;
  if (drive < m.problem.drives.size() && m.problem.drives[drive].motion)
    bad_value("drive", drive, "prescribes a motion: only forces are inputs");
  if (!std::isfinite(value)) bad_value("force", value, "must be finite");
  set_input("drive", drive, m.in.force, value);
  m.change();
}

void Simulation::set_load(std::size_t load, const Vec6<double>& wrench) {
  if (!wrench.allFinite()) bad_value("load", "nan or inf", "must be finite");
  if (load < motion_->problem.loads.size() && motion_->problem.loads[load].load.by_state)
    bad_value("load", load, "follows from the state, so that it cannot be set");
  set_input("load", load, motion_->in.load, wrench);
  motion_->change();
}

void Simulation::set_reference(std::size_t feedback, double value) {
  if (!std::isfinite(value)) bad_value("reference", value, "must be finite");
  set_input("feedback", feedback, motion_->in.reference, value);
  motion_->change();
}

Simulation::State Simulation::state() const {
  Motion& m = *motion_;
  State out{m.way.reached, {}, m.control};
  m.numbers([&out](double& x) { out.numbers.push_back(x); });
  return out;
}

void Simulation::restore(const State& state) {
  Motion& m = *motion_;
  std::size_t count = 0;
  m.numbers([&count](double&) { ++count; });
  if (state.numbers.size() != count || state.control.held().size() != m.control.held().size())
    bad_value("state", state.numbers.size(), "numbers; this problem's has " + std::to_string(count));
  const double* from = state.numbers.data();
  m.numbers([&from](double& x) { x = *from++; });
  m.known = false;
  m.way.reached = state.t;
  m.control.recall(state.control);
  m.way.s.drive(state.t);
  m.method->recalled();
  m.way.recalled();
  m.status = Status::ok;
  m.events.terminated = false;
  m.seen.start(state.t);
}

}  // namespace flexarm
