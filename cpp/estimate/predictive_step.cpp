#include "predictive_step.hpp"

#include <algorithm>
#include <cmath>

#include "flexarm/ci.hpp"
#include "step/newton.hpp"

namespace flexarm {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kError = 1e-10;  // of velocities, as a part of those of the motion
constexpr double kFloor = 1e-7;   // the same of an iteration that stalls at the end of its digits
constexpr double kBest = 1e-3;    // contraction that is believed without having been measured
constexpr double kStill = 1e-10;  // twice a kinetic energy that does not matter (J)
constexpr double kSame = 1e-3;    // of the length of a step, by which a matrix still serves
constexpr double kTurned = 1e-3;  // of a matrix, by which slopes of friction may be off
constexpr int kChords = 4, kIterations = 25;
constexpr Index kColumns = 32, kLarge = 128;  // of a product at once; rows, from which on it is one

/// f of columns of x and of `to`, few at a time: larger products of Eigen's, and solutions, take memory of the heap.
template <class X, class To, class F>
void by_columns(const X& x, To&& to, const F& f) {
  const Index n = x.cols();
  if (x.rows() > kLarge)
    for (Index j = 0; j < n; ++j) f(x.col(j), to.col(j));
  else
    for (Index j = 0; j < n; j += kColumns)
      f(x.middleCols(j, std::min(kColumns, n - j)), to.middleCols(j, std::min(kColumns, n - j)));
}
/// to += factor A x
template <class X, class To>
void add(double factor, const MatrixXd& A, const X& x, To&& to) {
  by_columns(x, to, [&](const auto& some, auto&& sum) { sum.noalias() += factor * A * some; });
}
/// to = factor A x
template <class X, class To>
void multiply(double factor, const MatrixXd& A, const X& x, To&& to) {
  to.setZero();
  add(factor, A, x, to);
}

/// Of the arm with 1 kg at the end of its last link.
Problem with_a_kilogram(Problem problem) {
  std::vector<Link> links = problem.arm->links();
  std::vector<Arm::Seat> seats = problem.arm->seats();
  RigidBody point;
  point.mass = 1.0;
  seats.emplace_back(static_cast<int>(links.size()) - 1);
  links.emplace_back(Joint::fixed(), point, std::nullopt, std::nullopt);
  problem.arm = std::make_shared<const Arm>(std::move(links), problem.arm->gravity(), std::move(seats),
                                            problem.arm->struts(), problem.arm->contacts(), problem.arm->loops());
  return problem;
}

}  // namespace

ImplicitStages ImplicitStages::two() {
  const double g = 1.0 - std::sqrt(0.5);
  return {(MatrixXd(2, 2) << g, 0.0, 1.0 - g, g).finished()};
}

ImplicitStages ImplicitStages::five() {
  MatrixXd w = MatrixXd::Zero(5, 5);
  w.diagonal().setConstant(0.25);
  w(1, 0) = 1.0 / 2;
  w.row(2).head(2) << 17.0 / 50, -1.0 / 25;
  w.row(3).head(3) << 371.0 / 1360, -137.0 / 2720, 15.0 / 544;
  w.row(4).head(4) << 25.0 / 24, -49.0 / 48, 125.0 / 16, -85.0 / 12;
  return {w};
}

PredictiveStep::Moving::Moving(const Problem& of)
    : control(of.feedback, {}, of.arm->nv()), s(of, control), inverse(*of.arm, places(of.loads)) {
  composite_mass_matrix(*of.arm, s.ws, of.arm->zero());
}

/// Derivatives and mass matrix where inverse dynamics was evaluated last.
void PredictiveStep::Moving::differentiate(const VectorXd& q, const VectorXd& v, const VectorXd& a) {
  for (std::size_t k = 0; k < s.ws.loads.size(); ++k) inverse.set_wrench(k, s.ws.loads[k].wrench);
  inverse(s.arm, q, v, a);
  add_feedback_slopes(s.ws.feedback, s.ws.limits, q, v, inverse.dq, inverse.dv);
  composite_mass_matrix(s.arm, s.ws, q);
}

