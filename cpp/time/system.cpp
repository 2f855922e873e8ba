#include "system.hpp"

#include <algorithm>

#include "arrays.hpp"
#include "flexarm/ab.hpp"
#include "flexarm/check.hpp"
#include "flexarm/ci.hpp"
#include "setup/single.hpp"

namespace flexarm {

namespace {

std::vector<bool> prescribed(const Arm& arm, const std::vector<Drive>& drives) {
  std::vector<bool> given(static_cast<std::size_t>(arm.nv()), false);
  for (const Drive& d : drives)
    if (d.motion) given[d.coordinate] = true;
  return given;
}

}  // namespace

std::vector<Load> places(const std::vector<LoadDrive>& loads) {
  std::vector<Load> out;
  for (const LoadDrive& l : loads) out.push_back(l.load);
  return out;
}

System::System(const Problem& problem, Control& control_)
    : arm(*problem.arm),
      drives(problem.drives),
      loads(problem.loads),
      control(control_),
      constant_tau(problem.tau),
      ws(arm, prescribed(arm, drives), places(loads)),
      q(arm.zero()),
      v(Eigen::VectorXd::Zero(arm.nv())),
      a(v),
      tau(constant_tau),
      friction(v),
      held_before(v),
      loop_forces(Eigen::RowVectorXd::Zero(6 * static_cast<Eigen::Index>(arm.loops().size()))) {
  std::vector<bool> given(static_cast<std::size_t>(arm.nq()), false);
  for (const Drive& d : drives)
    if (d.motion) given[static_cast<std::size_t>(arm.coordinate_of(d.coordinate))] = true;
  for (int i = 0; i < arm.nq(); ++i)
    if (!given[i]) free_q.push_back(i);
  ws.limits = torque_limits(arm);
  ws.feed_back(control.feedback());
}

void System::drive(double t) {
  tau = constant_tau + control.held();
  for (AppliedLimit& l : ws.limits) l.friction = 0.0;
  const auto move = [this](std::size_t k, const MotionValue& m) {
    const int i = drives[k].coordinate;
    q[arm.coordinate_of(i)] = m.q;
    v[i] = m.v;
    a[i] = ws.a[i] = m.a;
  };
  const auto push = [this](std::size_t k, double force) {
    const Drive& d = drives[k];
    if (d.column.size() > 0) {
      tau += force * d.column;
      return;
    }
    tau[d.coordinate] += force;
    for (AppliedLimit& l : ws.limits)
      if (d.rubs && l.rate == d.coordinate) l.friction += force;
  };
  ask_laws(
      drives, loads, control.feedback(), t, move, push,
      [this](std::size_t k, const Vec6<double>& wrench) { ws.loads[k].wrench = wrench; },
      [this](std::size_t k, double offset) { ws.feedback[k].offset = offset; });
  ws.give(tau.data());
}

void System::close_loops(double h) {
  if (ws.chain().layout().rigid_rows > 0) ws.chain_to_move().project({0.0, h * h}, q.data(), v.data(), ws.spare.data());
}

void System::remember() {
  if (!remember_note(ws)) remember_contacts(arm, ws, q, v);
}

Status System::accelerate(bool between) {
  return rubbing ? rubbing->accelerate(ws, q, v, tau, friction, between) : forward_dynamics(arm, ws, q, v, tau);
}

bool System::sample(double t) {
  if (!control.due(t)) return false;
  if (accelerate() == Status::ok) a = ws.a;
  held_before = control.held();
  if (!control.run(t, q, v, a)) return false;
  tau += control.held() - held_before;
  ws.give(tau.data());
  return true;
}

const char* System::react() {
  ws.a = a;
  const Status status = accelerate();
  if (status == Status::singular) return "the mass matrix is singular";
  if (status != Status::ok) return "the accelerations are no longer finite numbers";
  a = ws.a;
  if (!rubbing) friction.setZero();
  const bool moved = std::any_of(drives.begin(), drives.end(), [](const Drive& d) { return bool(d.motion); });
  if (moved && ws.chain().layout().rigid_rows > 0 && !ws.chain().closed()) return "rigid loops are open";
  if (moved || !arm.loops().empty()) {
    if (rubbing) move_chain(ws, q, v);
    joint_forces(arm, ws, a);
    if (!ws.tau.allFinite()) return "the forces are no longer finite";
  }
  ws.total = tau;
  add_feedback(ws, q, v, 1.0, ws.total);
  for (const AppliedLimit& l : ws.limits) ws.total[l.rate] = l.force();
  if (!arm.loops().empty()) take_loop_forces(ws, ws.total + friction, loop_forces.data());
  for (const Drive& d : drives) {
    if (!d.motion) continue;
    double& force = ws.total[d.coordinate];
    if (d.rubs)
      friction[d.coordinate] = ws.tau[d.coordinate] - force;
    else
      force = ws.tau[d.coordinate] - friction[d.coordinate];
  }
  return nullptr;
}

bool System::record(Trajectory& out) {
  if (const char* why = react()) {
    out.failure = why;
    return false;
  }
  normalise(arm, q);
  out.q.row(out.done) = q;
  out.v.row(out.done) = v;
  out.a.row(out.done) = a;
  out.tau.row(out.done) = ws.total;
  out.friction.row(out.done) = friction;
  if (out.contacts.cols() > 0) contact_forces(ws, out.contacts.row(out.done).data());
  out.loops.row(out.done) = loop_forces;
  ++out.done;
  return true;
}

void System::evaluate(const std::vector<Event>& events, double t, double* values) {
  normalise(arm, q);
  for (std::size_t k = 0; k < events.size(); ++k) {
    values[k] = events[k].value(t, q, v);
    if (!std::isfinite(values[k]))
      bad_value("events[" + std::to_string(k) + "] at t = " + std::to_string(t), values[k], "must be finite");
  }
}

bool System::log(const std::vector<Event>& events, std::size_t k, double t, Trajectory& out) const {
  EventLog& log = out.events[k];
  log.t.push_back(t);
  log.q.push_back(q);
  log.v.push_back(v);
  if (events[k].terminal == 0 || static_cast<int>(log.t.size()) < events[k].terminal) return false;
  out.terminated = true;
  out.reached = t;
  return true;
}

Trajectory empty_trajectory(const Arm& arm, const Eigen::VectorXd& t, const std::vector<Event>& events,
                            std::size_t parameters) {
  Trajectory out;
  const Trajectory::Rows rows(t.size(), arm.nv());
  out.tangents.assign(parameters, {Trajectory::Rows(t.size(), arm.nq()), rows, rows, rows, rows});
  out.events.resize(events.size());
  out.q.resize(t.size(), arm.nq());
  for (Trajectory::Rows* x : {&out.v, &out.a, &out.tau, &out.friction}) x->resize(t.size(), arm.nv());
  out.contacts.resize(t.size(), 3 * static_cast<Eigen::Index>(arm.contacts().size()));
  out.loops.resize(t.size(), 6 * static_cast<Eigen::Index>(arm.loops().size()));
  out.reached = t[0];
  return out;
}

void refuse_balls(const Arm& arm, const std::string& what) {
  for (std::size_t n = 0; n < arm.size(); ++n)
    if (arm.link(n).joint().has_ball())
      bad_value("link[" + std::to_string(n) + "].joint", "a ball", what + " know no quaternions: use Axes");
}

double next_sample(const std::vector<Drive>& drives, const std::vector<LoadDrive>& loads, const Control& control,
                   double from, bool motions) {
  double next = control.next(from);
  const auto look = [&](const Eigen::VectorXd& breaks) {
    const double* found = std::lower_bound(breaks.data(), breaks.data() + breaks.size(), from);
    if (found != breaks.data() + breaks.size()) next = std::min(next, *found);
  };
  for (const Drive& d : drives)
    if (motions || !d.motion) look(d.breaks);
  for (const LoadDrive& l : loads) look(l.breaks);
  for (const Feedback& f : control.feedback())
    if (f.reference) look(f.breaks);
  return next;
}

}  // namespace flexarm
