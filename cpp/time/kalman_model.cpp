#include "kalman_model.hpp"

#include <algorithm>
#include <cmath>

#include "flexarm/ci.hpp"
#include "flexarm/dry_friction.hpp"

namespace flexarm {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr int kSame = 3;  // iterations with the derivatives of the beginning; then each has its own

std::vector<Link> with_a_kilogram(std::vector<Link> links) {
  RigidBody point;
  point.mass = 1.0;
  links.emplace_back(Joint::fixed(), point, std::nullopt, std::nullopt);
  return links;
}

}  // namespace

KalmanModel::Moving::Moving(const Problem& of)
    : control(of.feedback, {}, of.arm->nv()), s(of, control), inverse(*of.arm, places(of.loads)) {
  take_composite(*of.arm, s.ws);
}

void KalmanModel::Moving::differentiate(const VectorXd& q, const VectorXd& v, const VectorXd& a) {
  for (std::size_t k = 0; k < s.ws.loads.size(); ++k) inverse.set_wrench(k, s.ws.loads[k].wrench);
  inverse(s.arm, q, v, a);
  add_feedback_slopes(s.ws.feedback, s.ws.limits, q, v, inverse.dq, inverse.dv);
}

KalmanModel::Loaded::Loaded(const Problem& bare)
    : problem([&] {
        Problem out = bare;
        out.arm = std::make_shared<const Arm>(with_a_kilogram(bare.arm->links()), bare.arm->gravity());
        return out;
      }()),
      moving(problem) {}

KalmanModel::KalmanModel(const Problem& problem, double h, const std::vector<KalmanParameter>& parameters,
                         const KalmanOptions& options)
    : arm_(problem.arm.get()),
      parameters_(parameters),
      speed_(options.friction_speed),
      max_iterations_(options.max_iterations),
      payload_([&] {
        for (std::size_t k = 0; k < parameters.size(); ++k)
          if (parameters[k].kind == KalmanParameter::payload) return static_cast<int>(k);
        return -1;
      }()),
      h_(h),
      alpha_(options.spectral_radius, h),
      moving_(problem),
      s_(moving_.s),
      balls_(arm_->nq() != arm_->nv()) {
  const Eigen::Index n = arm_->nv(), m = static_cast<Eigen::Index>(parameters.size());
  if (payload_ >= 0) loaded_.emplace(problem);
  for (const Drive& d : problem.drives)
    if (d.motion) given_.emplace_back(d.coordinate, arm_->coordinate_of(d.coordinate));
  said_ = r_ = a0_ = a_ = turn_ = v0_ = tau_ = coulomb_ = damping_ = inertia_ = r0_ = rub_ = rubbing_ = slope_ = u_ =
      VectorXd::Zero(n);
  q0_ = arm_->zero();
  p_ = VectorXd::Zero(m);
  for (Instant* at : {&first_, &last_}) {
    at->by_q = at->by_v = at->by_a = MatrixXd::Zero(n, n);
    at->by_p = MatrixXd::Zero(n, m);
  }
  S_ = back_ = turned_ = MatrixXd::Identity(n, n);
  kilogram_by_q_ = kilogram_by_v_ = MatrixXd::Zero(n, n);
  if (balls_) {
    E_ = MatrixXd::Zero(arm_->nq(), n);
    E_by_q_ = MatrixXd::Zero(arm_->nq(), arm_->nq());
  }
  begin_.compute(S_);
  end_.compute(S_);
}