PredictiveStep::PredictiveStep(const Problem& problem, MatrixXd columns, const std::vector<KalmanParameter>& parameters,
                               double friction_speed, std::size_t count, ImplicitStages by)
    : arm_(*problem.arm),
      columns_(std::move(columns)),
      parameters_(parameters),
      speed_(friction_speed),
      weights_(std::move(by.weights)),
      moving_(problem),
      s_(moving_.s),
      balls_(arm_.nq() != arm_.nv()) {
  const Index n = arm_.nv(), np = static_cast<Index>(parameters.size()), m = 2 * n + columns_.cols() + np;
  for (const KalmanParameter& p : parameters)
    if (p.kind == KalmanParameter::payload) more_.emplace(heavier_.emplace(with_a_kilogram(problem)));
  Stage stage;
  stage.by_q = stage.by_v = MatrixXd::Zero(n, n);
  stage.S = MatrixXd::Identity(n, n);
  stage.by_p = MatrixXd::Zero(n, np);
  if (balls_) {
    stage.back = stage.turn = MatrixXd::Identity(n, n);
    E_ = MatrixXd::Zero(arm_.nq(), n);
    E_by_q_ = MatrixXd::Zero(arm_.nq(), arm_.nq());
  }
  stage.v = stage.a = stage.slopes = VectorXd::Zero(n);
  stage.cut.assign(s_.ws.limits.size(), 0);
  stage.factor = Eigen::PartialPivLU<MatrixXd>(n);
  stages_.assign(static_cast<std::size_t>(weights_.rows()) * count, stage);
  own_ = coulomb_ = damping_ = rub_ = rubbing_ = slope_ = from_u_ = from_v_ = given_v_ = tau_ = u_ = r_ = d_ = forces_ =
      commanded_ = VectorXd::Zero(n);
  from_q_ = given_q_ = arm_.zero();
  p_ = VectorXd::Zero(np);
  S_ = MatrixXd::Zero(n, n);
  by_ = du_ = dq_ = MatrixXd::Zero(n, m);
  dv_of_.assign(static_cast<std::size_t>(weights_.rows()), by_);
  da_of_ = dv_of_;
  if (more_) {
    bend_ = by_;
    kilogram_ = kilogram_by_q_ = kilogram_by_v_ = stage.by_q;
  }
  for (const Drive& d : problem.drives)
    if (d.motion) given_.emplace_back(d.coordinate, arm_.coordinate_of(d.coordinate));
  for (const Rub& rub : rubs(arm_)) own_[rub.rate] = rub.coulomb;
  inertia_ = s_.ws.M.diagonal();
}

/// Prescribed motions do not change, and their values before the step do not matter.
void PredictiveStep::keep_given(MatrixXd& rows) const {
  for (const auto& [rate, at] : given_) {
    rows.row(rate).setZero();
    rows.col(rate).setZero();
    rows.col(arm_.nv() + rate).setZero();
  }
}

void PredictiveStep::take(const VectorXd& p) {
  p_ = p;
  coulomb_ = own_;
  damping_.setZero();
  for (std::size_t k = 0; k < parameters_.size(); ++k) {
    const double value = p[static_cast<Index>(k)];
    if (parameters_[k].kind == KalmanParameter::payload) mass_ = value;
    if (parameters_[k].kind == KalmanParameter::damping) damping_[parameters_[k].rate] += value;
    if (parameters_[k].kind == KalmanParameter::coulomb) coulomb_[parameters_[k].rate] += value;
  }
  for (const auto& [rate, at] : given_) coulomb_[rate] = 0.0;
}

/// Forces at time t, into tau_, and prescribed motions.
void PredictiveStep::drive(Stage& stage, double t) {
  s_.drive(t);
  given_q_ = s_.q;
  given_v_ = s_.v;
  for (const auto& [rate, at] : given_) stage.a[rate] = s_.a[rate];
  tau_ = s_.tau + forces_;
  s_.ws.give(tau_.data());
  if (more_) {
    more_->s.drive(t);
    more_->s.ws.give(tau_.data());
  }
  if (parameters_.empty()) return;
  commanded_ = tau_;
  for (const AppliedLimit& l : s_.ws.limits) commanded_[l.rate] = std::clamp(tau_[l.rate], -l.most, l.most);
  for (std::size_t k = 0; k < parameters_.size(); ++k) {
    const double value = p_[static_cast<Index>(k)];
    const int i = parameters_[k].rate;
    if (parameters_[k].kind == KalmanParameter::offset) tau_[i] += value;
    if (parameters_[k].kind == KalmanParameter::gain) tau_[i] += value * commanded_[i];
  }
}

