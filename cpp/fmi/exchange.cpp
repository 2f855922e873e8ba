#include "exchange.hpp"

#include <algorithm>
#include <cmath>

#include "arrays.hpp"
#include "flexarm/ab.hpp"
#include "flexarm/check.hpp"

namespace flexarm {

namespace {

constexpr double kStill = 1e-9;         // speed (rad/s, m/s) below which a joint that rubs may stick
constexpr double kSlack = 1e-9;         // parts of its stiction by which a joint may be held beyond it
constexpr double kSameInstant = 1e-10;  // s, within which two times are one

}  // namespace

Exchange::Exchange(const Problem& problem, double t)
    : control_(problem.control()),
      s_(problem, control_),
      rubs_(rubs(*problem.arm)),
      ways_(static_cast<std::size_t>(problem.arm->nv()), Tape::free),
      t_(t),
      a_(Eigen::VectorXd::Zero(problem.arm->nv())),
      dq_(problem.q0) {
  refuse_loops(*problem.arm, "model exchange");
  refuse_contact_friction(*problem.arm, "model exchange");
  if (!rubs_.empty()) {
    rubbing_ = std::make_unique<OneStep>("rk4", s_.arm, 1.0, ImplicitOptions{}, DryFriction::left_to_caller);
    s_.rubbing = rubbing_.get();
  }
  rubs_.erase(std::remove_if(rubs_.begin(), rubs_.end(),
                             [this](const Rub& r) { return s_.ws.prescribed[static_cast<std::size_t>(r.rate)]; }),
              rubs_.end());
  s_.q = problem.q0;
  s_.v = problem.v0;
  s_.drive(t_);
  event();
  a();
}

void Exchange::set_time(double t) {
  if (!std::isfinite(t)) bad_value("time", t, "must be finite");
  if (t != t_) touch();
  t_ = t;
}

void Exchange::place(const double* x) {
  touch();
  for (const int i : s_.free_q) s_.q[i] = *x++;
  for (const int i : s_.ws.free) s_.v[i] = *x++;
}

void Exchange::drive() {
  if (driven_) return;
  s_.drive(t_);
  driven_ = true;
  reacted_ = sloped_ = false;
}

void Exchange::check(Status status) const {
  if (status == Status::ok) return;
  bad_value("the accelerations at t = " + std::to_string(t_), "none",
            status == Status::singular ? "the mass matrix is singular" : "state, inputs and forces must be finite");
}

const Eigen::VectorXd& Exchange::a() {
  drive();
  if (!fresh_) {
    check(s_.accelerate(true));
    a_ = s_.ws.a;
    fresh_ = true;
  }
  return a_;
}

const Eigen::VectorXd& Exchange::q() {
  drive();
  return s_.q;
}
const Eigen::VectorXd& Exchange::v() {
  drive();
  return s_.v;
}

const Eigen::VectorXd& Exchange::coordinate_rates() {
  drive();
  flexarm::coordinate_rates(s_.arm, s_.q, s_.v, dq_);
  return dq_;
}

const Eigen::VectorXd& Exchange::tau() {
  drive();
  if (!reacted_) {
    s_.a = a();
    if (const char* why = s_.react()) bad_value("forces at t = " + std::to_string(t_), "none", why);
    reacted_ = true;
  }
  return s_.ws.total;
}
const Eigen::VectorXd& Exchange::friction() {
  tau();
  return s_.friction;
}

void Exchange::event() {
  for (const Rub& r : rubs_) {
    const auto at = static_cast<std::size_t>(r.rate);
    const bool slid = ways_[at] == Tape::ahead || ways_[at] == Tape::back;
    if (!(slid ? ways_[at] * s_.v[r.rate] < kStill : std::abs(s_.v[r.rate]) <= kStill)) continue;
    s_.v[r.rate] = 0.0;
  }
  touch();
  drive();
  s_.remember();
  s_.sample(t_ + kSameInstant);
  if (rubbing_) {
    check(rubbing_->jump(s_.ws, s_.q, s_.v, s_.tau));
    rubbing_->ways(s_.v, true, ways_.data());
  }
  touch();
}

double Exchange::next_event() const { return next_sample(s_.drives, s_.loads, control_, t_ + kSameInstant); }

double Exchange::indicator(int rate) {
  const auto at = static_cast<std::size_t>(rate);
  drive();
  if (ways_[at] != Tape::held) return ways_[at] * s_.v[rate] + 0.1 * kStill;
  const auto found = std::find_if(rubs_.begin(), rubs_.end(), [rate](const Rub& r) { return r.rate == rate; });
  if (found == rubs_.end()) return 1.0;  // its motion is prescribed
  check(s_.accelerate(true));
  return 1.0 + kSlack - std::abs(s_.friction[rate]) / found->stiction;
}

void Exchange::linearise() {
  a();
  if (sloped_) return;
  const int nv = s_.arm.nv();
  std::vector<bool> held = s_.ws.prescribed;
  held.resize(static_cast<std::size_t>(nv), false);
  for (const Rub& r : rubs_)
    if (ways_[static_cast<std::size_t>(r.rate)] == Tape::held) held[static_cast<std::size_t>(r.rate)] = true;
  if (!slopes_ || held != held_) {
    std::vector<Load> loads = places(s_.loads);
    slopes_.emplace(s_.arm, loads, held);
    held_ = held;
  }
  for (std::size_t k = 0; k < s_.loads.size(); ++k) slopes_->set_wrench(k, s_.ws.loads[k].wrench);
  check(s_.accelerate(true));
  Eigen::VectorXd total = s_.tau;
  add_feedback(s_.ws, s_.q, s_.v, 1.0, total);
  for (const Rub& r : rubs_) total[r.rate] += s_.friction[r.rate];
  slopes_->a = a_;
  check((*slopes_)(s_.arm, s_.q, s_.v, total));
  law_q_ = Eigen::MatrixXd::Zero(nv, s_.arm.nq());
  law_v_ = Eigen::MatrixXd::Zero(nv, nv);
  add_feedback_slopes(s_.ws.feedback, s_.ws.limits, s_.q, s_.v, law_q_, law_v_);
  sloped_ = true;
}

void Exchange::limit(Eigen::VectorXd& force) {
  linearise();
  for (const AppliedLimit& l : s_.ws.limits)
    if (l.cut() != 0.0) force[l.rate] = 0.0;
}

Eigen::VectorXd Exchange::column(std::size_t law) {
  linearise();
  const AppliedFeedback& of = s_.ws.feedback.at(law);
  Eigen::VectorXd out = of.law->column;
  if (!(std::abs((*of.law)(of.offset, s_.q, s_.v)) < of.law->limit)) out.setZero();
  return out;
}

Eigen::VectorXd Exchange::slope(const Eigen::VectorXd& dq, const Eigen::VectorXd& dv, const Eigen::VectorXd& force,
                                const std::vector<Vec6<double>>& wrenches) {
  linearise();
  Eigen::VectorXd out = slopes_->dq * dq + slopes_->dv * dv + slopes_->dtau * (force - law_q_ * dq - law_v_ * dv);
  if (std::all_of(wrenches.begin(), wrenches.end(), [](const Vec6<double>& w) { return w.isZero(0.0); })) return out;
  for (std::size_t k = 0; k < wrenches.size(); ++k) s_.ws.loads[k].wrench += wrenches[k];  // accelerations are linear
  const Status status = s_.accelerate(true);
  out += s_.ws.a - a_;
  touch();
  drive();
  check(status);
  return out;
}

void Exchange::memory(const std::function<void(double&)>& visit) {
  visit(t_);
  for (Eigen::VectorXd* x : {&s_.q, &s_.v, &s_.a, &s_.ws.a})
    for (double& number : *x) visit(number);
  for (double& number : s_.ws.remembered) visit(number);
  for (signed char& way : ways_) {
    double number = way;
    visit(number);
    way = static_cast<signed char>(number);
  }
  if (rubbing_) rubbing_->memory(visit);
  control_.memory(visit);
  touch();
}

}  // namespace flexarm