/// What acts at time t, into tau_; prescribed motions into the system's q, v and a.
void KalmanModel::drive(double t) {
  s_.drive(t);
  tau_ = s_.tau + said_;
  s_.ws.give(tau_.data());
  if (loaded_) {
    loaded_->moving.s.drive(t);
    loaded_->moving.s.ws.give(tau_.data());
  }
  r0_ = tau_;
  for (const AppliedLimit& l : s_.ws.limits) r0_[l.rate] = std::clamp(tau_[l.rate], -l.most, l.most);
  for (std::size_t k = 0; k < parameters_.size(); ++k) {
    const double value = p_[static_cast<Eigen::Index>(k)];
    const int i = parameters_[k].rate;
    if (parameters_[k].kind == KalmanParameter::offset) tau_[i] += value;
    if (parameters_[k].kind == KalmanParameter::gain) tau_[i] += value * r0_[i];
  }
}

void KalmanModel::hold_given(VectorXd& x) const {
  for (const auto& [rate, at] : given_) x[rate] = 0.0;
}

/// Leaves the equations of what is prescribed out.
void KalmanModel::hold_given(MatrixXd& S, bool columns) const {
  for (const auto& [rate, at] : given_) {
    S.row(rate).setZero();
    if (columns) S.col(rate).setZero();
    S(rate, rate) = 1.0;
  }
}

/// Into r_.
void KalmanModel::residual(const VectorXd& q, const VectorXd& v, const VectorXd& a) {
  inverse_dynamics(*arm_, s_.ws, q, v, a);
  r_ = s_.ws.tau - tau_;
  if (loaded_) {
    System& more = loaded_->moving.s;
    inverse_dynamics(more.arm, more.ws, q, v, a);
    r_ += mass_ * (more.ws.tau - s_.ws.tau);
  }
  for (Eigen::Index i = 0; i < r_.size(); ++i) r_[i] += damping_[i] * v[i] + coulomb_[i] * sliding(v[i]);
  hold_given(r_);
}

void KalmanModel::mass_matrix(const VectorXd& q, MatrixXd& M) {
  composite_mass_matrix(*arm_, s_.ws, q);
  M = s_.ws.M;
  if (!loaded_) return;
  System& more = loaded_->moving.s;
  composite_mass_matrix(more.arm, more.ws, q);
  M += mass_ * (more.ws.M - s_.ws.M);
}

/// Of the residual that was evaluated last, at the same q, v and a.
void KalmanModel::differentiate(const VectorXd& q, const VectorXd& v, const VectorXd& a, Instant& at) {
  if (balls_) coordinate_rate_jacobians(*arm_, q, v, E_by_q_, E_);
  const auto by_rates = [this](const MatrixXd& dq, MatrixXd& out) {
    if (balls_)
      out.noalias() = dq * E_;
    else
      out = dq;
  };
  moving_.differentiate(q, v, a);
  by_rates(moving_.inverse.dq, at.by_q);
  at.by_v = moving_.inverse.dv;
  if (loaded_) {
    InverseDerivatives& more = loaded_->moving.inverse;
    loaded_->moving.differentiate(q, v, a);
    more.dq -= moving_.inverse.dq;
    by_rates(more.dq, kilogram_by_q_);
    kilogram_by_v_ = more.dv - moving_.inverse.dv;
    at.by_q += mass_ * kilogram_by_q_;
    at.by_v += mass_ * kilogram_by_v_;
  }
  for (Eigen::Index i = 0; i < v.size(); ++i) {
    const double slope = 1.0 / std::hypot(v[i], speed_);
    slope_[i] = coulomb_[i] * speed_ * speed_ * slope * slope * slope;
    at.by_v(i, i) += damping_[i] + slope_[i];
  }
  at.by_p.setZero();
  for (std::size_t k = 0; k < parameters_.size(); ++k) {
    const int i = parameters_[k].rate;
    auto column = at.by_p.col(static_cast<Eigen::Index>(k));
    switch (parameters_[k].kind) {
      case KalmanParameter::payload:
        column = loaded_->moving.s.ws.tau - s_.ws.tau;
        break;
      case KalmanParameter::damping:
        column[i] = v[i];
        break;
      case KalmanParameter::coulomb:
        column[i] = sliding(v[i]);
        break;
      case KalmanParameter::offset:
        column[i] = -1.0;
        break;
      case KalmanParameter::gain:
        column[i] = -r0_[i];
        break;
    }
  }
}