/// Into r_, at the system's q and v, which follow from a.
void PredictiveStep::residual(const VectorXd& a, double h) {
  s_.v = from_v_ + h * a;
  for (const auto& [rate, at] : given_) s_.v[rate] = given_v_[rate];
  u_ = from_u_ + h * s_.v;
  if (balls_)
    displace(arm_, from_q_, u_, s_.q);
  else
    s_.q = from_q_ + u_;
  for (const auto& [rate, at] : given_) s_.q[at] = given_q_[at];
  inverse_dynamics(arm_, s_.ws, s_.q, s_.v, a);
  r_ = s_.ws.tau - tau_ + damping_.cwiseProduct(s_.v);
  if (more_) {
    inverse_dynamics(more_->s.arm, more_->s.ws, s_.q, s_.v, a);
    r_ += mass_ * (more_->s.ws.tau - s_.ws.tau);
  }
  for (Index i = 0; i < r_.size(); ++i)
    if (coulomb_[i] != 0.0) r_[i] += coulomb_[i] * sliding(s_.v[i]);
  for (const auto& [rate, at] : given_) r_[rate] = 0.0;
}

/// The residual's derivatives, where it was evaluated last.
Status PredictiveStep::differentiate(Stage& stage, double h) {
  const auto by_rates = [this](const MatrixXd& dq, MatrixXd& out) {
    if (balls_)
      multiply(1.0, dq, E_, out);
    else
      out = dq;
  };
  if (balls_) {
    coordinate_rate_jacobians(arm_, s_.q, s_.v, E_by_q_, E_);
    displace_slopes(arm_, u_, stage.back, stage.turn);
  }
  moving_.differentiate(s_.q, s_.v, stage.a);
  by_rates(moving_.inverse.dq, stage.by_q);
  stage.by_v = moving_.inverse.dv;
  if (more_) {
    more_->differentiate(s_.q, s_.v, stage.a);
    more_->inverse.dq -= moving_.inverse.dq;
    by_rates(more_->inverse.dq, kilogram_by_q_);
    kilogram_by_v_ = more_->inverse.dv - moving_.inverse.dv;
    kilogram_ = more_->s.ws.M - s_.ws.M;
    stage.by_q += mass_ * kilogram_by_q_;
    stage.by_v += mass_ * kilogram_by_v_;
    s_.ws.M += mass_ * kilogram_;
    if (!(s_.ws.M.diagonal().array() > 0.0).all()) return Status::singular;
  }
  stage.by_v.diagonal() += damping_;
  stage.S = s_.ws.M + h * stage.by_v;
  if (balls_)
    add(h * h, stage.by_q, stage.turn, stage.S);
  else
    stage.S += h * h * stage.by_q;
  if (!stage.S.allFinite()) return Status::not_finite;
  for (const auto& [rate, at] : given_) {
    stage.S.row(rate).setZero();
    stage.S(rate, rate) = 1.0;
  }
  for (std::size_t k = 0; k < stage.cut.size(); ++k) stage.cut[k] = s_.ws.limits[k].cut() != 0.0;
  stage.h = h;
  for (Index i = 0; i < r_.size(); ++i) {
    const double w = std::hypot(s_.v[i], speed_);
    slope_[i] = coulomb_[i] * speed_ * speed_ / (w * w * w);
  }
  stage.by_v.diagonal() += slope_;
  for (std::size_t k = 0; k < parameters_.size(); ++k) {
    const int i = parameters_[k].rate;
    auto column = stage.by_p.col(static_cast<Index>(k));
    switch (parameters_[k].kind) {
      case KalmanParameter::payload:
        column = more_->s.ws.tau - s_.ws.tau;
        break;
      case KalmanParameter::damping:
        column[i] = s_.v[i];
        break;
      case KalmanParameter::coulomb:
        column[i] = sliding(s_.v[i]);
        break;
      case KalmanParameter::offset:
        column[i] = -1.0;
        break;
      case KalmanParameter::gain:
        column[i] = -commanded_[i];
        break;
    }
  }
  return Status::ok;
}

