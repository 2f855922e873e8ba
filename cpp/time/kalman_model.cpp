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

KalmanModel::Loaded::Loaded(const Arm& bare)
    : arm(with_a_kilogram(bare.links()), bare.gravity()), ws(arm), inverse(arm) {
  take_composite(arm, ws);
}

KalmanModel::KalmanModel(const Arm& arm, double h, const std::vector<KalmanParameter>& parameters,
                         const KalmanOptions& options)
    : arm_(&arm),
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
      ws_(arm),
      inverse_(arm),
      limits_(torque_limits(arm)) {
  const Eigen::Index n = arm.nv(), m = static_cast<Eigen::Index>(parameters.size());
  if (payload_ >= 0) loaded_.emplace(arm);
  take_composite(arm, ws_);
  zero_ = r_ = a0_ = a_ = turn_ = q0_ = v0_ = tau_ = coulomb_ = damping_ = inertia_ = r0_ = rub_ = rubbing_ = slope_ =
      VectorXd::Zero(n);
  p_ = VectorXd::Zero(m);
  for (Instant* at : {&first_, &last_}) {
    at->by_q = at->by_v = at->by_a = MatrixXd::Zero(n, n);
    at->by_p = MatrixXd::Zero(n, m);
  }
  S_ = MatrixXd::Identity(n, n);
  begin_.compute(S_);
  end_.compute(S_);
}

/// Into r_.
void KalmanModel::residual(const VectorXd& q, const VectorXd& v, const VectorXd& a) {
  inverse_dynamics(*arm_, ws_, q, v, a);
  r_ = ws_.tau - tau_;
  if (loaded_) {
    inverse_dynamics(loaded_->arm, loaded_->ws, q, v, a);
    r_ += mass_ * (loaded_->ws.tau - ws_.tau);
  }
  for (Eigen::Index i = 0; i < r_.size(); ++i) r_[i] += damping_[i] * v[i] + coulomb_[i] * sliding(v[i]);
}

void KalmanModel::mass_matrix(const VectorXd& q, MatrixXd& M) {
  composite_mass_matrix(*arm_, ws_, q);
  M = ws_.M;
  if (!loaded_) return;
  composite_mass_matrix(loaded_->arm, loaded_->ws, q);
  M += mass_ * (loaded_->ws.M - ws_.M);
}

/// Of the residual that was evaluated last, at the same q, v and a.
void KalmanModel::differentiate(const VectorXd& q, const VectorXd& v, const VectorXd& a, Instant& at) {
  inverse_(*arm_, q, v, a);
  at.by_q = inverse_.dq;
  at.by_v = inverse_.dv;
  if (loaded_) {
    loaded_->inverse(loaded_->arm, q, v, a);
    at.by_q += mass_ * (loaded_->inverse.dq - inverse_.dq);
    at.by_v += mass_ * (loaded_->inverse.dv - inverse_.dv);
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
        column = loaded_->ws.tau - ws_.tau;
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
  residual(q, v, zero_);
  mass_matrix(q, first_.by_a);
  if (!first_.by_a.allFinite() || !r_.allFinite()) return Status::not_finite;
  inertia_ = first_.by_a.diagonal();
  begin_.compute(first_.by_a);
  if (begin_.info() != Eigen::Success) return Status::singular;
  a0_ = -r_;
  begin_.solveInPlace(a0_);
  if (loaded_) residual(q, v, a0_);  // for derivatives by its mass
  differentiate(q, v, a0_, first_);
  return Status::ok;
}

void KalmanModel::to_end(VectorXd& q, VectorXd& v) {
  q = q0_ + h_ * v0_ + alpha_.q_by_a0 * a0_ + alpha_.q_by_a * a_;
  v = v0_ + alpha_.v_by_a0 * a0_ + alpha_.v_by_a * a_;
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
  S_ = last_.by_a + alpha_.v_by_a * last_.by_v + alpha_.q_by_a * last_.by_q;
  S_.diagonal() += alpha_.v_by_a * (rubbing_ - slope_);
  end_.compute(S_);
}

Status KalmanModel::step(VectorXd& q, VectorXd& v, const VectorXd& p, const VectorXd& tau, double slack) {
  mass_ = payload_ >= 0 ? p[payload_] : 0.0;
  tau_ = tau;
  for (AppliedLimit& l : limits_) {
    l.asked = tau[l.rate];
    tau_[l.rate] = l.force();
  }
  r0_ = tau_;
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
    if (parameters_[k].kind == KalmanParameter::offset) tau_[i] += value;
    if (parameters_[k].kind == KalmanParameter::gain) tau_[i] += value * r0_[i];
  }
  q0_ = q;
  v0_ = v;
  if (const Status status = begin(q, v); status != Status::ok) return status;
  a_ = a0_;
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
  begin_.solveInPlace(turn_);  // of a0
  dq += h_ * dv + alpha_.q_by_a0 * turn_;
  dv += alpha_.v_by_a0 * turn_;
  turn_ = dtau;
  turn_.noalias() -= last_.by_q * dq;
  turn_.noalias() -= last_.by_v * dv;
  if (dp.size() > 0) turn_.noalias() -= last_.by_p * dp;
  r_ = end_.solve(turn_);  // of a
  dq += alpha_.q_by_a * r_;
  dv += alpha_.v_by_a * r_;
}

void KalmanModel::bend(const VectorXd& dq, const VectorXd& dv, VectorXd& out) const {
  out.noalias() = (loaded_->inverse.dq - inverse_.dq).lazyProduct(dq);
  out.noalias() += (loaded_->inverse.dv - inverse_.dv).lazyProduct(dv);
  out.noalias() += (loaded_->ws.M - ws_.M).lazyProduct(r_);
}

double KalmanModel::share() const {
  return ((loaded_->ws.M - ws_.M).diagonal().array() / last_.by_a.diagonal().array()).maxCoeff();
}

}  // namespace flexarm
