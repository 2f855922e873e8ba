#include "stepper.hpp"

#include <algorithm>
#include <limits>
#include <optional>
#include <sstream>
#include <utility>

#include "flexarm/quadrature.hpp"
#include "loops_told.hpp"

namespace flexarm {

namespace {

constexpr double kResolved = 1e-6;    // parts of a motion's velocity that a step may miss
constexpr double kCrawl = 1e-3;       // parts of a motion's largest speed: a slower one counts as that fast
constexpr double kInBetween = 1e-4;   // the same, at its samples
constexpr double kStill = 1e-10;      // speed (rad/s, m/s) below which a joint with dry friction may stick
constexpr double kSlack = 1e-9;       // parts of its stiction by which a joint may be held beyond it, at first
constexpr double kMostSlack = 1e-6;   // and at most
constexpr int kPlaces = 8;            // of an interpolated step, at which switches are looked for
constexpr double kOneTime = 1e-9;     // parts of a step that are no time
constexpr double kBehind = 1e-6;      // parts of a step behind its beginning, where a force that leaps there has leapt
constexpr int kSearch = 40;           // halvings of the time in which a switch is
constexpr double kDifference = 0.01;  // of a step, for the rate of a holding force
constexpr int kAims = 4;              // steps that try to end where a joint comes to rest, or a force has a kink
constexpr double kAtKink = 1e-4;      // parts of a step, at either end of it, in which a kink does not matter
constexpr double kFewSteps = 3.0;     // that resolve no swing, of a method that knows the ends of its steps alone
constexpr double kFirst = 0.02;       // parts of the run: the longest first step that is chosen
constexpr double kLongest = 0.25;     // and the longest at all
constexpr double kShortest = 1e-10;   // and the shortest whose error counts
constexpr double kWithin = 0.9;       // part of a step's length for an error that is just allowed, that is aimed at
constexpr double kLeastChange = 0.1, kMostChange = 4.0;  // of the length from one step to the next
constexpr double kWorthwhile = 1.2;  // a step that may grow by less keeps its length, and its matrices
constexpr double kNowForLength = 0.7, kBeforeForLength = 0.4;  // powers of the errors of this step and the one before
constexpr std::size_t kMany = 100;                             // so many switches within a step are no motion

/// Whether the Gauss points of a step resolve a prescribed motion: its acceleration and velocity there, integrated, are
/// its change of velocity and place, and at its samples in between (some of them, if they are many) its velocity is
/// the polynomial through theirs. A motion whose samples lie closer than the steps is looked at so, instead
/// of stopping at each.
/// @param speeds  of each motion, at its samples: values far below that are no motion
bool resolved(const std::vector<Drive>& drives, const std::vector<double>& speeds, double from, double h) {
  static const GaussRule rule(4);
  constexpr int kNodes = 6, kSamples = 8;
  const double x[kNodes] = {0.0, rule.points[0], rule.points[1], rule.points[2], rule.points[3], 1.0};
  for (std::size_t n = 0; n < drives.size(); ++n) {
    const Drive& d = drives[n];
    if (!d.motion) continue;
    MotionValue at[kNodes];
    double speed = 0.0, turn = 0.0, size = kCrawl * speeds[n];
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

}  // namespace

double next_stop(const std::vector<Drive>& drives, const std::vector<LoadDrive>& loads, const Control& control,
                 double reached, double until, double step, bool motions) {
  const double next = next_sample(drives, loads, control, reached + kSameTime * step, motions);
  return next <= until - kSameTime * step ? next : until;
}

Stepper::Stepper(const Problem& problem, Control& control, Step& method_, double step_, const Eigen::VectorXd& looks)
    : s(problem, control),
      reached(looks[0]),
      method(method_),
      step(step_),
      now_{looks[0], step_, std::nan("")},
      kinks_(s),
      pieces_(kinks_.count()),
      pieces_now_(pieces_),
      ways_(static_cast<std::size_t>(s.arm.nv()), Tape::free),
      q0_(s.q),
      v0_(s.v),
      start_(problem.q0),
      q1_(s.q),
      v1_(s.v),
      cubic_(s) {
  const double run = looks.size() > 1 ? looks[looks.size() - 1] - looks[0] : 1.0;
  same_ = kSameTime * step;
  if (method.chooses()) {
    same_ = 1e-14 * (std::abs(reached) + run);
    longest_ = kLongest * run;
    shortest_ = kShortest * run;
    wanted = std::min(kFirst * run, looks.size() > 1 ? looks[1] - looks[0] : run);
  }
  s.rubbing = method.rubbing();
  if (!method.switches_within())
    for (const Rub& rub : rubs(s.arm))
      if (!s.ws.prescribed[static_cast<std::size_t>(rub.rate)]) joints_.push_back({rub, kSlack, -1e300});
  if (!joints_.empty()) last_switches_.reserve(kMany + 1);
  s.q = problem.q0;
  s.v = problem.v0;
  if (method.interpolates()) speeds_ = speeds(problem.drives, looks);
  given_ = [this](double c) { s.drive(c == 1.0 && !std::isnan(now_.last) ? now_.last : now_.from + c * now_.h); };
}

void Stepper::begin() {
  for (const RubbingJoint& c : joints_)
    if (std::abs(s.v[c.of.rate]) <= kStill) s.v[c.of.rate] = 0.0;
  s.drive(reached);
  s.remember();
  look();
}

bool Stepper::look() {
  const double until = reached + same_;
  const bool due = tape_ && s.control.due(until), changed = s.sample(until);
  if (!due) return changed;
  const Eigen::Index place = tape_->add(reached, s.q, s.v, s.a);
  if (s.rubbing) s.rubbing->ways(s.v, true, tape_->last_ways());
  tape_->samples.push_back({static_cast<Eigen::Index>(tape_->entries.size()) - 1, place, until, s.control.held()});
  tape_->tau = s.control.held();
  return changed;
}

double Stepper::next_stop(double until) const {
  return flexarm::next_stop(s.drives, s.loads, s.control, reached, until, same_ / kSameTime, !method.interpolates());
}

double Stepper::length_to(double stop, double& last) const {
  const double whole = stop - reached, h = std::max(std::min(wanted, longest_), shortest_);
  last = std::nan("");
  if (whole > 4.0 * h) return h;
  const double count = std::max(1.0, std::ceil(whole / h - kSameTime));
  if (count == 1.0) last = stop;
  return whole / count;
}

bool Stepper::good_enough(double h, int tries) {
  const double found = std::max(method.error(), 1e-10), order = method.error_order();
  if (found > 1.0 && h > shortest_) {
    wanted = h * std::min(std::max(kWithin * std::pow(found, -1.0 / order), kLeastChange), 0.8);
    return false;
  }
  double change = kWithin * std::pow(found, -kNowForLength / order) * std::pow(error, kBeforeForLength / order);
  change = std::min(std::max(change, kLeastChange), tries > 0 ? 1.0 : kMostChange);
  if (change > 1.0 && change < kWorthwhile) change = 1.0;
  const bool cut = h < 0.9 * wanted;
  wanted = cut ? std::max(wanted, change * h) : change * h;
  error = found;
  return true;
}

Status Stepper::try_step(double from, double h, double last, int level) {
  now_ = {from, h, last};
  if (tape_) tape_->now = from;
  const bool visible = !method.interpolates() || level >= kLooks || resolved(s.drives, speeds_, from, h);
  return visible ? method.advance(h, s.ws, s.q, s.v, s.tau, given_) : Status::not_converged;
}

Status Stepper::end_at_kink(double from, double& h, double& last, int level) {
  const auto crossed = [&](double c) {
    method.inside(c, s.q, s.v);
    s.drive(from + c * h);
    kinks_.look(s, pieces_now_.data());
    return pieces_now_ != pieces_;
  };
  for (int aim = 0;; ++aim) {
    q1_ = s.q;
    v1_ = s.v;
    crossed(kAtKink);
    pieces_ = pieces_now_;
    double low = kAtKink, high = 1.0 - kAtKink;
    bool found = aim > 0 && crossed(high);
    for (int k = 1; k <= kPlaces && !found && aim == 0; ++k) {
      const double c = (1.0 - kAtKink) * static_cast<double>(k) / kPlaces;
      found = crossed(c);
      (found ? high : low) = c;
    }
    if (!found || aim == kAims || high * h < shortest_) {
      s.drive(std::isnan(last) ? from + h : last, q1_, v1_);
      return Status::ok;
    }
    while (high - low > 0.1 * kAtKink * high) {
      const double middle = 0.5 * (low + high);
      (crossed(middle) ? high : low) = middle;
    }
    take_back(from);
    h *= std::min((1.0 + 0.1 * kAtKink) * high, 1.0);  // a little behind
    last = std::nan("");
    if (const Status status = try_step(from, h, last, level); status != Status::ok) return status;
  }
}

Status Stepper::look_at_joints(Status status) {
  if (!joints_.empty() && status == Status::ok) s.rubbing->ways(s.v, true, ways_.data());
  return status;
}

/// A joint that no longer sticks, or slides as it did, at the system's state, which has been driven; or null.
Stepper::RubbingJoint* Stepper::broken() {
  bool held = false;
  for (RubbingJoint& c : joints_) {
    const signed char way = ways_[static_cast<std::size_t>(c.of.rate)];
    held = held || way == Tape::held;
    if (way != Tape::held && way * s.v[c.of.rate] < -kStill) return &c;
  }
  if (!held || s.accelerate(true) != Status::ok) return nullptr;  // the step itself tells the error
  for (RubbingJoint& c : joints_)
    if (ways_[static_cast<std::size_t>(c.of.rate)] == Tape::held &&
        std::abs(s.friction[c.of.rate]) > c.of.stiction * (1.0 + c.slack))
      return &c;
  return nullptr;
}

Status Stepper::end_at_switch(double from, double h, double last, int level, double& share) {
  q1_ = s.q;
  v1_ = s.v;
  const double end = std::isnan(last) ? from + h : last;
  const bool inside = method.interpolates();
  const auto look = [&](double c) {
    if (c == 1.0) {
      s.drive(end, q1_, v1_);
    } else if (inside) {
      method.inside(c, s.q, s.v);
      s.drive(from + c * h);
    } else if (c == 0.0) {
      s.drive(from, q0_, v0_);
    } else {
      cubic_.place(s, from + c * h);
    }
    return broken();
  };
  double low = 0.0, high = 1.0;
  switched_ = nullptr;
  for (int k = inside ? 1 : kPlaces; k <= kPlaces && !switched_; ++k) {
    const double c = static_cast<double>(k) / kPlaces;
    switched_ = look(c);
    (switched_ ? high : low) = c;
  }
  if (!switched_) return Status::ok;
  if (RubbingJoint* const first = look(0.0)) {  // other forces act than those under which it stuck
    switched_ = first;
    low = high = 0.0;
  } else if (!inside) {
    look(1.0);
    cubic_.prepare(s, from, q0_, v0_, end, true, [](double) {});
  }
  for (int k = 0; k < kSearch && high > low; ++k) {
    const double middle = 0.5 * (low + high);
    RubbingJoint* const found = look(middle);
    if (found) switched_ = found;
    (found ? high : low) = middle;
  }
  const signed char& way = ways_[static_cast<std::size_t>(switched_->of.rate)];
  was_ = way;
  forced_ = high == 0.0;
  share = way == Tape::held && !forced_ ? std::max(high, kBehind) : high;
  const auto rewind = [&] {
    s.drive(from, q0_, v0_);
    if (tape_) tape_->take_back();
  };
  // Gets faster where it should come to rest: the step that found this was too long for the motion.
  const auto unseen = [&] { return inside && level < kSplits && way * s.ws.a[switched_->of.rate] > 0.0; };
  for (int aim = 0;; ++aim) {
    rewind();
    if (share <= kOneTime) {
      share = 0.0;
      const bool slid = high > 0.0 && way != Tape::held;
      return slid && s.accelerate(true) == Status::ok && unseen() ? Status::not_converged : Status::ok;
    }
    if (const Status status = jump(); status != Status::ok) return status;
    if (way != was_) {  // the step began at the switch
      share = 0.0;
      return Status::ok;
    }
    if (share >= 1.0 - kOneTime) share = 1.0;
    const double stop = share == 1.0 ? last : std::nan("");
    if (const Status status = try_step(from, share * h, stop, level); status != Status::ok) return status;
    if (way == Tape::held) return Status::ok;
    if (const Status status = s.accelerate(true); status != Status::ok) return status;
    if (unseen()) {
      rewind();
      return Status::not_converged;
    }
    const double speed = s.v[switched_->of.rate], late = speed / (s.ws.a[switched_->of.rate] * h);
    if (share == 1.0 || std::abs(speed) <= kStill || aim + 1 == kAims || !(std::abs(late) < 0.1 * share))
      return Status::ok;
    share -= late;
  }
}

/// Of the switch that has ended a step; in the tape its place, and a leap.
Saltation Stepper::saltation(const RubbingJoint& now) {
  const int i = now.of.rate;
  s.drive(reached);
  if (s.accelerate(true) != Status::ok) s.ws.a.setZero();  // the next step says why
  const Eigen::VectorXd q = s.q, v = s.v, a = s.ws.a;
  tape_->entries.push_back({0.0, 1.0, tape_->add(reached, q, v, a)});
  signed char* ways = tape_->last_ways();
  std::copy(ways_.begin(), ways_.end(), ways);
  if (was_ != Tape::held) return Saltation::at_rest(i, a);
  const auto force = [&](double t, const Eigen::VectorXd& at, const Eigen::VectorXd& rates) {
    s.drive(t, at, rates);
    s.accelerate(true);
    return s.friction[i];
  };
  const double d =
      std::max(std::min(kDifference * usual(), 0.25 * (reached - now_.from)), 0.01 * kDifference * usual());
  const Saltation out = Saltation::torn(i, now.of.stiction, forced_, reached, q, v, a, d, force);
  s.q = q;
  s.v = v;
  ways[i] = out.tears > 0.0 ? Tape::torn_ahead : Tape::torn_back;
  return out;
}

Status Stepper::settle() {
  RubbingJoint& now = *switched_;
  const signed char& way = ways_[static_cast<std::size_t>(now.of.rate)];
  switched_ = nullptr;
  std::optional<Saltation> leap;
  if (tape_ && way == was_ && s.arm.nq() == s.arm.nv()) leap = saltation(now);
  for (const RubbingJoint& c : joints_)
    if (&c == &now || std::abs(s.v[c.of.rate]) <= kStill) s.v[c.of.rate] = 0.0;
  s.drive(reached);
  const double slack = now.slack;
  const Status status = jump();
  if (leap) {
    if (way == was_) leap->gap_rate = std::numeric_limits<double>::infinity();
    leap->end(s.ws.a);
    tape_->leaps.push_back(*std::move(leap));
  }
  last_switches_.push_back(reached);
  if (last_switches_.size() > kMany) {
    last_switches_.erase(last_switches_.begin());
    if (last_switches_.back() - last_switches_.front() <= usual()) {
      restless_ = &now;
      return Status::not_converged;
    }
  }
  now.slack = kSlack;
  if (way == was_) {
    now.slack = std::min(10.0 * slack, kMostSlack);  // it was seen a little early
    return status;
  }
  ++switches;
  const double few = method.chooses() ? 0.0 : method.interpolates() ? step : kFewSteps * step;
  hasty += reached - std::exchange(now.switched, reached) < few;
  return status;
}

Status Stepper::sample() { return look() ? jump() : Status::ok; }

std::string Stepper::reason(Status status) const {
  const double h = now_.h;
  std::ostringstream text;
  const std::string loops = told_of_loops(s, start_, reached, h);
  switch (status) {
    case Status::not_converged:
      if (restless_) {
        text << "the friction of joint coordinate '" << s.arm.coordinates()[restless_->of.rate]
             << "' switches without end: no state of sticking and sliding lasts, or the motion runs away: take a "
                "smaller step";
        break;
      }
      text << "the equations of a step of " << h
           << " s could not be solved: " << (loops.empty() ? "take a smaller step" : loops);
      break;
    case Status::not_finite:
      if (!loops.empty()) return loops;
      text << "the motion ran away in steps of " << h << " s";
      if (const std::string who = s.arm.farthest_out(s.q, s.v); !who.empty()) text << "; " << who << " and grows";
      text << ": " << method.remedy();
      break;
    default:
      text << "the mass matrix is singular";
  }
  return text.str();
}

}  // namespace flexarm