/// @param slopes  of Coulomb friction by v
void PredictiveStep::factor(Stage& stage, double h, const VectorXd& slopes) {
  stage.slopes = slopes;
  S_ = stage.S;
  S_.diagonal() += h * slopes;
  stage.factor.compute(S_);
}

/// From from_q_, from_u_ and from_v_ to the system's q and v, at time t.
///
/// Newton's iteration would jump to and fro across the bend of friction. It does not where the force f of friction is
/// an unknown of its own: the law f = c v / w, w = sqrt(v^2 + speed^2), is linearised as w f = c v (Chan, Golub & Mulet
/// 1999), which has the slope (c - f v / w) / w.
Status PredictiveStep::solve(Stage& stage, double t, double h, double slack) {
  bool known = std::abs(stage.h - h) <= kSame * h;
  if (stage.h == 0.0) stage.a.setZero();
  drive(stage, t);
  Newton<double> newton{stage.contraction};
  newton.begin(kBest);
  for (int k = 1; k <= kIterations; ++k) {
    residual(stage.a, h);
    bool anew = !known || k > kChords;
    if (anew)
      if (const Status status = differentiate(stage, h); status != Status::ok) return status;
    known = true;
    for (Index i = 0; i < r_.size(); ++i) {
      const double w = coulomb_[i] != 0.0 ? std::hypot(s_.v[i], speed_) : 1.0;
      rubbing_[i] = (coulomb_[i] - rub_[i] * s_.v[i] / w) / w;
      anew = anew || h * std::abs(rubbing_[i] - stage.slopes[i]) > kTurned * std::abs(stage.S(i, i));
    }
    if (anew) factor(stage, h, rubbing_);
    d_ = stage.factor.solve(r_);
    stage.a -= d_;
    for (Index i = 0; i < r_.size(); ++i) {
      if (coulomb_[i] == 0.0) continue;
      const double most = std::abs(coulomb_[i]);
      rub_[i] = std::clamp(coulomb_[i] * sliding(s_.v[i]) - rubbing_[i] * h * d_[i], -most, most);
    }
    const double moved = h * std::sqrt(std::abs(d_.dot(r_)));
    if (!std::isfinite(moved)) break;
    const double motion = inertia_.dot((s_.v.array().square() + h * h * stage.a.array().square()).matrix());
    const double size = std::sqrt(motion + kStill) + slack;
    newton.correct(k, moved, true);
    if (newton.left() > kError * size && !(newton.stalls(k) && moved <= kFloor * size)) continue;
    residual(stage.a, h);
    const Status status = differentiate(stage, h);
    if (status == Status::ok) factor(stage, h, slope_);
    stage.contraction = newton.contraction;
    return status;
  }
  return stage.a.allFinite() ? Status::not_converged : Status::not_finite;
}

Status PredictiveStep::operator()(std::size_t which, double t, double h, VectorXd& q, VectorXd& v,
                                  const VectorXd& forces, const VectorXd& p, double slack) {
  const Index count = weights_.rows();
  Stage* const stages = &stages_[static_cast<std::size_t>(count) * which];
  last_ = which;
  h_ = h;
  take(p);
  forces_ = forces;
  from_q_ = q;
  for (Index i = 0; i < v.size(); ++i) rub_[i] = coulomb_[i] * sliding(v[i]);
  Status status = Status::ok;
  for (Index i = 0; i < count && status == Status::ok; ++i) {
    from_u_.setZero();
    from_v_ = v;
    for (Index j = 0; j < i; ++j) {
      from_u_ += h * weights_(i, j) * stages[j].v;
      from_v_ += h * weights_(i, j) * stages[j].a;
    }
    status = solve(stages[i], t + weights_.row(i).sum() * h, weights_(0, 0) * h, slack);
    stages[i].v = s_.v;
  }
  if (status == Status::ok && !arm_.within_reach(s_.q, s_.v)) status = Status::not_finite;
  if (status == Status::ok) {
    q = s_.q;
    v = s_.v;
  } else {
    for (Index i = 0; i < count; ++i) stages[i].h = 0.0;
  }
  return status;
}

