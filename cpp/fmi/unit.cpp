#include "unit.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "arrays.hpp"
#include "flexarm/check.hpp"
#include "flexarm/computed_torque.hpp"

namespace flexarm {

namespace {

constexpr double kSameTime = 1e-9;  // parts of a step by which two times are still one
constexpr double kElasticNominal = 1e-2;

}  // namespace

Unit::Unit(Resources resources, bool exchanges, bool events)
    : resources_(std::move(resources)),
      name_(resources_.token + (exchanges ? " model exchange" : " co-simulation")),
      exchanges_(exchanges),
      events_(events),
      in_(resources_.inputs()) {
  if (!exchanges && resources_.scene.method.name == "ida")
    bad_value("integrator", "ida",
              "takes no steps one by one: export the scene with \"implicit\", \"gauss\" or \"rk4\"");
  for (std::size_t k = 0; k < resources_.variables.size(); ++k)
    if (resources_.variables[k].kind == Variable::indicator) indicators_.push_back(k);
  reset();
}

void Unit::reset() {
  const Problem& p = resources_.scene.problem;
  values_.clear();
  for (const Variable& x : resources_.variables) values_.push_back(x.start);
  q0_ = p.q0;
  v0_ = p.v0;
  place_inputs(p);  // in place: laws look there
  start_ = resources_.scene.t[0];
  first_ = 0.0;
  made_ = changed_ = false;
  mode_ = Mode::instantiated;
}

void Unit::need(const char* call, std::initializer_list<Mode> allowed) const {
  constexpr const char* kModes[] = {"instantiated", "initialisation", "event", "continuous-time", "step", "terminated"};
  if (std::find(allowed.begin(), allowed.end(), mode_) == allowed.end())
    bad_value(call, std::string(kModes[static_cast<int>(mode_)]) + " mode", "cannot be called in this mode");
}

void Unit::start_at(double time) {
  if (!std::isfinite(time)) bad_value("startTime", time, "must be finite");
  start_ = time;
  made_ = false;
}

void Unit::begin() {
  make();
  mode_ = exchanges_ || events_ ? Mode::event : Mode::stepping;
}

/// Additions to the forces and references of a problem, from the inputs' values.
void Unit::place_inputs(const Problem& p) {
  for (std::size_t k = 0; k < values_.size(); ++k)
    if (const Variable& x = resources_.variables[k]; x.input()) input(x) = factor(x, p) * values_[k];
}

/// Of an input: the quantity that it is added to, per unit.
double Unit::factor(const Variable& x, const Problem& p) {
  return x.kind == Variable::add_reference && x.j >= 0 ? p.feedback[static_cast<std::size_t>(x.i)].by_q[x.j] : 1.0;
}

/// The simulation, or the model, of the values as they are.
void Unit::make() {
  if (made_) return;
  place_inputs(resources_.scene.problem);
  auto scene = std::make_unique<Scene>(resources_.with(values_, in_));
  Problem& p = scene->problem;
  place_inputs(p);
  p.q0 = q0_;
  p.v0 = v0_;
  if (exchanges_) {
    p.check();
    exchange_ = std::make_unique<Exchange>(p, start_);
  } else {
    simulation_ = std::make_unique<Simulation>(p, scene->method, scene->step, start_);
  }
  ws_ = std::make_unique<Workspace>(*p.arm);
  scene_ = std::move(scene);
  made_ = true;
  changed_ = moved_ = false;
}

bool Unit::before() const { return mode_ == Mode::instantiated || mode_ == Mode::initialising; }

const Variable& Unit::variable(std::size_t reference) const {
  if (reference >= resources_.variables.size())
    bad_value("value reference", reference, "must be below " + std::to_string(resources_.variables.size()));
  return resources_.variables[reference];
}

const Eigen::VectorXd& Unit::q() { return exchanges_ ? exchange_->q() : simulation_->q(); }
const Eigen::VectorXd& Unit::v() { return exchanges_ ? exchange_->v() : simulation_->v(); }
double Unit::t() {
  make();
  return exchanges_ ? exchange_->t() : simulation_->t();
}

Exchange& Unit::exchange() {
  if (!exchanges_) bad_value("instance", "of co-simulation", "this call is one of model exchange");
  make();
  moved_ = false;
  return *exchange_;
}

double Unit::nominal(std::size_t state) const {
  const Arm& arm = *resources_.scene.problem.arm;
  const std::vector<int>& coordinates = exchange_->coordinates();
  if (state >= coordinates.size()) return 1.0;
  std::size_t n = arm.size() - 1;
  while (arm.first_q(n) > coordinates[state]) --n;
  return coordinates[state] - arm.first_q(n) < arm.link(n).joint().nq() ? 1.0 : kElasticNominal;
}

/// Places the arm where it is now.
void Unit::move() {
  if (moved_) return;
  move_arm(*scene_->problem.arm, *ws_, q(), v());
  moved_ = true;
}

double& Unit::input(const Variable& x) {
  const auto i = static_cast<std::size_t>(x.i);
  switch (x.kind) {
    case Variable::add_tau:
      return in_.tau[x.i];
    case Variable::add_drive:
      return in_.drive.at(i);
    case Variable::add_load:
      return in_.load.at(i)[x.j];
    case Variable::add_reference:
      return in_.reference.at(i);
    default:
      return in_.sampled.at(i)[x.j];
  }
}

double Unit::get(std::size_t reference) {
  const Variable& x = variable(reference);
  if (x.input() || x.parameter()) return values_[reference];
  make();
  const auto link = static_cast<std::size_t>(x.i);
  switch (x.kind) {
    case Variable::time:
      return t();
    case Variable::q:
      return q()[x.i];
    case Variable::v:
      return v()[x.i];
    case Variable::a:
      return exchanges_ ? exchange_->a()[x.i] : simulation_->a()[x.i];
    case Variable::dq:
      dq_.resize(q().size());
      coordinate_rates(*scene_->problem.arm, q(), v(), dq_);
      return dq_[x.i];
    case Variable::tau:
      return exchanges_ ? exchange_->tau()[x.i] : simulation_->tau()[x.i];
    case Variable::friction:
      return exchanges_ ? exchange_->friction()[x.i] : simulation_->friction()[x.i];
    case Variable::indicator:
      return exchanges_ ? exchange_->indicator(x.i) : 1.0;
    case Variable::place:
      move();
      return slice_pose(*ws_, link).p[x.j];
    case Variable::rotation:
      move();
      return slice_pose(*ws_, link).R(x.j / 3, x.j % 3);
    default: {
      double y = x.of.by_q.dot(q()) + x.of.by_v.dot(v()) + x.of.offset;
      if (!x.of.at) return y;
      move();
      return y + x.of.along.dot(slice_pose(*ws_, *x.of.at).p);
    }
  }
}

void Unit::set(std::size_t reference, double value) {
  const Variable& x = variable(reference);
  if (!std::isfinite(value)) bad_value(x.name, value, "must be finite");
  if (mode_ == Mode::terminated) bad_value(x.name, value, "cannot be set: the run has ended");
  if (x.input()) {
    values_[reference] = value;
    if (before() || !made_) {
      made_ = false;
      return;
    }
    double& to = input(x);
    const double now = factor(x, scene_->problem) * value;
    if (to == now) return;
    to = now;
    changed_ = changed_ || x.kind != Variable::add_sampled;  // that is looked at when it is due
    if (exchange_) exchange_->set_tau(resources_.scene.problem.tau + in_.tau);
    return;
  }
  const bool start = x.kind == Variable::q || x.kind == Variable::v;
  if (!x.parameter() && !start) bad_value(x.name, value, "cannot be set: is calculated");
  if (!before()) bad_value(x.name, value, "can be set before and in initialisation alone");
  if (start)
    (x.kind == Variable::q ? q0_ : v0_)[x.i] = value;
  else
    values_[reference] = value;
  made_ = false;
}

double Unit::advance(double now, double step) {
  Simulation& s = *simulation_;
  positive("communicationStepSize", step);
  if (!(std::abs(now - s.t()) <= kSameTime * step))
    bad_value("currentCommunicationPoint", now, "must be where the last step ended, " + std::to_string(s.t()));
  if (first_ == 0.0) first_ = step;
  // Times of the importer differ by rounding: on its even grid, and at the scene's output times, they are exact.
  double until = now + step;
  const Eigen::VectorXd& t = scene_->t;
  const double even = start_ + std::round((until - start_) / first_) * first_;
  if (std::abs(even - until) <= kSameTime * step) until = even;
  const double* near = std::lower_bound(t.data(), t.data() + t.size(), until - kSameTime * step);
  if (near != t.data() + t.size() && std::abs(*near - until) <= kSameTime * step) until = *near;
  if (changed_) s.set_tau(resources_.scene.problem.tau + in_.tau);
  changed_ = moved_ = false;
  if (s.advance(until) != Status::ok) throw std::runtime_error(s.failure());
  return s.t();
}

void Unit::slopes(const std::vector<std::size_t>& unknowns, const std::vector<std::size_t>& knowns, const double* seed,
                  double* out) {
  Exchange& of = exchange();
  const Arm& arm = *scene_->problem.arm;
  Eigen::VectorXd dq = Eigen::VectorXd::Zero(arm.nq()), dv = Eigen::VectorXd::Zero(arm.nv()), given = dv, laws = dv;
  std::vector<Vec6<double>> wrenches(in_.load.size(), Vec6<double>::Zero());
  for (const std::size_t known : knowns) {
    const Variable& x = variable(known);
    const double by = *seed++;
    const auto is = [&x](const std::vector<int>& states) {
      return std::binary_search(states.begin(), states.end(), x.i);
    };
    if (x.kind == Variable::q && is(of.coordinates())) {
      dq[x.i] += by;
    } else if (x.kind == Variable::v && is(of.rates())) {
      dv[x.i] += by;
    } else if (x.kind == Variable::add_tau) {
      given[x.i] += by;
    } else if (x.kind == Variable::add_drive) {
      const Drive& drive = scene_->problem.drives[static_cast<std::size_t>(x.i)];
      if (drive.column.size() > 0)
        given += by * drive.column;
      else
        given[drive.coordinate] += by;
    } else if (x.kind == Variable::add_reference) {
      laws += by * factor(x, scene_->problem) * of.column(static_cast<std::size_t>(x.i));
    } else if (x.kind == Variable::add_load) {
      wrenches[static_cast<std::size_t>(x.i)][x.j] += by;
    } else if (x.kind != Variable::add_sampled) {
      bad_value(x.name, "known", "derivatives are by states and inputs alone");
    }
  }
  given += laws;
  of.limit(given);
  const Eigen::VectorXd da = of.slope(dq, dv, given, wrenches);
  Eigen::VectorXd turn(arm.nv());  // the rates that move it by dq
  for (int i = 0; i < arm.nv(); ++i) turn[i] = arm.coordinate_of(i) < 0 ? 0.0 : dq[arm.coordinate_of(i)];
  for (std::size_t n = 0; n < arm.size(); ++n) {
    const Joint& joint = arm.link(n).joint();
    if (!joint.has_ball()) continue;
    const int at = arm.first_q(n) + joint.nq() - 4;
    const Eigen::Vector4d p = q().segment<4>(at);
    turn.segment<3>(arm.first(n) + joint.nv() - 3) =
        4.0 / p.squaredNorm() * ball_rate_matrix(p.data()).transpose() * dq.segment<4>(at);
  }
  Mat6X<double> J(6, arm.nv());
  const auto moved = [&](const auto& place) -> Vec6<double> {
    move();
    slice_jacobian(arm, *ws_, place, J);
    return J * turn;
  };
  for (const std::size_t unknown : unknowns) {
    const Variable& x = variable(unknown);
    const auto link = static_cast<std::size_t>(x.i);
    double& to = *out++;
    switch (x.kind) {
      case Variable::q:
        to = dq[x.i];
        break;
      case Variable::v:
        to = dv[x.i];
        break;
      case Variable::a:
        to = da[x.i];
        break;
      case Variable::dq: {
        Eigen::MatrixXd by_q = Eigen::MatrixXd::Zero(arm.nq(), arm.nq());
        Eigen::MatrixXd by_v = Eigen::MatrixXd::Zero(arm.nq(), arm.nv());
        coordinate_rate_jacobians(arm, q(), v(), by_q, by_v);
        to = by_q.row(x.i).dot(dq) + by_v.row(x.i).dot(dv);
        break;
      }
      case Variable::place:
        to = moved(link)[x.j];
        break;
      case Variable::rotation:
        to = (tilde(moved(link).tail<3>()) * slice_pose(*ws_, link).R)(x.j / 3, x.j % 3);
        break;
      case Variable::reading:
        to = x.of.by_q.dot(dq) + x.of.by_v.dot(dv);
        if (x.of.at) to += x.of.along.dot(moved(*x.of.at).head<3>());
        break;
      default:
        bad_value(x.name, "unknown", "has no derivatives: outputs and derivatives of states have");
    }
  }
}

void Unit::memory(const std::function<void(double&)>& visit) {
  double mode = static_cast<double>(mode_), made = made_ ? 1.0 : 0.0, changed = changed_ ? 1.0 : 0.0;
  for (double* x : {&mode, &made, &changed, &start_, &first_}) visit(*x);
  for (Eigen::VectorXd* x : {&q0_, &v0_})
    for (double& number : *x) visit(number);
  for (double& number : values_) visit(number);
  mode_ = static_cast<Mode>(mode);
  made_ = made != 0.0;
  changed_ = changed != 0.0;
}

void Unit::check_bytes() const {
  for (const Sampler& x : resources_.scene.problem.samplers)
    if (const TorqueLaw* law = x.law.target<TorqueLaw>(); law && law->of.sags())
      throw std::invalid_argument(
          "bytes of a state: a computed torque that sags goes on from its last balance, which "
          "bytes do not hold; take it with elastic=\"zero\"");
}

Unit::State Unit::state() {
  make();
  State out{name_, {}, nullptr};
  const auto add = [&out](double& x) { out.numbers.push_back(x); };
  memory(add);
  if (exchanges_) {
    exchange_->memory(add);
    out.laws = std::make_shared<const Control>(exchange_->control());
  } else {
    Simulation::State now = simulation_->state();
    add(now.t);
    for (double& x : now.numbers) add(x);
    out.laws = std::make_shared<const Control>(now.control);
    now.control.memory(add);
  }
  return out;
}

void Unit::restore(const State& state) {
  if (state.of != name_) bad_value("state", state.of, "must be of " + name_);
  const double *from = state.numbers.data(), *end = from + state.numbers.size();
  const auto take = [&](double& x) {
    if (from == end) bad_value("state", state.numbers.size(), "numbers: is of another unit");
    x = *from++;
  };
  const std::vector<double> before = values_;
  const double start = start_;
  bool other = !made_;
  memory(take);
  other = other || start != start_;
  for (std::size_t k = 0; k < values_.size(); ++k)
    other = other || (resources_.variables[k].parameter() && before[k] != values_[k]);
  if (other) {
    const bool changed = changed_;
    made_ = false;
    make();
    changed_ = changed;
  } else {
    place_inputs(scene_->problem);
  }
  moved_ = false;
  if (exchanges_) {
    exchange_->set_tau(resources_.scene.problem.tau + in_.tau);
    exchange_->memory(take);
    if (state.laws) exchange_->control().recall(*state.laws);
  } else {
    Simulation::State now = simulation_->state();
    take(now.t);
    for (double& x : now.numbers) take(x);
    if (state.laws)
      now.control.recall(*state.laws);
    else
      now.control.memory(take);
    simulation_->restore(now);
  }
}

}  // namespace flexarm
