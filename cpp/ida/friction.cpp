#include "friction.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>
#include <optional>

#include "arrays.hpp"
#include "flexarm/ab.hpp"
#include "flexarm/check.hpp"
#include "flexarm/inverse.hpp"
#include "sliding_tangents.hpp"

namespace flexarm {

namespace {

constexpr double kStill = 1e-10;    // speed (rad/s, m/s) below which a freedom may stick
constexpr double kInstant = 1e-12;  // parts of the time simulated that are no time at all
constexpr double kSlack = 1e-9;     // parts of its stiction by which a joint may be held beyond it
constexpr std::size_t kMany = 100;  // so many switches
constexpr const char* kRanAway = "the motion ran away: take a smaller step, or look for what drives it";
constexpr double kDifference = 2e-6;  // of the time simulated, for the rate of a holding force
constexpr double kShort = 1e-6;       // in so small a part of the time simulated are no motion

std::vector<RubbingJoint> rubbing_joints(const Arm& arm, const std::vector<Drive>& drives) {
  std::vector<RubbingJoint> out;
  for (const Rub& r : rubs(arm)) out.push_back({r.rate, r.coulomb, r.stiction, false, 0});
  for (RubbingJoint& c : out)
    for (const Drive& d : drives) c.given = c.given || (d.motion && d.coordinate == c.coordinate);
  return out;
}

/// The run: its joints, and its problem between two switches.
class Sliding {
 public:
  Sliding(const Problem& problem, Control& control, const std::vector<Parameter>& parameters)
      : joints_(rubbing_joints(*problem.arm, problem.drives)),
        arm_(*problem.arm),
        problem_(problem),
        part_(problem),
        control_(control),
        rests_("implicit", arm_, 1.0),
        free_(problem, control) {
    free_.rubbing = &rests_;
    if (parameters.empty()) return;
    if (control.due(1e300))
      bad_value("control", "sampled", "of dry friction and sampled controllers together no derivatives are known");
    tangents_.emplace(parameters, free_, joints_.size());
  }

  /// Runs the sampled controllers that are due at time t, after `settle`. @return whether the forces have changed
  bool sample(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
    probe_->drive(t, q, v);
    return probe_->sample(t);
  }

  /// Which freedoms stick and which slide, from t on, as the implicit method has it (joint_friction.hpp); the speeds of
  /// those that stick become zero.
  /// @param switched  the joint that has come to rest or has been torn loose, or null
  void settle(double t, const Eigen::VectorXd& q, Eigen::VectorXd& v, const RubbingJoint* switched) {
    for (const RubbingJoint& c : joints_)
      if (!c.given && (&c == switched || std::abs(v[c.coordinate]) <= kStill)) v[c.coordinate] = 0.0;
    System& s = free_;
    s.drive(t, q, v);
    if (s.accelerate() != Status::ok) s.ws.a.setZero();  // the next step says why; joints at rest stay there
    for (RubbingJoint& c : joints_) {
      if (c.given) continue;
      const double speed = v[c.coordinate], along = speed == 0.0 ? s.ws.a[c.coordinate] : speed;
      c.sense = along > 0.0 ? 1 : along < 0.0 ? -1 : 0;
    }
    prepare(q, v);
  }

  /// `settle`, and the tangents' leap, where a part of the run has been ended by the switch of a joint.
  void settle(const Trajectory& part, const Eigen::VectorXd& q, Eigen::VectorXd& v, const RubbingJoint& switched,
              double span) {
    const double t = part.reached;
    if (!tangents_) return settle(t, q, v, &switched);
    const int of = switched.coordinate;
    const auto force = [&](double when, const Eigen::VectorXd& at, const Eigen::VectorXd& rate) {
      return holding(when, at, rate)[of];
    };
    force(t, q, v);
    const Eigen::VectorXd before = probe_->a;
    Saltation leap = switched.sense != 0
                         ? Saltation::at_rest(of, before)
                         : Saltation::torn(of, switched.stiction, true, t, q, v, before, kDifference * span, force);
    settle(t, q, v, &switched);
    force(t, q, v);
    leap.end(probe_->a);
    tangents_->leap(part, static_cast<std::size_t>(&switched - joints_.data()), leap);
    tangents_->prepare(arm_, joints_, q, v);
  }

  /// The problem until the next switch, from q and v on.
  const Problem& part(const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Trajectory& done) {
    part_.q0 = q;
    part_.v0 = v;
    watch(done);
    return part_;
  }
  const std::vector<Parameter>& parameters() const {
    static const std::vector<Parameter> none;
    return tangents_ ? tangents_->parameters() : none;
  }

