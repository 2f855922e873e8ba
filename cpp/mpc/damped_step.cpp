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
constexpr int kChords = 4, kIterations = 25;
}  // namespace

DampedStep::DampedStep(const Arm& arm, const MatrixXd& columns, std::size_t count, double friction_speed)
    : arm_(arm), columns_(columns), speed_(friction_speed), ws_(arm), inverse_(arm) {
  const Index n = arm.nv(), m = 2 * n + columns.cols();
  Stage stage;
  stage.by_q = stage.by_v = MatrixXd::Zero(n, n);
  stage.a = VectorXd::Zero(n);
  stage.factor = Eigen::PartialPivLU<MatrixXd>(n);
  stages_.assign(2 * count, stage);
  coulomb_ = from_q_ = from_v_ = q_ = v_ = r_ = d_ = VectorXd::Zero(n);
  S_ = MatrixXd::Zero(n, n);
  by_ = first_ = dq_ = dv_ = MatrixXd::Zero(n, m);
  for (std::size_t link = 0; link < arm.size(); ++link) {
    const std::vector<JointForce>& forces = arm.link(link).joint().forces();
    for (std::size_t k = 0; k < forces.size() && static_cast<int>(k) < arm.link(link).nj(); ++k)
      coulomb_[arm.first(link) + static_cast<Index>(k)] = forces[k].coulomb;
  }
  composite_mass_matrix(arm, ws_, arm.zero());
  inertia_ = ws_.M.diagonal();
}

void DampedStep::residual(const VectorXd& a, double h, const VectorXd& tau) {
  v_ = from_v_ + h * a;
  q_ = from_q_ + h * v_;
  inverse_dynamics(arm_, ws_, q_, v_, a);
  r_ = ws_.tau - tau;
  for (Index i = 0; i < r_.size(); ++i)
    if (coulomb_[i] > 0.0) r_[i] += coulomb_[i] * v_[i] / std::hypot(v_[i], speed_);
}

/// At q_ and v_.
/// @param near  whether the solution is near; if not, friction's slope is force over speed: that does not overshoot
Status DampedStep::factor(Stage& stage, double h, bool near) {
  inverse_(arm_, q_, v_, stage.a);
  stage.by_q = inverse_.dq;
  stage.by_v = inverse_.dv;
  for (Index i = 0; i < r_.size(); ++i) {
    if (!(coulomb_[i] > 0.0)) continue;
    const double size = std::hypot(v_[i], speed_);
    stage.by_v(i, i) += coulomb_[i] / size * (near ? speed_ * speed_ / (size * size) : 1.0);
  }
  composite_mass_matrix(arm_, ws_, q_);
  S_ = ws_.M + h * stage.by_v + h * h * stage.by_q;
  if (!S_.allFinite()) return Status::not_finite;
  stage.factor.compute(S_);
  return Status::ok;
}

/// From from_q_ and from_v_ to q_ and v_.
Status DampedStep::solve(Stage& stage, double h, const VectorXd& tau) {
  if (!stage.known) stage.a.setZero();
  bool near = false;
  for (int k = 0; k < kIterations; ++k) {
    residual(stage.a, h, tau);
    if (!stage.known || k >= kChords)
      if (const Status status = factor(stage, h, near); status != Status::ok) return status;
    stage.known = true;
    d_ = stage.factor.solve(r_);
    stage.a -= d_;
    const double error = h * h * std::abs(d_.dot(r_));
    const double motion = inertia_.dot((v_.array().square() + h * h * stage.a.array().square()).matrix());
    if (!std::isfinite(error)) break;
    near = error < kNear * kNear * (motion + kStill);
    if (error > kError * kError * (motion + kStill)) continue;
    residual(stage.a, h, tau);
    return factor(stage, h, true);
  }
  stage.known = false;
  return stage.a.allFinite() ? Status::not_converged : Status::not_finite;
}

Status DampedStep::operator()(std::size_t which, double h, VectorXd& q, VectorXd& v, const VectorXd& tau) {
  Stage &one = stages_[2 * which], &two = stages_[2 * which + 1];
  last_ = which;
  h_ = h;
  from_q_ = q;
  from_v_ = v;
  if (const Status status = solve(one, kShare * h, tau); status != Status::ok) return status;
  from_q_ = q + (1.0 - kShare) * h * v_;
  from_v_ = v + (1.0 - kShare) * h * one.a;
  if (const Status status = solve(two, kShare * h, tau); status != Status::ok) return status;
  q = q_;
  v = v_;
  return arm_.within_reach(q, v) ? Status::ok : Status::not_finite;
}

/// With small changes of [q, v, inputs] at the beginning as columns, S da = columns du - K (dq~ + g h dv~) - C dv~.
void DampedStep::derivatives(MatrixXd& A, MatrixXd& B) {
  const Index n = arm_.nv(), nu = columns_.cols();
  const Stage &one = stages_[2 * last_], &two = stages_[2 * last_ + 1];
  const double g = kShare * h_, rest = (1.0 - kShare) * h_;
  by_.leftCols(n) = -one.by_q;
  by_.middleCols(n, n) = -g * one.by_q - one.by_v;
  by_.rightCols(nu) = columns_;
  first_.noalias() = one.factor.solve(by_);
  dv_ = rest * first_;  // to the second stage's beginning
  dv_.middleCols(n, n).diagonal().array() += 1.0;
  dq_ = (rest * g) * first_;
  dq_.leftCols(n).diagonal().array() += 1.0;
  dq_.middleCols(n, n).diagonal().array() += rest;
  first_ = dq_ + g * dv_;
  by_.setZero();
  by_.rightCols(nu) = columns_;
  by_.noalias() -= two.by_q * first_;
  by_.noalias() -= two.by_v * dv_;
  first_.noalias() = two.factor.solve(by_);
  dv_ += g * first_;
  dq_ += g * dv_;
  A.topRows(n) = dq_.leftCols(2 * n);
  A.bottomRows(n) = dv_.leftCols(2 * n);
  B.topRows(n) = dq_.rightCols(nu);
  B.bottomRows(n) = dv_.rightCols(nu);
}

}  // namespace flexarm