Status KalmanModel::begin(const VectorXd& q, const VectorXd& v) {
  a0_.setZero();
  for (const auto& [rate, at] : given_) a0_[rate] = s_.a[rate];
  residual(q, v, a0_);
  mass_matrix(q, first_.by_a);
  if (!first_.by_a.allFinite() || !r_.allFinite()) return Status::not_finite;
  inertia_ = first_.by_a.diagonal();
  S_ = first_.by_a;
  hold_given(S_, true);
  begin_.compute(S_);
  if (begin_.info() != Eigen::Success) return Status::singular;
  begin_.solveInPlace(r_);
  a0_ -= r_;
  if (loaded_) residual(q, v, a0_);  // for derivatives by its mass
  differentiate(q, v, a0_, first_);
  return Status::ok;
}

/// What is prescribed is that of the step's end.
void KalmanModel::to_end(VectorXd& q, VectorXd& v) {
  u_ = h_ * v0_ + alpha_.q_by_a0 * a0_ + alpha_.q_by_a * a_;
  if (balls_)
    displace(*arm_, q0_, u_, q);
  else
    q = q0_ + u_;
  v = v0_ + alpha_.v_by_a0 * a0_ + alpha_.v_by_a * a_;
  for (const auto& [rate, at] : given_) {
    q[at] = s_.q[at];
    v[rate] = s_.v[rate];
  }
}

/// Newton's iteration would jump to and fro across the bend of friction. It does not where the force f of friction is
/// an unknown of its own: the law f = c v / w, w = sqrt(v^2 + speed^2), is linearised as w f = c v (Chan, Golub & Mulet
/// 1999), which has the slope (c - f v / w) / w.
void KalmanModel::rub(const VectorXd& v) {
  for (Eigen::Index i = 0; i < v.size(); ++i) {
    const double w = std::hypot(v[i], speed_);
    rubbing_[i] = (coulomb_[i] - rub_[i] * v[i] / w) / w;
  }
}

/// Matrix of the equations at the end by the accelerations there, from the derivatives of the last instant.
void KalmanModel::factor() {
  S_ = last_.by_a + alpha_.v_by_a * last_.by_v;
  if (balls_) {
    displace_slopes(*arm_, u_, back_, turned_);
    S_.noalias() += alpha_.q_by_a * last_.by_q * turned_;
  } else {
    S_ += alpha_.q_by_a * last_.by_q;
  }
  S_.diagonal() += alpha_.v_by_a * (rubbing_ - slope_);
  hold_given(S_, false);
  end_.compute(S_);
}