  /// Whether the force that holds a joint was no longer finite.
  bool ran_away() const { return ran_away_; }
  /// The joints of the events that `part` has added.
  const std::vector<const RubbingJoint*>& switching() const { return switching_; }

  /// Adds a row at a state where no integrator has been.
  bool record(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v, Trajectory& out) {
    probe_->drive(t, q, v);
    if (!probe_->record(out)) return false;
    return !tangents_ || StateTangents(*probe_, tangents_->parameters()).record(t, out.tangents, out.done - 1);
  }

  /// Writes the last row anew: a sample at the end of the run may tear a joint loose, and no step follows to see
  /// it.
  void end(Trajectory& out) {
    if (problem_.samplers.empty()) return;
    const Eigen::Index last = out.done - 1;
    const Eigen::VectorXd q = out.q.row(last);
    Eigen::VectorXd v = out.v.row(last);
    settle(out.reached, q, v, nullptr);
    out.done = last;
    if (record(out.reached, q, v, out)) separate(out, last);
  }

  /// Takes the friction of sliding joints out of a row of tau.
  void separate(Trajectory& out, Eigen::Index row) const {
    for (const RubbingJoint& c : joints_) {
      const double speed = out.v(row, c.coordinate);
      const double sense = !c.given ? c.sense : speed > 0.0 ? 1.0 : speed < 0.0 ? -1.0 : 0.0;
      double& force = out.friction(row, c.coordinate);
      if (!c.given && c.sense == 0) {
        force = std::clamp(force, -c.stiction, c.stiction);  // but for kSlack
        continue;
      }
      force = sense == 0.0 ? 0.0 : -sense * c.coulomb;
      out.tau(row, c.coordinate) -= force;
      if (tangents_) tangents_->separate(out, row, static_cast<std::size_t>(&c - joints_.data()), c, sense);
    }
  }

 private:
  /// The events of the run, with as many occurrences as are left to their ends, and after them one for each joint
  /// that may switch.
  void watch(const Trajectory& done) {
    std::vector<Event>& events = part_.events = problem_.events;
    for (std::size_t k = 0; k < events.size(); ++k)
      if (events[k].terminal > 0) events[k].terminal -= static_cast<int>(done.events[k].t.size());
    switching_.clear();
    for (const RubbingJoint& c : joints_) {
      if (c.given) continue;
      switching_.push_back(&c);
      const int i = c.coordinate, sense = c.sense;
      const double most = c.stiction * (1.0 + kSlack);
      if (sense != 0)
        events.push_back({[i, sense](double, const auto&, const auto& v) { return sense * v[i] + kStill; }, 1, -1});
      else
        events.push_back({[this, i, most](double t, const auto& q, const auto& v) {
                            const double slack = most - std::abs(holding(t, q, v)[i]);
                            ran_away_ = ran_away_ || !std::isfinite(slack);
                            return std::isfinite(slack) ? slack : -most;  // ends the part, and then the run
                          },
                          1, -1});
    }
  }

  /// Sticking freedoms are prescribed; sliding ones are driven by a constant force.
  void prepare(const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
    part_.drives = problem_.drives;
    for (const RubbingJoint& c : joints_)
      if (!c.given) part_.drives.push_back(c.sense == 0 ? held(arm_, c, q) : sliding_force(c, c.coulomb));
    probe_ = std::make_unique<System>(part_, control_);
    if (tangents_) tangents_->prepare(arm_, joints_, q, v);
  }

  /// Force on each sticking freedom that holds it (of all coordinates); the system's accelerations are those then.
  Eigen::VectorXd holding(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v) const {
    System& s = *probe_;
    s.drive(t, q, v);
    forward_dynamics_ab(arm_, s.ws, s.q, s.v, s.tau);
    s.a = s.ws.a;
    joint_forces(arm_, s.ws, s.ws.a);
    add_feedback(s.ws, s.q, s.v, 1.0, s.tau);
    return s.ws.tau - s.tau;
  }