/// With small changes of [q, v, commands, parameters] at the beginning as columns: at a stage those of the displacement
/// and of v are du~ + g h dv and dv~ + g h da, that of q is back dq + turn du, and with K and C its slopes by q and v,
/// S da = columns dcommands - by_p dp - K (back dq + turn (du~ + g h dv~)) - C dv~.
void PredictiveStep::derivatives(MatrixXd& A, MatrixXd& B) {
  const Index n = arm_.nv(), nu = columns_.cols(), np = p_.size(), count = weights_.rows();
  const Stage* const stages = &stages_[static_cast<std::size_t>(count) * last_];
  const double g = weights_(0, 0) * h_;
  const auto turned = [&](const Stage& stage) {  // du_ to dq_
    if (!balls_) {
      dq_ = du_;
      dq_.leftCols(n).diagonal().array() += 1.0;
    } else {
      multiply(1.0, stage.turn, du_, dq_);
      dq_.leftCols(n) += stage.back;
    }
    keep_given(dq_);
  };
  for (Index i = 0; i < count; ++i) {
    const Stage& stage = stages[i];
    MatrixXd &da = da_of_[static_cast<std::size_t>(i)], &dv = dv_of_[static_cast<std::size_t>(i)];
    dv.setZero();
    dv.middleCols(n, n).setIdentity();
    du_.setZero();
    for (Index j = 0; j < i; ++j) {
      dv += h_ * weights_(i, j) * da_of_[static_cast<std::size_t>(j)];
      du_ += h_ * weights_(i, j) * dv_of_[static_cast<std::size_t>(j)];
    }
    du_ += g * dv;
    turned(stage);
    multiply(-1.0, stage.by_q, dq_, by_);
    add(-1.0, stage.by_v, dv, by_);
    by_.middleCols(2 * n, nu) += columns_;
    for (std::size_t k = 0; k < stage.cut.size(); ++k)  // a motor at its limit gives no more
      if (stage.cut[k]) by_.row(s_.ws.limits[k].rate).segment(2 * n, nu) -= columns_.row(s_.ws.limits[k].rate);
    by_.rightCols(np) -= stage.by_p;
    keep_given(by_);
    by_columns(by_, da, [&](const auto& some, auto&& x) { x.noalias() = stage.factor.solve(some); });
    dv += g * da;
    du_ += g * g * da;
  }
  const MatrixXd &dv = dv_of_.back(), &da = da_of_.back();
  turned(stages[count - 1]);
  keep_given(dv_of_.back());
  A.topRows(n) = dq_.leftCols(2 * n);
  A.bottomRows(n) = dv.leftCols(2 * n);
  B.topRows(n) = dq_.rightCols(nu + np);
  B.bottomRows(n) = dv.rightCols(nu + np);
  if (!more_) return;
  multiply(1.0, kilogram_by_q_, dq_, bend_);
  add(1.0, kilogram_by_v_, dv, bend_);
  add(1.0, kilogram_, da, bend_);
}

VectorXd PredictiveStep::memory() const {
  const Index n = arm_.nv(), each = n * (n + 2) + 2;
  VectorXd out(each * static_cast<Index>(stages_.size()));
  for (std::size_t k = 0; k < stages_.size(); ++k) {
    const Stage& s = stages_[k];
    out.segment(static_cast<Index>(k) * each, each) << s.S.reshaped(), s.a, s.slopes, s.h, s.contraction;
  }
  return out;
}

void PredictiveStep::recall(const VectorXd& memory) {
  const Index n = arm_.nv(), each = n * (n + 2) + 2;
  for (std::size_t k = 0; k < stages_.size(); ++k) {
    const auto mine = memory.segment(static_cast<Index>(k) * each, each);
    Stage& s = stages_[k];
    s.S = mine.head(n * n).reshaped(n, n);
    s.a = mine.segment(n * n, n);
    s.h = mine[each - 2];
    s.contraction = mine[each - 1];
    factor(s, s.h, mine.segment(n * n + n, n));
  }
}

void PredictiveStep::forget() {
  for (Stage& stage : stages_) {
    stage.h = 0.0;
    stage.contraction = 1.0;
  }
}

}  // namespace flexarm