Status KalmanModel::step(double t, VectorXd& q, VectorXd& v, const VectorXd& p, const VectorXd& tau, double slack) {
  mass_ = payload_ >= 0 ? p[payload_] : 0.0;
  said_ = tau;
  p_ = p;
  coulomb_.setZero();
  damping_.setZero();
  for (std::size_t n = 0; n < arm_->size(); ++n)  // the arm's own
    for (std::size_t k = 0; k < arm_->link(n).joint().forces().size(); ++k)
      coulomb_[arm_->first(n) + static_cast<int>(k)] = arm_->link(n).joint().forces()[k].coulomb;
  for (std::size_t k = 0; k < parameters_.size(); ++k) {
    const double value = p[static_cast<Eigen::Index>(k)];
    const int i = parameters_[k].rate;
    if (parameters_[k].kind == KalmanParameter::damping) damping_[i] += value;
    if (parameters_[k].kind == KalmanParameter::coulomb) coulomb_[i] += value;
  }
  drive(t);
  q0_ = q;
  v0_ = v;
  for (const auto& [rate, at] : given_) {
    q0_[at] = s_.q[at];
    v0_[rate] = s_.v[rate];
  }
  if (const Status status = begin(q0_, v0_); status != Status::ok) return status;
  drive(t + h_);
  a_ = a0_;
  for (const auto& [rate, at] : given_) a_[rate] = s_.a[rate];
  last_ = first_;
  const bool rubs = !coulomb_.isZero(0.0);
  for (Eigen::Index i = 0; i < v.size(); ++i) rub_[i] = coulomb_[i] * sliding(v[i]);
  double before = 0.0;
  for (int iteration = 1; iteration <= max_iterations_; ++iteration) {
    to_end(q, v);
    if (rubs || iteration == 1 || iteration > kSame) {
      rub(v);
      factor();
    }
    residual(q, v, a_);
    if (!r_.allFinite()) return Status::not_finite;
    turn_ = end_.solve(r_);
    a_ -= turn_;
    for (Eigen::Index i = 0; i < v.size(); ++i) {
      const double now = coulomb_[i] * sliding(v[i]) - rubbing_[i] * alpha_.v_by_a * turn_[i],
                   most = std::abs(coulomb_[i]);
      rub_[i] = std::min(std::max(now, -most), most);
    }
    const double moved = alpha_.v_by_a * std::sqrt(turn_.cwiseAbs2().dot(inertia_));
    const double size = slack + std::sqrt(v.cwiseAbs2().dot(inertia_)) + h_ * std::sqrt(a_.cwiseAbs2().dot(inertia_));
    const bool stalled = iteration > 2 && moved > 0.5 * before && moved < 1e-7 * size;
    before = moved;
    to_end(q, v);
    const bool done = moved <= 1e-10 * size || stalled;
    if (!done && iteration < kSame) continue;
    residual(q, v, a_);
    mass_matrix(q, last_.by_a);
    differentiate(q, v, a_, last_);
    if (!done) continue;
    rubbing_ = slope_;
    factor();
    return S_.allFinite() && arm_->within_reach(q, v) ? Status::ok : Status::not_finite;
  }
  return Status::not_converged;
}

void KalmanModel::tangent(VectorXd& dq, VectorXd& dv, const VectorXd& dp, const VectorXd& dtau) {
  turn_ = dtau;
  turn_.noalias() -= first_.by_q * dq;
  turn_.noalias() -= first_.by_v * dv;
  if (dp.size() > 0) turn_.noalias() -= first_.by_p * dp;
  hold_given(turn_);
  begin_.solveInPlace(turn_);  // of a0
  u_ = h_ * dv + alpha_.q_by_a0 * turn_;
  if (balls_) {
    r_.noalias() = back_ * dq;
    dq = r_;
    dq.noalias() += turned_ * u_;
  } else {
    dq += u_;
  }
  dv += alpha_.v_by_a0 * turn_;
  hold_given(dq);
  hold_given(dv);
  turn_ = dtau;
  turn_.noalias() -= last_.by_q * dq;
  turn_.noalias() -= last_.by_v * dv;
  if (dp.size() > 0) turn_.noalias() -= last_.by_p * dp;
  hold_given(turn_);
  r_ = end_.solve(turn_);  // of a
  if (balls_)
    dq.noalias() += alpha_.q_by_a * turned_ * r_;
  else
    dq += alpha_.q_by_a * r_;
  dv += alpha_.v_by_a * r_;
}

void KalmanModel::bend(const VectorXd& dq, const VectorXd& dv, VectorXd& out) const {
  out.noalias() = kilogram_by_q_.lazyProduct(dq);
  out.noalias() += kilogram_by_v_.lazyProduct(dv);
  out.noalias() += (loaded_->moving.s.ws.M - s_.ws.M).lazyProduct(r_);
}

double KalmanModel::share() const {
  return ((loaded_->moving.s.ws.M - s_.ws.M).diagonal().array() / last_.by_a.diagonal().array()).maxCoeff();
}

}  // namespace flexarm