  std::vector<RubbingJoint> joints_;
  const Arm& arm_;
  const Problem& problem_;
  Problem part_;  // with sticking joints held, and friction on sliding ones
  Control& control_;
  OneStep rests_;  // knows which joints rest and slide
  System free_;    // with nothing held but prescribed rates
  std::optional<SlidingTangents> tangents_;
  std::unique_ptr<System> probe_;  // of the part
  std::vector<const RubbingJoint*> switching_;
  bool ran_away_ = false;
};

void add(const SimulationStats& part, SimulationStats& sum) {
  sum.steps += part.steps;
  sum.residuals += part.residuals;
  sum.jacobians += part.jacobians;
  sum.newton_iterations += part.newton_iterations;
  sum.linear_iterations += part.linear_iterations;
  sum.failed_steps += part.failed_steps;
  sum.wall_time += part.wall_time;
}

/// Adds a part of the run: all its rows but the first, and the occurrences of the run's events.
void append(const Trajectory& part, const Sliding& sliding, Trajectory& out) {
  const auto add_row = [&](Eigen::Index k, const auto& from, auto& to, auto... rows) {
    (((to.*rows).row(out.done) = (from.*rows).row(k)), ...);
  };
  using Tangent = Trajectory::Tangent;
  for (Eigen::Index k = 1; k < part.done; ++k, ++out.done) {
    add_row(k, part, out, &Trajectory::q, &Trajectory::v, &Trajectory::a, &Trajectory::tau, &Trajectory::friction,
            &Trajectory::contacts, &Trajectory::loops);
    for (std::size_t p = 0; p < out.tangents.size(); ++p)
      add_row(k, part.tangents[p], out.tangents[p], &Tangent::q, &Tangent::v, &Tangent::a, &Tangent::tau,
              &Tangent::friction);
    sliding.separate(out, out.done);
  }
  for (std::size_t k = 0; k < out.events.size(); ++k) {
    const auto add_all = [&from = part.events[k], &to = out.events[k]](auto... lists) {
      ((to.*lists).insert((to.*lists).end(), (from.*lists).begin(), (from.*lists).end()), ...);
    };
    add_all(&EventLog::t, &EventLog::a, &EventLog::q_by, &EventLog::v_by);
    out.events[k].q.append(part.events[k].q);
    out.events[k].v.append(part.events[k].v);
  }
  add(part.stats, out.stats);
  out.reached = part.reached;
  out.failure = part.failure;
}

}  // namespace

Trajectory simulate_with_friction(const Problem& problem, const Eigen::VectorXd& t, const SmoothPart& integrate,
                                  Control& control, const std::vector<Parameter>& parameters) {
  Sliding sliding(problem, control, parameters);
  const Arm& arm = *problem.arm;
  const std::vector<Event>& events = problem.events;
  const double instant = kInstant * (t[t.size() - 1] - t[0]);
  Trajectory out = empty_trajectory(arm, t, events, parameters.size());
  out.rubs = true;
  Eigen::VectorXd q = problem.q0, v = problem.v0;
  const RubbingJoint* switched = nullptr;
  Trajectory part;
  std::deque<double> switches;
  try {
    for (;;) {
      const double now = out.reached;
      if (switched)
        sliding.settle(part, q, v, *switched, t[t.size() - 1] - t[0]);
      else
        sliding.settle(now, q, v, nullptr);
      if (sliding.sample(now, q, v)) sliding.settle(now, q, v, nullptr);
      for (; out.done < t.size() && t[out.done] <= now + instant; sliding.separate(out, out.done - 1))
        if (!sliding.record(now, q, v, out)) {
          if (out.done > 0) out.failure = kRanAway;  // it began well
          return out;
        }
      if (out.done == t.size()) return out;
      Eigen::VectorXd times(1 + t.size() - out.done);
      times << now, t.tail(t.size() - out.done);
      part = integrate(sliding.part(q, v, out), times, sliding.parameters());
      append(part, sliding, out);
      if (part.done == 0 && now > t[0] && !out.failure.empty() && out.failure != kInterrupted) out.failure = kRanAway;
      if (!out.failure.empty()) return out;
      if (!part.terminated) {
        sliding.end(out);
        return out;
      }
      if (sliding.ran_away()) {
        out.failure = kRanAway;
        return out;
      }
      for (std::size_t k = 0; k < events.size(); ++k)
        if (events[k].terminal > 0 && static_cast<int>(out.events[k].t.size()) == events[k].terminal)
          out.terminated = true;
      if (out.terminated) return out;
      for (std::size_t k = 0; k < sliding.switching().size(); ++k) {
        const EventLog& log = part.events[events.size() + k];
        if (log.t.empty()) continue;
        switched = sliding.switching()[k];
        q = log.q.back();
        v = log.v.back();
      }
      // Rows at the switch itself are those behind it. (A sample may have torn a joint loose.)
      while (out.done > 1 && t[out.done - 1] >= out.reached - instant) --out.done;
      ++out.stats.switches;
      switches.push_back(out.reached);
      if (switches.size() <= kMany) continue;
      switches.pop_front();
      if (switches.back() - switches.front() > kShort * (t[t.size() - 1] - t[0])) continue;
      out.failure = "the friction of joint coordinate '" + arm.coordinates()[switched->coordinate] +
                    "' switches without end: no state of sticking and sliding lasts";
      return out;
    }
  } catch (const Interrupted&) {
    out.failure = kInterrupted;
    return out;
  }
}

}  // namespace flexarm
