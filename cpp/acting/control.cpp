#include "flexarm/control.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "flexarm/arm.hpp"
#include "flexarm/check.hpp"

namespace flexarm {

std::vector<AppliedLimit> torque_limits(const Arm& arm) {
  std::vector<AppliedLimit> out;
  for (std::size_t n = 0; n < arm.size(); ++n) {
    const std::vector<JointForce>& forces = arm.link(n).joint().forces();
    for (std::size_t k = 0; k < forces.size(); ++k)
      if (std::isfinite(forces[k].torque_limit))
        out.push_back({arm.first(n) + static_cast<int>(k), forces[k].torque_limit});
  }
  return out;
}

void ask(std::vector<AppliedLimit>& limits, const std::vector<AppliedFeedback>& feedback,
         const Eigen::Ref<const Eigen::VectorXd>& q, const Eigen::Ref<const Eigen::VectorXd>& v) {
  for (AppliedLimit& l : limits) l.asked = l.given;
  for (std::size_t k = 0; !limits.empty() && k < feedback.size(); ++k) {
    const Feedback& law = *feedback[k].law;
    const double u = law(feedback[k].offset, q, v);
    for (AppliedLimit& l : limits) l.asked += u * law.column[l.rate];
  }
}

void sides(const std::vector<AppliedFeedback>& feedback, std::vector<AppliedLimit>& limits,
           const Eigen::Ref<const Eigen::VectorXd>& q, const Eigen::Ref<const Eigen::VectorXd>& v, signed char* out) {
  ask(limits, feedback, q, v);
  const auto side = [](double x, double most) { return static_cast<signed char>(x > most ? 1 : x < -most ? -1 : 0); };
  for (const AppliedFeedback& f : feedback) *out++ = side(f.law->wanted(f.offset, q, v), f.law->limit);
  for (const AppliedLimit& l : limits) *out++ = side(l.asked - l.friction, l.most);
}

void add_on_sides(const std::vector<AppliedFeedback>& feedback, const std::vector<AppliedLimit>& limits,
                  const signed char* side, const Eigen::Ref<const Eigen::VectorXd>& q,
                  const Eigen::Ref<const Eigen::VectorXd>& v, Eigen::Ref<Eigen::VectorXd> tau) {
  for (const AppliedFeedback& f : feedback) {
    const int beyond = *side++;
    tau += (beyond ? beyond * f.law->limit : f.law->wanted(f.offset, q, v)) * f.law->column;
  }
  for (const AppliedLimit& l : limits)
    if (const int beyond = *side++) tau[l.rate] = beyond * l.most + l.friction;
}

void add_feedback_slopes(const std::vector<AppliedFeedback>& feedback, std::vector<AppliedLimit>& limits,
                         const Eigen::VectorXd& q, const Eigen::VectorXd& v, Eigen::MatrixXd& dq, Eigen::MatrixXd& dv) {
  ask(limits, feedback, q, v);
  for (const AppliedFeedback& f : feedback) {
    if (!(std::abs((*f.law)(f.offset, q, v)) < f.law->limit)) continue;
    for (Eigen::Index i = 0; i < f.law->column.size(); ++i) {
      const double force = f.law->column[i];
      const auto here = [i](const AppliedLimit& l) { return l.rate == i && l.cut() != 0.0; };
      if (force == 0.0 || std::any_of(limits.begin(), limits.end(), here)) continue;
      dq.row(i) += force * f.law->by_q.transpose();
      dv.row(i) += force * f.law->by_v.transpose();
    }
  }
}

const Eigen::VectorXd& LinearLaw::sample(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                         const Eigen::VectorXd& a) {
  reference(t, e);
  if (read) {
    read(t, q, v, a, y);
  } else {
    y.noalias() = by_q * q;
    y.noalias() += by_v * v;
    if (offset.size() > 0) y += offset;
    for (Eigen::Index i = 0; i < resolution.size(); ++i)
      if (resolution[i] > 0.0) y[i] = std::floor(y[i] / resolution[i] + 0.5) * resolution[i];
  }
  if (y.size() != B.cols()) bad_value("measure", y.size(), "numbers; B has " + std::to_string(B.cols()) + " columns");
  if (e.size() != y.size()) bad_value("reference", e.size(), "numbers; must be " + std::to_string(y.size()));
  e -= y;
  starts = start.size() > 0 && t <= first;
  if (starts) x.noalias() = start * e;
  w = u0;
  w.noalias() += C * x;
  w.noalias() += D * e;
  if (limit.size() != w.size() || reach.size() != w.size())
    bad_value("limit", limit.size(), "numbers; must be one for each of " + std::to_string(w.size()) + " outputs");
  u = w.cwiseMax(-limit).cwiseMin(limit);
  if (w.hasNaN() || !u.allFinite())
    bad_value("control at t = " + std::to_string(t), "nan or inf", "must give finite numbers");
  cut_off = w.cwiseMax(-reach).cwiseMin(reach) - w;
  next.noalias() = A * x;
  next.noalias() += B * e;
  next.noalias() += windup * cut_off;
  x.swap(next);
  return u;
}

void LinearLaw::slopes(Eigen::MatrixXd& dx, const Eigen::MatrixXd& de, Eigen::MatrixXd& du) const {
  if (starts) dx = start * de;
  du = C * dx + D * de;
  Eigen::MatrixXd lost = Eigen::MatrixXd::Zero(du.rows(), du.cols());
  for (Eigen::Index i = 0; i < du.rows(); ++i)
    if (std::abs(w[i]) > reach[i]) lost.row(i) = -du.row(i);
  dx = A * dx + B * de + windup * lost;
  for (Eigen::Index i = 0; i < du.rows(); ++i)
    if (std::abs(w[i]) > limit[i]) du.row(i).setZero();
}

namespace {

constexpr double kOnTheirWay = 1000.0;  // samples for which there is memory from the start

/// Room for twice as many forces, of which those from `first` to `end` stand at their numbers modulo the room.
void make_room(std::vector<Eigen::VectorXd>& forces, long first, long end) {
  const std::size_t before = forces.size();
  std::vector<Eigen::VectorXd> more(2 * before, Eigen::VectorXd::Zero(forces.front().size()));
  for (auto k = static_cast<std::size_t>(first); k < static_cast<std::size_t>(end); ++k)
    more[k % more.size()] = forces[k % before];
  forces = std::move(more);
}

}  // namespace

Control::Control(std::vector<Feedback> feedback, std::vector<Sampler> samplers, int nv)
    : feedback_(std::move(feedback)), held_(Eigen::VectorXd::Zero(nv)) {
  for (Sampler& s : samplers) {
    positive("period", s.period);
    if (!(s.delay >= 0.0)) bad_value("delay", s.delay, "must be zero or positive");
    const auto most = static_cast<std::size_t>(std::min(s.delay / s.period, kOnTheirWay)) + 2;
    lines_.push_back({std::move(s), std::vector<Eigen::VectorXd>(most, held_), held_});
  }
}

double Control::next(double from) const {
  double found = std::numeric_limits<double>::infinity();
  for (const Line& l : lines_)
    for (double shift : {0.0, l.sampler.delay}) {
      const auto at = [&](long k) { return l.sample(k) + shift; };
      long k = std::max(0L, static_cast<long>(std::floor((from - shift - l.sampler.first) / l.sampler.period)));
      while (at(k) < from) ++k;
      found = std::min(found, at(k));
    }
  return found;
}

bool Control::due(double t) const {
  return std::any_of(lines_.begin(), lines_.end(), [t](const Line& l) { return l.looks(t) || l.changes(t); });
}

bool Control::run(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a) {
  bool changed = false;
  for (Line& l : lines_) {
    const auto act = [&] {
      const Eigen::VectorXd& force = l.at(l.acted++);
      changed = changed || force != l.force;
      held_ += force - l.force;
      l.force = force;
    };
    for (; l.looks(t); ++l.sampled) {
      if (l.sampled - l.acted == static_cast<long>(l.forces.size())) {
        if (l.changes(l.sample(l.sampled)))
          act();
        else
          make_room(l.forces, l.acted, l.sampled);
      }
      l.sampler.law(l.sample(l.sampled), q, v, a, l.at(l.sampled));
    }
    while (l.changes(t)) act();
  }
  return changed;
}

void Control::memory(const std::function<void(double&)>& visit) {
  const auto all = [&visit](Eigen::VectorXd& x) {
    for (double& number : x) visit(number);
  };
  const auto whole = [&visit](auto& count) {
    auto number = static_cast<double>(count);
    visit(number);
    count = static_cast<std::decay_t<decltype(count)>>(number);
  };
  all(held_);
  for (Line& l : lines_) {
    std::size_t room = l.forces.size();
    whole(room);
    whole(l.sampled);
    whole(l.acted);
    l.forces.resize(room, Eigen::VectorXd::Zero(held_.size()));
    for (Eigen::VectorXd& x : l.forces) all(x);
    all(l.force);
    if (LinearLaw* law = l.sampler.law.target<LinearLaw>()) all(law->x);
  }
}

}  // namespace flexarm
