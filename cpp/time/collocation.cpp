#include "flexarm/collocation.hpp"

#include <cmath>

#include "arrays.hpp"
#include "flexarm/check.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/dry_friction.hpp"
#include "flexarm/quadrature.hpp"
#include "setup/single.hpp"
#include "space/ball.hpp"
#include "step/newton.hpp"
#include "step_error.hpp"
#include "turning.hpp"

namespace flexarm {

namespace {

constexpr double kDependent = 1e-9;  // parts of a row of loops that others do not have: below, it takes no force
constexpr double kLoose = 1e-6;      // parts of the motion that such a row may miss
constexpr double kEased = 1e-11;     // of the diagonal of the matrix of loops: as much as their forces give way
constexpr double kSlow = 0.25;       // contraction above which the Jacobians are made anew
constexpr double kFails = 0.7;       // contraction at which even new ones are made anew, where the iteration now is
constexpr double kBest = 0.02;       // contraction that is believed without having been measured in the same step
constexpr int kGivenUp = 3;          // corrections that grew, after which an iteration is given up
constexpr double kFloor = 1e-8;      // parts of the motion: an iteration that stalls below is at the end of its digits
constexpr double kGrown = 1.5;       // ratio of a step to the one before, above which nothing is extrapolated
constexpr double kSolved = 1e-3;     // of the tolerance of places, to which the equations are solved
constexpr double kFar = 30.0;  // times the energy that a step begins with and its forces bring: no solution is so far

/// The quaternion at `k` of p0, turned by u, into p.
void turn(const double* p0, const Eigen::Vector3d& u, double* p, Eigen::Index k) { turn_ball(p0 + k, u.data(), p + k); }

/// Radau's rule of n points on [0, 1], of which the last is the end; exact for polynomials of degree 2n - 2. A
/// polynomial less its value there has the factor 1 - x: the other points are those of the Gauss rule with that weight.
GaussRule radau_rule(int n) {
  GaussRule rule(n), inner = rule;
  inner.weights.array() *= 1.0 - inner.points.array();
  if (n > 1) inner = gauss_rule_of(inner, n - 1);
  rule.points[n - 1] = rule.weights[n - 1] = 1.0;
  for (int i = 0; i + 1 < n; ++i) {
    rule.points[i] = inner.points[i];
    rule.weights[i] = inner.weights[i] / (1.0 - inner.points[i]);
    rule.weights[n - 1] -= rule.weights[i];
  }
  return rule;
}

}  // namespace

CollocationStep::CollocationStep(const Arm& arm, const CollocationOptions& options, DryFriction friction)
    : arm_(&arm), options_(options), s_(options.stages), q0_(arm.zero()), v0_(Eigen::VectorXd::Zero(arm.nv())) {
  if (friction == DryFriction::refused) refuse_friction(arm, "gauss");
  if (s_ < 1 || s_ > 4) bad_value("stages", s_, "must be from 1 to 4");
  positive("rtol", options.rtol);
  if (options.max_iterations < 1) bad_value("max_iterations", options.max_iterations, "must be at least 1");
  if (options.tolerance != 0.0) positive("tolerance", options.tolerance);
  const GaussRule rule = rubs(arm).empty() ? GaussRule(s_) : radau_rule(s_);
  c_ = rule.points;
  b_ = rule.weights;
  Eigen::MatrixXd powers(s_, s_);
  A_.resize(s_, s_);
  for (int i = 0; i < s_; ++i) {
    A_.row(i) = integral_weights(rule, 1.0, c_[i]);
    for (int k = 0; k < s_; ++k) powers(i, k) = std::pow(c_[i], k);
  }
  A2_ = A_ * A_;
  monomials_ = powers.inverse();
  turn_weights_ = A_.rowwise() - 0.5 * b_.transpose();
  for (std::size_t n = 0; n < arm.size(); ++n) {
    const Joint& joint = arm.link(n).joint();
    const Eigen::Index before = static_cast<Eigen::Index>(joint.motions().size());
    if (joint.has_ball()) balls_.push_back({arm.first_q(n) + before, arm.first(n) + before});
  }
  q_ = Eigen::MatrixXd::Zero(arm.nq(), s_);
  v_ = a_ = tau_ = a_before_ = u_ = du_ = Eigen::MatrixXd::Zero(arm.nv(), s_);
  qs_ = middle_ = q0_;
  vs_ = as_ = product_ = v0_;
  rate_by_q_.resize(arm.nq(), arm.nq());
  rate_by_v_.resize(arm.nq(), arm.nv());
  M_all_ = C_all_ = K_all_ = Eigen::MatrixXd::Zero(arm.nv(), arm.nv());
  once_ = twice_ = Eigen::VectorXd::Zero(s_);
  rub_ = v0_;
  ways_.resize(static_cast<std::size_t>(arm.nv()), Tape::free);
  was_ = ways_;
  if (!rubs(arm).empty()) rests_.emplace("rk4", arm, 1.0, ImplicitOptions{}, DryFriction::left_to_caller);
  for (const Link& link : arm.links()) mass_ += link.mass();
}

CollocationStep::~CollocationStep() = default;

Status CollocationStep::start(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                              const Eigen::VectorXd& tau) {
  if (!rests_)
    if (const Status status = forward_dynamics(*arm_, ws, q, v, tau); status != Status::ok) return status;
  ws.M.resize(arm_->nv(), arm_->nv());
  std::vector<Load> loads;
  for (const AppliedLoad& l : ws.loads) loads.push_back(l.load);
  derivatives_.emplace(*arm_, loads);
  offsets_.setZero(static_cast<Eigen::Index>(ws.feedback.size()), s_);
  wrenches_.assign(static_cast<std::size_t>(s_), std::vector<Vec6<double>>(loads.size(), Vec6<double>::Zero()));
  contraction_ = best_ = 1.0;
  h_factored_ = scale_ = peak_ = 0.0;
  fresh_ = false;
  free_ = ws.free;
  free_q_.assign(static_cast<std::size_t>(arm_->nq()), true);
  for (int i = 0; i < arm_->nv(); ++i)
    if (const int k = arm_->coordinate_of(i); k >= 0 && !std::binary_search(free_.begin(), free_.end(), i))
      free_q_[static_cast<std::size_t>(k)] = false;
  const auto n = static_cast<Eigen::Index>(free_.size());
  M_ = C_ = K_ = Eigen::MatrixXd::Zero(n, n);
  rows_ = ws.chain().layout().rigid_rows;
  G_ = Eigen::MatrixXd::Zero(arm_->nv(), rows_);
  G_by_q_ = G_by_v_ = Eigen::MatrixXd::Zero(rows_, arm_->nv());
  closing_ = by_force_ = Eigen::MatrixXd::Zero(n, rows_);
  inertia_.compute(Eigen::MatrixXd::Identity(n, n));
  closure_.compute(Eigen::MatrixXd::Identity(rows_, rows_));
  row_forces_ = taken_ = own_ = Eigen::VectorXd::Zero(rows_);
  closed_ = left_ = Eigen::MatrixXd::Zero(rows_, rows_);
  found_ = Eigen::Matrix3Xd::Zero(3, rows_);
  reaction_ = reaction_before_ = Eigen::MatrixXd::Zero(rows_, s_);
  newton_ = Eigen::MatrixXd::Identity(s_ * (n + rows_), s_ * (n + rows_));
  lu_ = Eigen::PartialPivLU<Eigen::MatrixXd>(s_ * (n + rows_));
  residual_ = correction_ = Eigen::VectorXd::Zero(s_ * (n + rows_));
  moved_ = Eigen::MatrixXd::Zero(n, s_);
  if (chooses()) {
    seen_ = std::make_unique<StepError>(*arm_, ws, free_, c_, rests_.has_value(), options_.tolerance);
    missed_force_ = Eigen::VectorXd::Zero(n);
  }
  a_.colwise() = ws.a;
  q_.colwise() = q;
  return jump(ws, q, v, tau);
}

Status CollocationStep::jump(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                             const Eigen::VectorXd& tau) {
  h_ = 0.0;  // nothing to extrapolate
  if (!rests_) return Status::ok;
  if (const Status status = rests_->start(ws, q, v, tau); status != Status::ok) return status;
  was_ = ways_;
  rests_->ways(v, true, ways_.data());
  for (std::size_t i = 0; i < ways_.size(); ++i)
    if ((ways_[i] == Tape::held) != (was_[i] == Tape::held)) fresh_ = false;
  a_.colwise() = ws.a;
  rub_ = rests_->friction();
  for (Eigen::Index i = 0; i < v.size(); ++i)
    if (ways_[static_cast<std::size_t>(i)] == Tape::held) {
      rub_[i] = 0.0;
      v_.row(i).setZero();
    }
  return Status::ok;
}

/// The residual of the equation of motion of the free rate k, after the sweep.
double CollocationStep::missing(Eigen::Index k, const Eigen::Ref<const Eigen::VectorXd>& tau,
                                const Workspace& ws) const {
  const int row = free_[static_cast<std::size_t>(k)];
  return held(row) ? 0.0 : tau[row] + rub_[row] - ws.tau[row];
}

/// The error of the step that has been taken, from the forces that it misses between its points.
void CollocationStep::judge(Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau,
                            const Given& given) {
  error_ = 0.0;
  if (M_.rows() == 0) return;
  seen_->begin();
  for (double x : seen_->asked()) {
    inside(x, q, v);
    if (given) given(x);
    as_ = ws.a;
    for (int row : free_) {
      double sum = 0.0;
      for (int k = s_; k-- > 0;) sum = sum * x + monomials_.row(k).dot(a_.row(row));
      as_[row] = held(row) ? 0.0 : sum;
    }
    if (rows_ > 0) set_loop_forces_inside(x, ws);
    inverse_dynamics(*arm_, ws, q, v, as_);
    ++counts_.evaluations;
    for (Eigen::Index k = 0; k < missed_force_.size(); ++k) missed_force_[k] = missing(k, tau, ws);
    if (rows_ > 0) take_loops(ws, missed_force_);
    error_ = std::max(error_, (*seen_)(missed_force_, M_all_, v, as_, 0.5 * fastest_));
  }
}

void CollocationStep::undo(Eigen::VectorXd& q, Eigen::VectorXd& v) {
  q = q0_;
  v = v0_;
  a_ = a_before_;
  reaction_ = reaction_before_;
  h_ = h_before_;
  if (seen_) seen_->undo();
}

/// Accelerations of the step before, continued; where the step grows much they begin with the last.
void CollocationStep::predict(double ratio) {
  a_before_ = a_;
  reaction_before_ = reaction_;
  if (ratio == 0.0) return;
  for (int i = 0; i < s_; ++i) {
    const double x = ratio > kGrown ? 1.0 : 1.0 + ratio * c_[i];
    for (int row : free_) {
      double sum = 0.0;
      for (int j = 0; j < s_; ++j) {
        double lagrange = 0.0;
        for (int k = s_; k-- > 0;) lagrange = lagrange * x + monomials_(k, j);
        sum += lagrange * a_before_(row, j);
      }
      a_(row, i) = sum;
    }
  }
}

/// Velocities and coordinates at the points from the accelerations there.
/// @return whether the turns of the balls converged
bool CollocationStep::place(double h) {
  for (int row : free_)
    for (int i = 0; i < s_; ++i) v_(row, i) = v0_[row] + h * A_.row(i).dot(a_.row(row));
  for (int row : free_) {
    const int k = arm_->coordinate_of(row);
    for (int i = 0; k >= 0 && i < s_; ++i) q_(k, i) = q0_[k] + h * A_.row(i).dot(v_.row(row));
  }
  return balls_.empty() || turn_balls(h);
}

bool CollocationStep::turn_balls(double h) {
  for (const Ball& ball : balls_) {
    auto u = u_.middleRows<3>(ball.v), du = du_.middleRows<3>(ball.v);
    if (!turn_at_points(h, turn_weights_, v_.middleRows<3>(ball.v), u, du)) return false;
    turn(q0_.data(), 0.5 * h * (du * b_), middle_.data(), ball.q);
    for (int i = 0; i < s_; ++i) turn(middle_.data(), u.col(i), q_.col(i).data(), ball.q);
  }
  return true;
}

/// Mass matrix and exact Jacobians by rates and coordinates, at the point in the middle.
void CollocationStep::differentiate(Workspace& ws) {
  const int middle = s_ / 2;
  qs_ = q_.col(middle);
  vs_ = v_.col(middle);
  as_ = a_.col(middle);
  for (std::size_t k = 0; k < ws.loads.size(); ++k)
    derivatives_->set_wrench(k, wrenches_[static_cast<std::size_t>(middle)][k]);
  if (rows_ > 0) set_loop_forces(middle, ws);
  derivatives_->recall(ws);
  (*derivatives_)(*arm_, qs_, vs_, as_);
  for (std::size_t k = 0; k < ws.feedback.size(); ++k)
    ws.feedback[k].offset = offsets_(static_cast<Eigen::Index>(k), middle);
  ws.give(tau_.col(middle).data());
  add_feedback_slopes(ws.feedback, ws.limits, qs_, vs_, derivatives_->dq, derivatives_->dv);
  coordinate_rate_jacobians(*arm_, qs_, vs_, rate_by_q_, rate_by_v_);
  C_all_ = derivatives_->dv;
  K_all_.noalias() = derivatives_->dq * rate_by_v_;
  composite_mass_matrix(*arm_, ws, qs_);
  M_all_ = ws.M;
  if (rows_ > 0) {
    move_chain(ws, qs_, vs_);
    ws.chain().loop_rows(found_.data(), G_.data());
    G_by_q_.noalias() = derivatives_->loops.leftCols(arm_->nq()) * rate_by_v_;
    G_by_v_ = derivatives_->loops.rightCols(arm_->nv());
  }
  reduce();
  if (seen_) seen_->look(ws, qs_, vs_);
  fresh_ = true;
  h_factored_ = 0.0;
}

/// To the free rates. Those that dry friction holds have an equation of their own: they do not accelerate.
void CollocationStep::reduce() {
  const Eigen::Index n = M_.rows();
  for (Eigen::Index k = 0; k < n; ++k)
    for (Eigen::Index l = 0; l < n; ++l) {
      const int i = free_[static_cast<std::size_t>(k)], j = free_[static_cast<std::size_t>(l)];
      const bool still = held(i) || held(j);
      M_(k, l) = still ? (k == l ? 1.0 : 0.0) : M_all_(i, j);
      C_(k, l) = still ? 0.0 : C_all_(i, j);
      K_(k, l) = still ? 0.0 : K_all_(i, j);
    }
  if (rows_ == 0) return;
  for (Eigen::Index k = 0; k < n; ++k) {
    const int i = free_[static_cast<std::size_t>(k)];
    for (Eigen::Index r = 0; r < rows_; ++r) closing_(k, r) = held(i) ? 0.0 : G_(i, r);
  }
  inertia_.compute(M_);
  by_force_ = closing_;
  inertia_.solveInPlace(by_force_);
  closed_.noalias() = closing_.transpose() * by_force_;
  drop_rows();
  for (Eigen::Index r = 0; r < rows_; ++r) closed_(r, r) *= 1.0 + kEased;
  closure_.compute(closed_);
}

/// Rows of loops that depend on others take no force: Cholesky's elimination, largest pivots first, tells
/// which.
void CollocationStep::drop_rows() {
  left_ = closed_;
  taken_.setZero();
  const double least = kDependent * closed_.diagonal().maxCoeff();
  for (Eigen::Index r = 0; r < rows_; ++r) own_[r] = std::sqrt(std::max(closed_(r, r), least));
  for (Eigen::Index count = 0; count < rows_; ++count) {
    Eigen::Index next = -1;
    double most = kDependent;
    for (Eigen::Index r = 0; r < rows_; ++r)
      if (taken_[r] == 0.0 && left_(r, r) > most * own_[r] * own_[r]) {
        most = left_(r, r) / (own_[r] * own_[r]);
        next = r;
      }
    if (next < 0) break;
    taken_[next] = 1.0;
    row_forces_ = left_.col(next);
    left_.noalias() -= (1.0 / row_forces_[next]) * row_forces_ * row_forces_.transpose();
  }
  for (Eigen::Index r = 0; r < rows_; ++r) {
    if (taken_[r] != 0.0) continue;
    closing_.col(r).setZero();
    by_force_.col(r).setZero();
    closed_.row(r).setZero();
    closed_.col(r).setZero();
    closed_(r, r) = 1.0;
  }
}

/// The part of free forces that no loop takes, and those that d^2 g/dt^2, as found, misses.
void CollocationStep::take_loops(Workspace& ws, Eigen::VectorXd& forces) {
  ws.chain().loop_rows(found_.data(), nullptr);
  row_forces_.noalias() = by_force_.transpose() * forces;
  for (Eigen::Index r = 0; r < rows_; ++r) row_forces_[r] += taken_[r] * found_(2, r);
  closure_.solveInPlace(row_forces_);
  forces.noalias() -= closing_ * row_forces_;
}

void CollocationStep::set_loop_forces(int i, Workspace& ws) const {
  ws.loop_forces.resize(static_cast<std::size_t>(rows_));
  for (Eigen::Index r = 0; r < rows_; ++r) ws.loop_forces[static_cast<std::size_t>(r)] = reaction_(r, i);
}

void CollocationStep::set_loop_forces_inside(double x, Workspace& ws) const {
  for (Eigen::Index r = 0; r < rows_; ++r) {
    double sum = 0.0;
    for (int k = s_; k-- > 0;) sum = sum * x + monomials_.row(k).dot(reaction_.row(r));
    ws.loop_forces[static_cast<std::size_t>(r)] = sum;
  }
}

/// I x M + h A x C + h^2 A^2 x K, and, of loops, the forces that make their second derivatives zero.
bool CollocationStep::factor(double h) {
  const Eigen::Index n = M_.rows();
  for (int i = 0; i < s_; ++i)
    for (int j = 0; j < s_; ++j) {
      auto block = newton_.block(i * n, j * n, n, n);
      block = h * A_(i, j) * C_ + h * h * A2_(i, j) * K_;
      if (i == j) block += M_;
    }
  for (int i = 0; i < s_ && rows_ > 0; ++i) {
    const Eigen::Index at = s_ * n + i * rows_;
    newton_.middleCols(at, rows_).setZero();
    newton_.middleRows(at, rows_).setZero();
    newton_.block(i * n, at, n, rows_) = -closing_;
    newton_.block(at, at, rows_, rows_).diagonal() = kEased * closed_.diagonal();
    for (Eigen::Index r = 0; r < rows_; ++r)
      if (taken_[r] == 0.0) newton_(at + r, at + r) = 1.0;
    for (int j = 0; j < s_; ++j)
      for (Eigen::Index k = 0; k < n; ++k) {
        const int rate = free_[static_cast<std::size_t>(k)];
        if (held(rate)) continue;
        auto column = newton_.block(at, j * n + k, rows_, 1);
        column = h * A_(i, j) * G_by_v_.col(rate) + h * h * A2_(i, j) * G_by_q_.col(rate);
        if (i == j) column += G_.row(rate).transpose();
        column.array() *= taken_.array();
      }
  }
  if (!newton_.allFinite()) return false;
  lu_.compute(newton_);
  if (seen_) seen_->factor(h, M_, C_, K_);
  h_factored_ = h;
  ++counts_.factorisations;
  return true;
}

/// Whether the initial motion and the forces at its points can make a solution so fast. An iteration
/// that has run away may find another root far off, or stop there, where its tolerance is large because the motion is.
bool CollocationStep::believable(double h, Workspace& ws) {
  const double fall = h * arm_->gravity().norm();
  const auto fastest = [&](const Eigen::MatrixXd& M) {
    vs_ = v0_;
    vs_.noalias() += h * (a_ * b_);
    double most = form(M, vs_);
    for (int i = 0; i < s_; ++i) most = std::max(most, form(M, v_.col(i)));
    return most;
  };
  const double peak = kForget * peak_, free_fall = mass_ * fall * fall;
  const double reached = fastest_ = fastest(M_all_);
  if (!(reached <= kFar * (std::max(peak, form(M_all_, v0_)) + free_fall))) {  // look closer
    double allowed = 0.0;
    for (int i = 0; i < s_; ++i) {
      qs_ = q0_;
      vs_ = v0_;
      for (Eigen::Index k = 0; k < qs_.size(); ++k)
        if (!free_q_[static_cast<std::size_t>(k)]) qs_[k] = q_(k, i);
      for (std::size_t k = 0; k < ws.prescribed.size(); ++k)
        if (ws.prescribed[k]) vs_[static_cast<Eigen::Index>(k)] = v_(static_cast<Eigen::Index>(k), i);
      ws.a = a_.col(i);  // forward dynamics reads the prescribed ones
      set_forces(i, ws);
      as_ = tau_.col(i);
      ++counts_.evaluations;
      if (forward_dynamics(*arm_, ws, qs_, vs_, as_) != Status::ok) return false;
      as_ = ws.a;
      if (i == 0) composite_mass_matrix(*arm_, ws, qs_);
      allowed = std::max(allowed, form(ws.M, vs_) + h * h * form(ws.M, as_));
    }
    if (!(fastest(ws.M) <= kFar * (std::max(peak, allowed) + free_fall))) return false;
  }
  peak_ = std::max(peak, reached);
  return true;
}

/// Loads and feedback at point i, for the sweeps.
void CollocationStep::set_forces(int i, Workspace& ws) const {
  for (std::size_t k = 0; k < ws.loads.size(); ++k) ws.loads[k].wrench = wrenches_[static_cast<std::size_t>(i)][k];
  for (std::size_t k = 0; k < ws.feedback.size(); ++k)
    ws.feedback[k].offset = offsets_(static_cast<Eigen::Index>(k), i);
  ws.give(tau_.col(i).data());
}

/// Whether the last correction is below the digits of the coordinates: at rest, in balance, there is no motion to
/// compare it with.
bool CollocationStep::lost(double h) {
  const Eigen::Map<const Eigen::MatrixXd> turns(correction_.data(), M_.rows(), s_);
  moved_.noalias() = turns * A2_.transpose();
  return h * h * moved_.cwiseAbs().maxCoeff() <= kVanishing * q_.cwiseAbs().maxCoeff();
}

Status CollocationStep::iterate(double h, Workspace& ws) {
  const Eigen::Index n = M_.rows();
  if (n == 0) return Status::ok;  // everything is prescribed
  const double fall = h * arm_->gravity().norm();
  Newton<double> newton{contraction_};
  int grown = 0;
  const auto tired = [&] {  // new Jacobians would do better
    return !(newton.contraction <= std::max(kSlow, std::min(1.5 * best_, kFails)));
  };
  bool anew = !fresh_ || tired();
  bool renewed = false;
  newton.begin(kBest);
  for (int iteration = 1; iteration <= options_.max_iterations; ++iteration) {
    if (look_) look_();
    if (!place(h)) return Status::not_converged;
    if (anew) {
      differentiate(ws);
      renewed = true;
    }
    if (h != h_factored_ && !factor(h)) return Status::not_converged;
    for (int i = 0; i < s_; ++i) {
      qs_ = q_.col(i);
      vs_ = v_.col(i);
      as_ = a_.col(i);
      set_forces(i, ws);
      if (rows_ > 0) set_loop_forces(i, ws);
      inverse_dynamics(*arm_, ws, qs_, vs_, as_);
      ++counts_.evaluations;
      for (Eigen::Index k = 0; k < n; ++k) residual_[i * n + k] = missing(k, tau_.col(i), ws);
      if (rows_ == 0) continue;
      ws.chain().loop_rows(found_.data(), nullptr);
      for (Eigen::Index r = 0; r < rows_; ++r)
        residual_[s_ * n + i * rows_ + r] =
            -found_(2, r) - (taken_[r] != 0.0 ? kEased * closed_(r, r) * reaction_(r, i) : 0.0);
    }
    correction_ = lu_.solve(residual_);
    for (Eigen::Index r = 0; r < rows_; ++r)
      for (int i = 0; i < s_ && taken_[r] == 0.0; ++i) correction_[s_ * n + i * rows_ + r] = -reaction_(r, i);
    ++counts_.iterations;
    double work = 0.0, motion = 0.0, missed = 0.0;
    for (int i = 0; i < s_; ++i) {
      for (Eigen::Index r = 0; r < rows_; ++r)
        if (const double second = residual_[s_ * n + i * rows_ + r]; taken_[r] == 0.0)
          missed = std::max(missed, own_[r] > 0.0 ? std::abs(second) / own_[r] : 0.0);
      reaction_.col(i) += correction_.segment(s_ * n + i * rows_, rows_);
      const auto turn = correction_.segment(i * n, n);
      for (Eigen::Index k = 0; k < n; ++k) a_(free_[static_cast<std::size_t>(k)], i) += turn[k];
      work += b_[i] * form(M_, turn);
      motion += b_[i] * (form(M_all_, v_.col(i)) + h * h * form(M_all_, a_.col(i)));
    }
    if (!std::isfinite(work) || !std::isfinite(motion))  // at once: the state is at fault; later: the iteration
      return iteration == 1 && !fresh_ ? Status::not_finite : Status::not_converged;
    const double scale = std::sqrt(std::max(kForget * scale_, motion) + mass_ * fall * fall);
    const double moved = h * std::sqrt(std::max(work, 0.0));
    const bool more = iteration > 1 && moved > newton.last;
    newton.correct(iteration, moved, true);
    contraction_ = newton.contraction;
    const bool stalled = newton.stalls(iteration) && (moved <= kFloor * scale || lost(h));
    if (!stalled && more && ++grown == kGivenUp) return Status::not_converged;
    if (newton.left() <= std::max(options_.rtol, kSolved * options_.tolerance) * scale || stalled) {
      if (h * missed > kLoose * scale) return Status::not_converged;
      if (!place(h) || !believable(h, ws)) return Status::not_converged;
      scale_ = std::max(kForget * scale_, motion);
      if (stalled) contraction_ = kSlow;
      if (renewed) best_ = contraction_;
      return Status::ok;
    }
    anew = iteration > 2 && iteration % 3 == 0 && (renewed ? newton.contraction > kFails : tired());
  }
  return Status::not_converged;
}

Status CollocationStep::advance(double h, Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v,
                                const Eigen::VectorXd& tau, const Given& given) {
  q0_ = q;
  v0_ = v;
  u_.setZero();
  predict(h_ > 0.0 ? h / h_ : 0.0);
  for (int i = 0; i < s_; ++i) {
    if (given) given(c_[i]);
    tau_.col(i) = tau;
    for (Eigen::Index k = 0; k < q.size(); ++k) q_(k, i) = free_q_[static_cast<std::size_t>(k)] ? q0_[k] : q[k];
    for (std::size_t k = 0; k < ws.prescribed.size(); ++k)
      if (ws.prescribed[k]) {
        v_(static_cast<Eigen::Index>(k), i) = v[static_cast<Eigen::Index>(k)];
        a_(static_cast<Eigen::Index>(k), i) = ws.a[static_cast<Eigen::Index>(k)];
      }
    for (std::size_t k = 0; k < ws.loads.size(); ++k) wrenches_[static_cast<std::size_t>(i)][k] = ws.loads[k].wrench;
    for (std::size_t k = 0; k < ws.feedback.size(); ++k)
      offsets_(static_cast<Eigen::Index>(k), i) = ws.feedback[k].offset;
  }
  const Status status = iterate(h, ws);
  q = q0_;
  v = v0_;
  if (status != Status::ok) {
    fresh_ = false;
    a_ = a_before_;  // from which a shorter step goes on
    reaction_ = reaction_before_;
    std::fill(ws.loop_forces.begin(), ws.loop_forces.end(), 0.0);
    return all_finite(q) && all_finite(v) && all_finite(tau) ? status : Status::not_finite;
  }
  h_before_ = h_;
  h_ = h;
  if (seen_) judge(ws, q, v, tau, given);
  std::fill(ws.loop_forces.begin(), ws.loop_forces.end(), 0.0);
  inside(1.0, q, v);
  if (given) given(1.0);
  const double by_q = 0.25 * h * h;  // of a metric in which fast vibrations hardly move
  Eigen::VectorXd open_q, open_v;
  if (tape_ && rows_ > 0) {
    open_q = q;
    open_v = v;
  }
  if (rows_ > 0) ws.chain_to_move().project({0.0, by_q}, q.data(), v.data(), as_.data());
  if (tape_) {
    tape_->entries.push_back({h, 1.0, tape_->points()});
    for (int i = 0; i < s_; ++i) {
      tape_->add(tape_->now + c_[i] * h, q_.col(i), v_.col(i), a_.col(i));
      std::copy(ways_.begin(), ways_.end(), tape_->last_ways());
    }
    if (rows_ > 0) tape_->close(tape_->now + h, q, v, a_.col(s_ - 1), by_q, open_q, open_v);
  }
  if (arm_->within_reach(q, v)) return Status::ok;
  q = q0_;
  v = v0_;
  return Status::not_finite;
}

void CollocationStep::memory(const std::function<void(double&)>& visit) {
  for (Eigen::MatrixXd* x : {&q_, &v_, &a_, &u_, &du_, &M_all_, &C_all_, &K_all_, &G_, &G_by_q_, &G_by_v_, &reaction_})
    for (double& number : x->reshaped()) visit(number);
  for (Eigen::VectorXd* x : {&q0_, &v0_, &middle_})
    for (double& number : *x) visit(number);
  if (seen_) seen_->memory(visit);
  for (double* x : {&h_, &h_factored_, &contraction_, &best_, &scale_, &peak_}) visit(*x);
  double fresh = fresh_ ? 1.0 : 0.0;
  visit(fresh);
  fresh_ = fresh != 0.0;
  if (!rests_) return;
  rests_->memory(visit);
  for (double& x : rub_) visit(x);
  for (signed char& c : ways_) {
    double number = c;
    visit(number);
    c = static_cast<signed char>(number);
  }
}

void CollocationStep::recalled() {
  reduce();
  if (h_factored_ == 0.0) return;
  factor(h_factored_);
  --counts_.factorisations;
}

void CollocationStep::weights(double c, Eigen::VectorXd& once, Eigen::VectorXd& twice) const {
  once.setZero(s_);
  twice.setZero(s_);
  for (int j = 0; j < s_; ++j) {  // the Lagrange polynomial of point j, integrated once and twice
    for (int k = s_; k-- > 0;) {
      once[j] = (once[j] + monomials_(k, j) / (k + 1.0)) * c;
      twice[j] = (twice[j] + monomials_(k, j) / ((k + 1.0) * (k + 2.0))) * c;
    }
    twice[j] *= c;
  }
}

Stages CollocationStep::stages() const {
  Stages out;
  out.c.resize(s_ + 1);
  out.v_by_a.resize(s_ + 1, s_);
  out.q_by_a.resize(s_ + 1, s_);
  Eigen::VectorXd once, twice;
  weights(1.0, once, twice);
  out.c << c_, 1.0;
  out.v_by_a << A_, once.transpose();
  out.q_by_a << A2_, twice.transpose();
  out.v_by_start = out.q_by_start = Eigen::MatrixXd::Zero(s_ + 1, 2);
  return out;
}

void CollocationStep::inside(double c, Eigen::VectorXd& q, Eigen::VectorXd& v) const {
  q = q0_;
  v = v0_;
  weights(c, once_, twice_);
  for (int j = 0; j < s_; ++j) {
    v += h_ * once_[j] * a_.col(j);
    for (int i = 0; i < arm_->nv(); ++i)
      if (arm_->coordinate_of(i) >= 0) q[arm_->coordinate_of(i)] += h_ * h_ * twice_[j] * a_(i, j);
  }
  for (int i = 0; i < arm_->nv(); ++i)
    if (arm_->coordinate_of(i) >= 0) q[arm_->coordinate_of(i)] += h_ * c * v0_[i];
  for (const Ball& ball : balls_) {
    const auto du = du_.middleRows<3>(ball.v);
    turn(middle_.data(), h_ * (du * (once_ - 0.5 * b_)), q.data(), ball.q);
  }
}

}  // namespace flexarm
