#include "flexarm/step.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <type_traits>

#include "arrays.hpp"
#include "flexarm/check.hpp"
#include "flexarm/dry_friction.hpp"
#include "setup/single.hpp"
#include "space/ball.hpp"
#include "step/methods.hpp"

namespace flexarm {

namespace {

/// An arm's workspace as the methods see it (step/methods.hpp).
struct Engine {
  using Scalar = double;
  using Mask = bool;
  const Arm& arm;
  Workspace* ws = nullptr;
  const lanes::Layout* layout = nullptr;            // the workspace's
  const double *q_now = nullptr, *v_now = nullptr;  // of the last `inverse`
  const double* applied = nullptr;                  // tau, now
  const int* free = nullptr;
  int free_count = 0;
  double weight;

  explicit Engine(const Arm& arm_) : arm(arm_) {
    double mass = 0.0;
    for (const Link& link : arm.links()) mass += link.mass();
    weight = mass * arm.gravity().squaredNorm();
  }

  void place(const double* q0, const double* u, double* out) const { ::displace(*layout, q0, u, out); }
  void rates(const double* q, const double* v, double* dq) const { ::coordinate_rates(*layout, q, v, dq); }
  void normalise(double* q) const { ::normalise(*layout, q); }
  int coordinate(int i) const { return static_cast<int>(arm.coordinate_of(i)); }
  bool accelerate(const double* q, const double* v, const double* tau, double* a) {
    return forward(*ws, q, v, tau, a) == Status::ok;
  }
  void inverse(const double* q, const double* v, const double* a, double* tau, bool) {
    ws->give(applied);
    flexarm::inverse(*ws, q, v, a, tau);
    q_now = q;
    v_now = v;
  }
  void step_contacts(double by_end) { ws->chain().step_contacts(by_end); }
  bool met() const { return ws->chain().met(); }
  bool factor(const lanes::Shift& shift, double& twice_kinetic) {
    const bool good = flexarm::factor(arm, *ws, q_now, v_now, shift) == Status::ok;
    twice_kinetic = ws->twice_kinetic;
    return good;
  }
  void solve(const double* r, double* x) { flexarm::solve(arm, *ws, r, x); }
  bool closes() const { return layout->rigid_rows > 0; }
  void close_accelerations(double* x) { ws->chain().close_accelerations(x); }
  double close_places(const lanes::Shift& shift, double* w) { return ws->chain().close_places(shift, w); }
  double close_rates(const lanes::Shift& shift, double* z) { return ws->chain().close_rates(shift, z); }
  void hold_change(bool open) {
    if (open) ws->chain().hold_change();
  }
  void let_go() { ws->chain().let_go(); }
  bool closed() const { return ws->chain().closed(); }
  void project(const lanes::Shift& shift, double* q, double* v, double* scratch) {
    ws->chain_to_move().project(shift, q, v, scratch);
  }
  void shut(double* q, double* v, double* scratch) { ws->chain_to_move().shut(q, v, scratch); }
  bool correction(double* r, double* x) { return flexarm::correction(arm, *ws, q_now, v_now, r, x); }
};

/// The equations of GeneralisedAlpha::predict and place, with alpha = (by_a, ...) (a, a0, alpha0) put in.
Stages stages_of(const GeneralisedAlpha<Engine>& m) {
  const double h_a = m.by_a(), h_a0 = m.alpha_f / (1.0 - m.alpha_m), h_alpha0 = -m.alpha_m / (1.0 - m.alpha_m);
  Stages out;
  out.remembers = true;
  out.auxiliary << h_a, h_a0, h_alpha0;
  out.c = Eigen::Vector2d::Ones();
  out.v_by_a = Eigen::MatrixXd::Constant(2, 1, m.gamma * h_a);
  out.q_by_a = Eigen::MatrixXd::Constant(2, 1, m.beta * h_a);
  out.v_by_start.resize(2, 2);
  out.q_by_start.resize(2, 2);
  for (int row = 0; row < 2; ++row) {  // the stage is the step's end
    out.v_by_start.row(row) << m.gamma * h_a0, 1.0 - m.gamma + m.gamma * h_alpha0;
    out.q_by_start.row(row) << m.beta * h_a0, 0.5 - m.beta + m.beta * h_alpha0;
  }
  return out;
}

template <class Row>
Stages stages_of(const RungeKutta<Engine, Row>&) {
  constexpr int s = Row::stages;
  Stages out;
  out.in_turn = true;
  out.c.resize(s + 1);
  out.v_by_a = Eigen::MatrixXd::Zero(s + 1, s);
  for (int i = 0; i < s; ++i) {
    out.c[i] = Row::times[i];
    if (i > 0) out.v_by_a(i, i - 1) = Row::times[i];
    out.v_by_a(s, i) = Row::weights[i] / Row::sum;
  }
  out.c[s] = 1.0;
  out.q_by_a = out.v_by_a * out.v_by_a.topRows(s);
  out.v_by_start = out.q_by_start = Eigen::MatrixXd::Zero(s + 1, 2);
  return out;
}

}  // namespace

/// A method on an engine, whatever its type.
struct OneStep::Run {
  Engine engine;
  const std::vector<Rub> rubs;
  const std::vector<AppliedLimit> limits;
  std::vector<int> rubbing, now;              // their rates, those that are not prescribed
  std::vector<double> numbers;                // the method's memory
  JointFriction<Engine>* joints = nullptr;    // of the method
  GeneralisedAlpha<Engine>* alpha = nullptr;  // the method, if it is this one: it remembers, and divides steps
  const Work* work = nullptr;
  const double *q0 = nullptr, *v0 = nullptr, *divisions = nullptr, *doubt = nullptr;
  Status unsolved = Status::not_converged;
  bool switches_within = false;
  Stages stages;

