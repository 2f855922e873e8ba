#include "damped_step.hpp"

#include <cmath>

#include "flexarm/ci.hpp"

namespace flexarm {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {
const double kShare = 1.0 - std::sqrt(0.5);  // of a step, in each stage
constexpr double kError = 1e-8;              // of velocities, as a part of those of the motion
constexpr double kStill = 1e-12;             // twice the kinetic energy of what does not matter (J)
constexpr double kNear = 1e-2;               // the same, below which slopes of friction are the true ones
constexpr double kSame = 1e-3;               // of the length of a step, by which a matrix still serves
constexpr int kChords = 4, kIterations = 25;
}  // namespace

DampedStep::DampedStep(const Problem& problem, const MatrixXd& columns, std::size_t count, double friction_speed)
    : arm_(*problem.arm),
      columns_(columns),
      speed_(friction_speed),
      control_(problem.feedback, {}, arm_.nv()),
      s_(problem, control_),
      inverse_(arm_, places(problem.loads)),
      balls_(arm_.nq() != arm_.nv()) {
  const Index n = arm_.nv(), m = 2 * n + columns.cols();
  Stage stage;
  stage.by_q = stage.by_v = MatrixXd::Zero(n, n);
  if (balls_) {
    stage.back = stage.turn = MatrixXd::Identity(n, n);
    E_ = MatrixXd::Zero(arm_.nq(), n);
    E_by_q_ = MatrixXd::Zero(arm_.nq(), arm_.nq());
  }
  stage.a = VectorXd::Zero(n);
  stage.cut.assign(s_.ws.limits.size(), 0);
  stage.factor = Eigen::PartialPivLU<MatrixXd>(n);
  stages_.assign(2 * count, stage);
  coulomb_ = from_u_ = from_v_ = given_v_ = tau_ = u_ = r_ = d_ = VectorXd::Zero(n);
  from_q_ = given_q_ = arm_.zero();
  input_ = VectorXd::Zero(columns.cols());
  S_ = MatrixXd::Zero(n, n);
  by_ = first_ = du_ = dv_ = dq_ = MatrixXd::Zero(n, m);
  for (const Drive& d : problem.drives)
    if (d.motion) given_.emplace_back(d.coordinate, arm_.coordinate_of(d.coordinate));
  for (std::size_t link = 0; link < arm_.size(); ++link) {
    const std::vector<JointForce>& forces = arm_.link(link).joint().forces();
    for (std::size_t k = 0; k < forces.size() && static_cast<int>(k) < arm_.link(link).nj(); ++k)
      coulomb_[arm_.first(link) + static_cast<Index>(k)] = forces[k].coulomb;
  }
  for (const auto& [rate, at] : given_) coulomb_[rate] = 0.0;
  composite_mass_matrix(arm_, s_.ws, arm_.zero());
  inertia_ = s_.ws.M.diagonal();
}

/// What is prescribed does not change, and what it was before the step does not matter.
void DampedStep::keep_given(MatrixXd& rows) const {
  for (const auto& [rate, at] : given_) {
    rows.row(rate).setZero();
    rows.col(rate).setZero();
    rows.col(arm_.nv() + rate).setZero();
  }
}

void DampedStep::residual(const VectorXd& a, double h) {
  s_.v = from_v_ + h * a;
  for (const auto& [rate, at] : given_) s_.v[rate] = given_v_[rate];
  u_ = from_u_ + h * s_.v;
  if (balls_)
    displace(arm_, from_q_, u_, s_.q);
  else
    s_.q = from_q_ + u_;
  for (const auto& [rate, at] : given_) s_.q[at] = given_q_[at];
  inverse_dynamics(arm_, s_.ws, s_.q, s_.v, a);
  r_ = s_.ws.tau - tau_;
  for (Index i = 0; i < r_.size(); ++i)
    if (coulomb_[i] > 0.0) r_[i] += coulomb_[i] * s_.v[i] / std::hypot(s_.v[i], speed_);
  for (const auto& [rate, at] : given_) r_[rate] = 0.0;
}

/// At the system's q and v.
/// @param near  whether the solution is near; if not, friction's slope is force over speed: that does not overshoot
Status DampedStep::factor(Stage& stage, double h, bool near) {
  for (std::size_t k = 0; k < s_.ws.loads.size(); ++k) inverse_.set_wrench(k, s_.ws.loads[k].wrench);
  inverse_(arm_, s_.q, s_.v, stage.a);
  add_feedback_slopes(s_.ws.feedback, s_.ws.limits, s_.q, s_.v, inverse_.dq, inverse_.dv);
  stage.by_v = inverse_.dv;
  for (Index i = 0; i < r_.size(); ++i) {
    if (!(coulomb_[i] > 0.0)) continue;
    const double size = std::hypot(s_.v[i], speed_);
    stage.by_v(i, i) += coulomb_[i] / size * (near ? speed_ * speed_ / (size * size) : 1.0);
  }
  composite_mass_matrix(arm_, s_.ws, s_.q);
  S_ = s_.ws.M + h * stage.by_v;
  if (balls_) {
    coordinate_rate_jacobians(arm_, s_.q, s_.v, E_by_q_, E_);
    stage.by_q.noalias() = inverse_.dq * E_;
    displace_slopes(arm_, u_, stage.back, stage.turn);
    S_.noalias() += h * h * stage.by_q * stage.turn;
  } else {
    stage.by_q = inverse_.dq;
    S_ += h * h * stage.by_q;
  }
  if (!S_.allFinite()) return Status::not_finite;
  for (const auto& [rate, at] : given_) {
    S_.row(rate).setZero();
    S_(rate, rate) = 1.0;
  }
  stage.factor.compute(S_);
  for (std::size_t k = 0; k < stage.cut.size(); ++k) stage.cut[k] = s_.ws.limits[k].cut() != 0.0;
  stage.h = h;
  return Status::ok;
}

/// From from_q_, from_u_ and from_v_ to the system's q and v, at time t.
Status DampedStep::solve(Stage& stage, double t, double h) {
  if (stage.h == 0.0) stage.a.setZero();
  s_.drive(t);
  given_q_ = s_.q;
  given_v_ = s_.v;
  for (const auto& [rate, at] : given_) stage.a[rate] = s_.a[rate];
  tau_ = s_.tau;
  tau_.noalias() += columns_ * input_;
  s_.ws.give(tau_.data());
  bool near = false;
  for (int k = 0; k < kIterations; ++k) {
    residual(stage.a, h);
    if (k >= kChords || !(std::abs(stage.h - h) <= kSame * h))
      if (const Status status = factor(stage, h, near); status != Status::ok) return status;
    d_ = stage.factor.solve(r_);
    stage.a -= d_;
    const double error = h * h * std::abs(d_.dot(r_));
    const double motion = inertia_.dot((s_.v.array().square() + h * h * stage.a.array().square()).matrix());
    if (!std::isfinite(error)) break;
    near = error < kNear * kNear * (motion + kStill);
    if (error > kError * kError * (motion + kStill)) continue;
    residual(stage.a, h);
    return factor(stage, h, true);
  }
  stage.h = 0.0;
  return stage.a.allFinite() ? Status::not_converged : Status::not_finite;
}

Status DampedStep::operator()(std::size_t which, double t, double h, VectorXd& q, VectorXd& v, const VectorXd& u) {
  Stage &one = stages_[2 * which], &two = stages_[2 * which + 1];
  last_ = which;
  h_ = h;
  const double g = kShare * h, rest = (1.0 - kShare) * h;
  input_ = u;
  from_q_ = q;
  from_u_.setZero();
  from_v_ = v;
  if (const Status status = solve(one, t + g, g); status != Status::ok) return status;
  from_u_ = rest * s_.v;
  from_v_ = v + rest * one.a;
  if (const Status status = solve(two, t + h, g); status != Status::ok) return status;
  q = s_.q;
  v = s_.v;
  return arm_.within_reach(q, v) ? Status::ok : Status::not_finite;
}

/// With small changes of [q, v, inputs] at the beginning as columns: at a stage those of the displacement and of v are
/// du~ + g h dv and dv~ + g h da, that of q is back dq + turn du, and with K and C its slopes by q and v,
/// S da = columns dinputs - K (back dq + turn (du~ + g h dv~)) - C dv~.
void DampedStep::derivatives(MatrixXd& A, MatrixXd& B) {
  const Index n = arm_.nv(), nu = columns_.cols();
  const Stage &one = stages_[2 * last_], &two = stages_[2 * last_ + 1];
  const double g = kShare * h_, rest = (1.0 - kShare) * h_;
  const auto accelerate = [&](const Stage& stage) {
    by_.rightCols(nu) += columns_;
    for (std::size_t k = 0; k < stage.cut.size(); ++k)  // a motor at its limit gives no more
      if (stage.cut[k]) by_.row(s_.ws.limits[k].rate).tail(nu) -= columns_.row(s_.ws.limits[k].rate);
    keep_given(by_);
    first_.noalias() = stage.factor.solve(by_);
  };
  const auto turned = [&] {  // du_ to dq_, of the second stage
    if (!balls_) {
      dq_ = du_;
      dq_.leftCols(n).diagonal().array() += 1.0;
    } else {
      dq_.noalias() = two.turn * du_;
      dq_.leftCols(n) += two.back;
    }
    keep_given(dq_);
  };
  by_.rightCols(nu).setZero();
  if (balls_) {
    by_.leftCols(n).noalias() = -one.by_q * one.back;
    by_.middleCols(n, n).noalias() = -g * one.by_q * one.turn;
  } else {
    by_.leftCols(n) = -one.by_q;
    by_.middleCols(n, n) = -g * one.by_q;
  }
  by_.middleCols(n, n) -= one.by_v;
  accelerate(one);
  dv_ = rest * first_;  // to the second stage's beginning
  dv_.middleCols(n, n).diagonal().array() += 1.0;
  du_ = (rest * g) * first_ + g * dv_;
  du_.middleCols(n, n).diagonal().array() += rest;
  turned();
  by_.setZero();
  by_.noalias() -= two.by_q * dq_;
  by_.noalias() -= two.by_v * dv_;
  accelerate(two);
  dv_ += g * first_;
  du_ += g * g * first_;
  turned();
  keep_given(dv_);
  A.topRows(n) = dq_.leftCols(2 * n);
  A.bottomRows(n) = dv_.leftCols(2 * n);
  B.topRows(n) = dq_.rightCols(nu);
  B.bottomRows(n) = dv_.rightCols(nu);
}

}  // namespace flexarm