  Run(const Arm& arm, std::vector<Rub> rubs_) : engine(arm), rubs(std::move(rubs_)), limits(torque_limits(arm)) {
    rubbing.reserve(rubs.size());
    now.reserve(rubs.size());
  }
  virtual ~Run() = default;
  virtual void forget() = 0;
  virtual bool begin(const double* q, const double* v, const double* tau, double* x) = 0;
  virtual bool accelerate(const double* q, const double* v, const double* tau, double* x, bool between) = 0;
  virtual bool step(double h, double* q, double* v, const double* tau, double* x, const Given& given) = 0;
  virtual bool accept(double h, double* v, double* x) = 0;
  virtual int iterations() const = 0;
  virtual bool asked_at_end() const = 0;

  int parts() const { return alpha && alpha->divided ? static_cast<int>(alpha->parts) : 0; }
  bool met() const { return alpha && alpha->met; }
  void memory(const std::function<void(double&)>& visit) {
    for (double& x : numbers) visit(x);
    if (!alpha) return;
    for (double* x : {&alpha->h_before, &alpha->newton.contraction, &alpha->scale, &alpha->joints.left}) visit(*x);
  }
  /// Of a step with switches of friction: its beginning.
  void note_beginning(double h, Tape::Switch& out) const {
    const auto all = [this](const double* x) { return Eigen::Map<const Eigen::VectorXd>(x, alpha->nv); };
    out.a0 = all(alpha->a0);
    out.alpha0 = all(alpha->lagged);
    out.gain = alpha->continued(h) * (all(alpha->a0) - all(alpha->a_before));
  }
  void begin_again(const Tape::Switch& from) {
    const auto copy = [](const auto& x, double* to) { std::copy(x.begin(), x.end(), to); };
    alpha->forget();
    copy(from.a0, alpha->a0);
    copy(from.alpha0, alpha->alpha0);
    copy((from.a0 - from.gain).eval(), alpha->a_before);
    alpha->h_before = from.h;
    copy(from.sense, joints->sense);
    copy(from.before, joints->before);
  }

  /// To be called before anything is done with another workspace.
  void attach(Workspace& ws, const Eigen::VectorXd& tau) {
    engine.ws = &ws;
    engine.applied = tau.data();
    if (ws.limits.size() != limits.size()) {
      ws.limits = limits;
      make_room_for_limits(ws);
    }
    engine.layout = &ws.chain().layout();
    engine.free = ws.free.data();
    engine.free_count = static_cast<int>(ws.free.size());
    now.clear();
    for (const Rub& r : rubs)
      if (std::binary_search(ws.free.begin(), ws.free.end(), r.rate)) now.push_back(r.rate);
    if (now == rubbing) return;
    std::swap(now, rubbing);
    JointFriction<Engine>& c = *joints;
    Arena arena(c.coulomb);
    c.lay_out(arena, rubbing.data(), static_cast<int>(rubbing.size()), engine.arm.nv());
    int k = 0;
    for (const Rub& r : rubs) {
      if (k == c.count || c.at[k] != r.rate) continue;
      c.coulomb[k] = r.coulomb;
      c.stiction[k++] = r.stiction;
    }
  }
};

template <class Row>
struct OneStep::RunOf final : Run {
  using Method = typename Row::template On<Engine>;
  Method method;

  RunOf(const Arm& arm, const ImplicitOptions& o) : Run(arm, flexarm::rubs(arm)) {
    const lanes::MethodOptions told{o.spectral_radius, o.rtol, o.max_iterations};
    Arena most;
    method.lay_out(most, arm.nq(), arm.nv(), nullptr, static_cast<int>(rubs.size()), told);
    numbers.resize(most.bytes() / sizeof(double));
    Arena arena(numbers.data());
    method.lay_out(arena, arm.nq(), arm.nv(), nullptr, 0, told);
    joints = &method.friction();
    if constexpr (std::is_same_v<Method, GeneralisedAlpha<Engine>>) alpha = &method;
    work = &method.work;
    q0 = method.q0;
    v0 = method.v0;
    divisions = &method.divisions;
    doubt = &method.doubt;
    unsolved = static_cast<Status>(method.unsolved);
    switches_within = Row::traits.rubs;
    stages = stages_of(method);
  }
  void forget() override { method.forget(); }
  bool begin(const double* q, const double* v, const double* tau, double* x) override {
    return method.begin(engine, q, v, tau, x, true);
  }
  bool accelerate(const double* q, const double* v, const double* tau, double* x, bool between) override {
    return method.accelerate(engine, q, v, tau, x, true, between);
  }
  bool step(double h, double* q, double* v, const double* tau, double* x, const Given& given) override {
    const auto set = [&given](double c) {
      if (given) given(c);
    };
    return method.step(engine, h, q, v, tau, x, set, false);
  }
  bool accept(double h, double* v, double* x) override { return method.accept(h, v, x, true); }
  int iterations() const override { return method.iterations; }
  bool asked_at_end() const override { return method.asked_at_end(); }
};

const std::vector<OneStep::Traits>& OneStep::methods() {
  static const std::vector<Traits> rows = [] {
    std::vector<Traits> out;
    for (const MethodTraits& row : Methods::traits)
      out.push_back({row.name, row.rubs, row.iterates, row.damps, row.limit});
    return out;
  }();
  return rows;
}

OneStep::OneStep(const std::string& method, const Arm& arm, double h, const ImplicitOptions& options,
                 DryFriction friction)
    : arm_(&arm), h_(positive("step", h)), remedy_(Step::remedy()), friction_(Eigen::VectorXd::Zero(arm.nv())) {
  const double rho = options.spectral_radius;
  if (!(rho >= 0.0 && rho <= 1.0)) bad_value("spectral_radius", rho, "must be from 0 to 1");
  positive("rtol", options.rtol);
  if (options.max_iterations < 1) bad_value("max_iterations", options.max_iterations, "must be at least 1");
  const int number = Methods::number(method.c_str());
  if (number < 0) bad_value("method", method, "is not known");
  const MethodTraits& traits = Methods::traits[number];
  if (!traits.rubs && friction == DryFriction::refused) refuse_friction(arm, traits.name);
  if (traits.limit > 0.0) {
    std::ostringstream text;
    text << "take a smaller step (" << traits.name << " is stable below " << traits.limit
         << " over the highest frequency), or an implicit method";
    remedy_ = text.str();
  }
  Methods::visit(number, [&](auto row) { run_ = std::make_unique<RunOf<decltype(row)>>(arm, options); });
}

OneStep::~OneStep() = default;
int OneStep::iterations() const { return run_->iterations(); }
Stages OneStep::stages() const { return run_->stages; }
OneStep* OneStep::rubbing() { return run_->rubs.empty() ? nullptr : this; }
bool OneStep::switches_within() const { return run_->switches_within; }

void OneStep::memory(const std::function<void(double&)>& visit) {
  run_->memory(visit);
  for (double& x : friction_) visit(x);
}

Status OneStep::start(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& tau) {
  run_->forget();
  const Status status = jump(ws, q, v, tau);
  started_ = status == Status::ok;
  return status;
}

Status OneStep::jump(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& tau) {
  run_->attach(ws, tau);
  const bool begun = run_->begin(q.data(), v.data(), tau.data(), ws.a.data());
  if (!all_finite(q) || !all_finite(v)) return Status::not_finite;
  if (begun) {
    if (!run_->rubs.empty()) report(v, run_->joints->before, friction_);
    if (tape_ && run_->stages.remembers) {
      tape_->entries.push_back({0.0, 1.0, tape_->add(tape_->now, q, v, ws.a)});
      ways(v, true, tape_->last_ways());
    }
    return Status::ok;
  }
  if (run_->rubs.empty())  // which says why
    if (const Status status = forward_dynamics(*arm_, ws, q, v, tau); status != Status::ok) return status;
  return all_finite(tau) && all_finite(ws.a) ? Status::singular : Status::not_finite;
}

Status OneStep::accelerate(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                           const Eigen::VectorXd& tau, Eigen::VectorXd& friction, bool between) {
  run_->attach(ws, tau);
  if (run_->rubs.empty()) return forward_dynamics(*arm_, ws, q, v, tau);
  const bool good = run_->accelerate(q.data(), v.data(), tau.data(), ws.a.data(), between);
  report(v, run_->joints->force, friction);
  if (!all_finite(q) || !all_finite(v) || !all_finite(tau) || (good && !all_finite(ws.a))) return Status::not_finite;
  return good ? Status::ok : Status::singular;
}

void OneStep::report(const Eigen::VectorXd& v, const double* force, Eigen::VectorXd& friction) const {
  friction.setZero();
  for (const Rub& r : run_->rubs)  // of those that are prescribed; the others follow
    friction[r.rate] = v[r.rate] == 0.0 ? 0.0 : -std::copysign(r.coulomb, v[r.rate]);
  const JointFriction<Engine>& joints = *run_->joints;
  for (int c = 0; c < joints.count; ++c) friction[joints.at[c]] = force[c];
}

/// The stages of the last step, before it is accepted. Those that follow in turn are gone: they are made again.
void OneStep::write(double h, Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau,
                    const Given& given) {
  const Stages& of = tape_->stages;
  tape_->entries.push_back({h, run_->alpha ? run_->alpha->lag(h) : 1.0, tape_->points()});
  if (run_->parts() > 0 || run_->met() || (run_->switches_within && run_->joints->switches())) {
    const JointFriction<Engine>& c = *run_->joints;
    const auto all = [](const double* x, Eigen::Index n) { return Eigen::Map<const Eigen::VectorXd>(x, n); };
    Tape::Switch now{static_cast<Eigen::Index>(tape_->entries.size()) - 1,
                     tape_->now,
                     h,
                     all(run_->q0, q.size()),
                     all(run_->v0, v.size()),
                     {},
                     {},
                     {},
                     all(c.sense, c.count),
                     all(c.before, c.count),
                     {c.at, c.at + c.count},
                     tape_->tau,
                     run_->parts()};
    run_->note_beginning(h, now);
    tape_->entries.back().point = -1;
    tape_->switches.push_back(std::move(now));
    return;
  }
  if (!of.in_turn) {
    const Eigen::Map<const Eigen::VectorXd> a(run_->alpha->a, v.size());
    const Eigen::Index point = tape_->add(tape_->now + h, q, v, a);
    ways(v, false, tape_->last_ways());
    if (run_->engine.closes()) {
      const auto all = [&](const double* x) -> Eigen::VectorXd {
        return Eigen::Map<const Eigen::VectorXd>(x, v.size());
      };
      const GeneralisedAlpha<Engine>& method = *run_->alpha;
      const double by_v = h * of.v_by_a(0, 0), by_q = h * h * of.q_by_a(0, 0);
      tape_->closings.push_back({point, by_v, by_q, {all(method.closed_q), all(method.closed_v)}});
    }
    return;
  }
  const Eigen::VectorXd q1 = q, v1 = v, a1 = ws.a;
  const bool closes = run_->engine.closes();
  const Eigen::Map<const Eigen::VectorXd> q0(run_->q0, q.size()), v0(run_->v0, v.size());
  Eigen::MatrixXd a(v.size(), of.count()), dq(q.size(), of.count());
  for (int i = 0; i < of.count(); ++i) {
    q = q0;
    v = v0;
    for (int j = 0; j < i; ++j) {
      v += h * of.v_by_a(i, j) * a.col(j);
      q += h * of.v_by_a(i, j) * dq.col(j);
    }
    if (given) given(of.c[i]);
    accelerate(ws, q, v, tau, friction_, true);
    a.col(i) = ws.a;
    run_->engine.rates(q.data(), v.data(), dq.col(i).data());
    tape_->add(tape_->now + of.c[i] * h, q, v, ws.a);
    ways(v, false, tape_->last_ways());
  }
  if (closes) {
    const Eigen::VectorXd b = of.v_by_a.row(of.count()).transpose();
    q = q0 + h * dq * b;
    v = v0 + h * a * b;
    tape_->close(tape_->now + h, q1, v1, a1, 0.0, q, v);
  }
  q = q1;
  v = v1;
  if (given) given(1.0);
  ws.a = a1;
}

bool OneStep::repeat(const Tape::Switch& from, Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v,
                     const Eigen::VectorXd& tau, const Given& given) {
  run_->attach(ws, tau);
  run_->begin_again(from);
  q = from.q;
  v = from.v;
  remember_contacts(*arm_, ws, q, v);
  run_->alpha->parts_again = from.parts;
  const bool solved = run_->step(from.h, q.data(), v.data(), tau.data(), ws.a.data(), given);
  run_->alpha->parts_again = 0;
  run_->accept(from.h, v.data(), ws.a.data());
  return solved;
}

std::vector<double> OneStep::way() const {
  std::vector<double> out;
  const JointFriction<Engine>& c = *run_->joints;
  for (const double* x : {c.held, c.over, c.way}) out.insert(out.end(), x, x + c.count);
  out.push_back(c.left);
  out.push_back(run_->parts());
  out.push_back(run_->met() ? 1.0 : 0.0);
  return out;
}

void OneStep::ways(const Eigen::VectorXd& v, bool instant, signed char* out) const {
  const JointFriction<Engine>& c = *run_->joints;
  for (int k = 0; k < c.count; ++k) {
    const double now = instant ? c.sign(v[c.at[k]]) : 0.0;
    const double way = c.over[k] > 0.5 ? c.way[k] : now != 0.0 ? now : c.sense[k];
    out[c.at[k]] = c.held[k] > 0.5 ? Tape::held : way > 0.0 ? Tape::ahead : way < 0.0 ? Tape::back : Tape::free;
  }
}

Status OneStep::advance(double h, Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau,
                        const Given& given) {
  if (!started_) {
    const Status status = start(ws, q, v, tau);
    if (status != Status::ok) return status;
  }
  Run& run = *run_;
  run.attach(ws, tau);
  const Work before = *run.work;
  const bool solved = run.step(h, q.data(), v.data(), tau.data(), ws.a.data(), given);
  counts_.evaluations += run.work->evaluations - before.evaluations;
  counts_.factorisations += run.work->factorisations - before.factorisations;
  counts_.iterations += run.work->solves - before.solves;
  counts_.divided = static_cast<long>(*run.divisions);
  counts_.doubt = *run.doubt;
  if (!solved || !arm_->within_reach(q, v)) {
    std::copy(run.q0, run.q0 + q.size(), q.begin());
    std::copy(run.v0, run.v0 + v.size(), v.begin());
    const bool sane = all_finite(q) && all_finite(v) && all_finite(tau) && all_finite(ws.a);
    return solved || !sane ? Status::not_finite : run.unsolved;
  }
  if (tape_) {
    write(h, ws, q, v, tau, given);
    tape_->now += h;
  }
  Status status = Status::ok;
  const bool switched = run.switches_within && run.joints->switches();
  if (run.accept(h, v.data(), ws.a.data())) {  // other forces act from here on
    counts_.switches += switched;
    status = jump(ws, q, v, tau);
  } else if (!run.rubs.empty()) {
    report(v, run.joints->before, friction_);
  }
  if (status == Status::ok && run.asked_at_end()) note_contacts(ws);
  return status;
}

}  // namespace flexarm
