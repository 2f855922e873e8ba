#include "flexarm/kalman.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "flexarm/check.hpp"
#include "flexarm/dry_friction.hpp"
#include "kalman_parts.hpp"
#include "predictive_step.hpp"

namespace flexarm {

using Eigen::Index;
using Eigen::VectorXd;

namespace {
constexpr int kPasses = 10;      // most of an update
constexpr double kMoved = 0.03;  // standard deviations by which the last of them moves the state
}  // namespace

KalmanFilter::KalmanFilter(const Problem& problem, double h, const std::vector<KalmanSensor>& sensors,
                           const std::vector<KalmanParameter>& parameters, const VectorXd& force_noise,
                           const KalmanOptions& options)
    : problem_(problem),
      arm_(problem_.arm.get()),
      sensors_(sensors),
      parameters_(parameters),
      force_noise_(force_noise),
      h_(h) {
  const Arm& arm = *arm_;
  problem_.check();
  positive("step", h);
  refuse_contact_friction(arm, "the filter");
  refuse_loops(arm, "the filter");
  if (sensors.empty()) bad_value("sensors", 0, "there must be at least one");
  for (std::size_t k = 0; k < sensors.size(); ++k) check(arm, k, sensors[k]);
  check(arm, parameters);
  if (force_noise.size() != arm.nv() || !(force_noise.array() >= 0.0).all() || !force_noise.allFinite())
    bad_value("force_noise", force_noise.size(), "must be finite numbers, not negative, one for each rate");
  positive("friction_speed", options.friction_speed);
  std::vector<KalmanParameter> told = parameters;
  for (int j = 0; j < arm.nv(); ++j) told.push_back({KalmanParameter::offset, j, 0.0, 0.0});
  step_ = std::make_unique<PredictiveStep>(problem_, Eigen::MatrixXd(arm.nv(), 0), told, options.friction_speed, 1,
                                           ImplicitStages::five());

  const Index n = arm.nv(), m = static_cast<Index>(parameters.size());
  Index filters = 0;
  for (const KalmanSensor& s : sensors_) {
    first_.push_back(filters);
    filters += s.F.rows();
    const auto rest = Eigen::MatrixXd::Identity(s.F.rows(), s.F.rows()) - s.F;
    settled_.push_back(s.F.rows() > 0 ? VectorXd(rest.lu().solve(s.before + s.after)) : VectorXd());
    by_q_.push_back(VectorXd::Zero(arm.nq()));
    for (int i = 0; i < arm.nv(); ++i)
      if (arm.coordinate_of(i) >= 0) by_q_.back()[arm.coordinate_of(i)] = s.by_q[i];
  }
  const Index states = 2 * n + m + filters, noises = n + m;
  q_ = q0_ = from_ = arm.zero();
  v_ = v0_ = u_ = bend_ = mean_ = VectorXd::Zero(n);
  back_ = turned_ = Eigen::MatrixXd::Identity(n, n);
  p_ = VectorXd::Zero(m);
  told_ = VectorXd::Zero(m + n);
  f_ = f0_ = VectorXd::Zero(filters);
  row_ = phi_ = gain_ = change_ = about_ = VectorXd::Zero(states);
  before_ = after_ = Eigen::MatrixXd::Zero(2 * n, static_cast<Index>(sensors_.size()));
  read_ = VectorXd::Zero(static_cast<Index>(sensors_.size()));
  essential_ = VectorXd::Zero(states + noises);
  innovations_ = innovation_deviations_ = VectorXd::Zero(static_cast<Index>(sensors.size()));
  lowest_ = VectorXd::Constant(m, -std::numeric_limits<double>::infinity());
  for (Index k = 0; k < m; ++k) {
    const KalmanParameter& p = parameters[static_cast<std::size_t>(k)];
    const JointForce own = p.kind == KalmanParameter::payload ? JointForce() : checked_joint(arm, "rate", p.rate);
    if (p.kind == KalmanParameter::payload) {
      lowest_[k] = 0.0;
      payload_ = 2 * n + k;
    }
    if (p.kind == KalmanParameter::damping) lowest_[k] = -own.damping;
    if (p.kind == KalmanParameter::coulomb) lowest_[k] = -own.coulomb;
  }
  L_ = L0_ = transition_ = Eigen::MatrixXd::Identity(states, states);
  rows_ = Eigen::MatrixXd::Zero(states + noises, states);
  forces_ = Eigen::MatrixXd::Zero(n, n);
  pushes_ = Eigen::MatrixXd::Zero(states, n);
  A_ = Eigen::MatrixXd::Zero(2 * n, 2 * n);
  B_ = Eigen::MatrixXd::Zero(2 * n, m + n);
  J_ = Mat6X<double>::Zero(6, n);
  start(arm.zero(), v_, VectorXd::Zero(n), VectorXd::Zero(n));
}

KalmanFilter::~KalmanFilter() = default;

void KalmanFilter::start(const VectorXd& q, const VectorXd& v, const VectorXd& q_deviation, const VectorXd& v_deviation,
                         double t) {
  const Index n = v_.size(), m = p_.size();
  step_->forget();
  t_ = t;
  q_ = q;
  v_ = v;
  L_.setZero();
  L_.diagonal().head(n) = q_deviation;
  L_.diagonal().segment(n, n) = v_deviation;
  for (const Drive& d : problem_.drives)
    if (d.motion) L_(d.coordinate, d.coordinate) = L_(n + d.coordinate, n + d.coordinate) = 0.0;
  for (Index k = 0; k < m; ++k) {
    p_[k] = parameters_[static_cast<std::size_t>(k)].start;
    L_(2 * n + k, 2 * n + k) = parameters_[static_cast<std::size_t>(k)].deviation;
  }
  f_.setZero();
  for (std::size_t k = 0; k < sensors_.size(); ++k) {  // settled, so that its first state is its input
    const KalmanSensor& s = sensors_[k];
    if (s.F.rows() == 0) continue;
    const Index order = s.F.rows(), row = 2 * n + m + first_[k];
    auto f = f_.segment(first_[k], order);
    f = settled_[k];
    const double y = look(k, q, v, row_);
    for (Index j = 0; j < 2 * n; ++j) L_.col(j).segment(row, order) = row_[j] * L_(j, j) * f;
    f *= y;
  }
}

Status KalmanFilter::predict(const VectorXd& tau) {
  const Index n = v_.size(), m = p_.size(), states = L_.rows();
  q0_ = q_;
  v0_ = v_;
  f0_ = f_;
  told_.head(m) = p_;
  const auto failed = [this](Status status) {
    q_ = q0_;
    v_ = v0_;
    f_ = f0_;
    return status;
  };
  for (std::size_t k = 0; k < sensors_.size(); ++k)
    if (sensors_[k].F.rows() > 0) {
      const auto at = static_cast<Index>(k);
      read_[at] = look(k, q_, v_, row_);
      before_.col(at) = row_.head(2 * n);
    }
  double slack = 0.0;  // the uncertainty of v, in the norm of kinetic energy
  for (Index i = 0; i < n; ++i) slack += step_->inertia()[i] * L_.row(n + i).squaredNorm();
  if (const Status status = (*step_)(0, t_, h_, q_, v_, tau, told_, std::sqrt(slack)); status != Status::ok)
    return failed(status);
  for (std::size_t k = 0; k < sensors_.size(); ++k) {
    const KalmanSensor& s = sensors_[k];
    const Index order = s.F.rows();
    if (order == 0) continue;
    auto f = f_.segment(first_[k], order);
    f.noalias() = s.F.lazyProduct(f0_.segment(first_[k], order));
    const auto at = static_cast<Index>(k);
    f += s.before * read_[at];
    f += s.after * look(k, q_, v_, row_);
    after_.col(at) = row_.head(2 * n);
  }
  linearise();
  for (Index j = 0; j < states; ++j) {
    row_.noalias() = transition_ * L_.col(j);
    rows_.row(j) = row_.transpose();
  }
  disturb();
  for (Index j = 0; j < m; ++j) {  // drifts come after the step
    const double drift = parameters_[static_cast<std::size_t>(j)].drift * std::sqrt(h_);
    rows_.row(states + n + j).setZero();
    rows_(states + n + j, 2 * n + j) = drift;
  }
  if (!rows_.allFinite() || !f_.allFinite()) return failed(Status::not_finite);
  triangularise();
  t_ += h_;
  return Status::ok;
}

/// The derivatives of the last step into transition_ and pushes_, whose rows of parameters never change.
void KalmanFilter::linearise() {
  const Index n = v_.size(), m = p_.size();
  step_->derivatives(A_, B_);
  transition_.topLeftCorner(2 * n, 2 * n) = A_;
  transition_.block(0, 2 * n, 2 * n, m) = B_.leftCols(m);
  pushes_.topRows(2 * n) = B_.rightCols(n);
  for (std::size_t k = 0; k < sensors_.size(); ++k) {
    const KalmanSensor& s = sensors_[k];
    const Index order = s.F.rows(), at = 2 * n + m + first_[k];
    if (order == 0) continue;
    const auto column = static_cast<Index>(k);
    const auto follow = [&](Eigen::MatrixXd& x) {
      for (Index j = 0; j < x.cols(); ++j)
        x.col(j).segment(at, order) = s.after * after_.col(column).dot(x.col(j).head(2 * n));
    };
    follow(transition_);
    follow(pushes_);
    transition_.block(at, 0, order, 2 * n) += s.before.lazyProduct(before_.col(column).transpose());
    transition_.block(at, at, order, order) += s.F;
  }
}

/// Forces that are held over the step, into rows of rows_: those that the model does not know of, with the variance of
/// their density over h, and those of the product of two errors, a payload's e and that of its factor, u. The
/// product has the mean E[e u] and the covariance E[e^2] E[u u^T] + E[e u] E[e u]^T.
void KalmanFilter::disturb() {
  const Index n = v_.size(), first = L_.cols();
  forces_.setZero();
  if (payload_ >= 0) {
    const Index known = 2 * n + p_.size();
    const Eigen::MatrixXd& bend = step_->bend();
    mean_.setZero();
    for (Index j = 0; j < first + n; ++j) {  // of the state, and of forces
      if (j < first)
        bend_.noalias() = bend.leftCols(known) * L_.col(j).head(known);
      else
        bend_ = bend.col(known + j - first) * (force_noise_[j - first] / std::sqrt(h_));
      forces_ += bend_.lazyProduct(bend_.transpose());
      if (j < first) mean_ += L_(payload_, j) * bend_;
    }
    const double variance = L_.row(payload_).squaredNorm(), share = step_->share();
    const double most = std::max(1.0, variance * share * share);  // beyond 1 inertia might be negative
    forces_ *= variance / most;
    mean_ /= most;
    forces_ += mean_.lazyProduct(mean_.transpose());
    gain_.noalias() = pushes_.lazyProduct(mean_);
    add(-1.0);
  }
  forces_.diagonal() += force_noise_.cwiseAbs2() / h_;
  for (Index j = 0; j < n; ++j) {  // its Cholesky factor, column by column; a force that there is not has none
    const double pivot = forces_(j, j);
    if (pivot > 0.0)
      forces_.col(j).tail(n - j) /= std::sqrt(pivot);
    else
      forces_.col(j).tail(n - j).setZero();
    for (Index k = j + 1; k < n; ++k) forces_.col(k).tail(n - k) -= forces_(k, j) * forces_.col(j).tail(n - k);
    forces_.col(j).head(j).setZero();
  }
  rows_.middleRows(first, n).noalias() = forces_.transpose().lazyProduct(pushes_.transpose());
}

/// rows_ = Q R by Householder's reflections; L = R^T has L L^T = rows_^T rows_.
void KalmanFilter::triangularise() {
  const Index states = L_.rows(), rows = rows_.rows();
  for (Index j = 0; j < states; ++j) {
    const Index below = rows - j - 1;
    double tau = 0.0, beta = 0.0;
    auto essential = essential_.head(below);
    rows_.col(j).tail(rows - j).makeHouseholder(essential, tau, beta);
    rows_(j, j) = beta;
    for (Index k = j + 1; k < states; ++k) {
      const double along = tau * (rows_(j, k) + essential.dot(rows_.col(k).tail(below)));
      rows_(j, k) -= along;
      rows_.col(k).tail(below) -= along * essential;
    }
  }
  L_.setZero();
  for (Index j = 0; j < states; ++j) L_.col(j).tail(states - j) = rows_.row(j).tail(states - j).transpose();
}

/// The expected reading of a sensor, and its derivatives by the state, into row_.
double KalmanFilter::expected(std::size_t sensor) {
  row_.setZero();
  if (sensors_[sensor].F.rows() == 0) return look(sensor, q_, v_, row_);
  row_[2 * v_.size() + p_.size() + first_[sensor]] = 1.0;
  return f_[first_[sensor]];
}

/// The reading of a sensor ahead of its filter, and its derivatives by [q; v] into the head of `row`.
double KalmanFilter::look(std::size_t sensor, const VectorXd& q, const VectorXd& v, VectorXd& row) {
  const KalmanSensor& s = sensors_[sensor];
  const Index n = v_.size();
  row.head(n) = s.by_q;
  row.segment(n, n) = s.by_v;
  double y = by_q_[sensor].dot(q) + s.by_v.dot(v) + s.offset;
  if (s.at) {
    Workspace& ws = step_->system().ws;
    move_arm(*arm_, ws, q, v);
    slice_jacobian(*arm_, ws, *s.at, J_);
    y += s.along.dot(slice_pose(ws, *s.at).p);
    row.head(n).noalias() += J_.topRows<3>().transpose().lazyProduct(s.along);
  }
  return y;
}

/// q changes by u_. A ball turns, and with it the axes in which its errors are: they change by turned_.
void KalmanFilter::turn() {
  if (q_.size() == u_.size()) {
    q_ += u_;
    return;
  }
  from_ = q_;
  displace(*arm_, from_, u_, q_);
  displace_slopes(*arm_, u_, back_, turned_);
}

/// The state changes by so many times gain_.
void KalmanFilter::add(double times) {
  const Index n = v_.size(), m = p_.size();
  u_ = times * gain_.head(n);
  turn();
  if (q_.size() != n)
    for (Index j = 0; j < L_.cols(); ++j) {
      u_.noalias() = turned_.lazyProduct(L_.col(j).head(n));
      L_.col(j).head(n) = u_;
    }
  v_ += times * gain_.segment(n, n);
  p_ += times * gain_.segment(2 * n, m);
  f_ += times * gain_.tail(f_.size());
}

/// A parameter that is below its bound goes there, and the rest of the state to its most likely value then.
void KalmanFilter::bound(Index parameter) {
  const Index row = 2 * v_.size() + parameter;
  if (!(p_[parameter] < lowest_[parameter])) return;
  phi_ = L_.row(row).transpose();
  const double variance = phi_.squaredNorm();
  if (variance > 0.0) {
    gain_.noalias() = L_ * phi_;
    add((lowest_[parameter] - p_[parameter]) / variance);
  }
  p_[parameter] = lowest_[parameter];
}

/// Readings of places are not linear: the update is repeated about where it leads to, until it leads there (the
/// iterated filter: Jazwinski 1970, Sec. 8.3). change_ and about_ are changes of the state from that before.
Status KalmanFilter::update(const VectorXd& y) {
  const Index n = v_.size(), m = p_.size();
  bool curved = false;
  for (std::size_t k = 0; k < sensors_.size(); ++k)
    curved = curved || (sensors_[k].at && sensors_[k].F.rows() == 0 && std::isfinite(y[static_cast<Index>(k)]));
  q0_ = q_;
  v0_ = v_;
  f0_ = f_;
  about_.setZero();
  if (curved) L0_ = L_;
  for (int pass = 0; pass < (curved ? kPasses : 1); ++pass) {
    if (pass > 0) {
      about_ = change_;
      L_ = L0_;
      q_ = q0_;
      u_ = about_.head(n);
      turn();
      v_ = v0_ + about_.segment(n, n);
      f_ = f0_ + about_.tail(f_.size());
    }
    take(y, pass > 0);
    double moved = 0.0;
    for (Index i = 0; i < L_.rows(); ++i) {
      const double step = std::abs(change_[i] - about_[i]);
      if (step > 0.0) moved = std::max(moved, step / L_.row(i).norm());
    }
    if (moved < kMoved) break;
  }
  q_ = q0_;
  v_ = v0_;
  f_ = f0_;
  gain_ = change_;
  add(1.0);
  for (Index k = 0; k < m; ++k) bound(k);
  return q_.allFinite() && v_.allFinite() && p_.allFinite() && L_.allFinite() ? Status::ok : Status::not_finite;
}

/// Readings, one after the other, into change_ and L_, by their values about_ the state and their slopes there.
void KalmanFilter::take(const VectorXd& y, bool turned) {
  const Index n = v_.size();
  nis_ = 0.0;
  used_ = 0;
  change_.setZero();
  for (std::size_t k = 0; k < sensors_.size(); ++k) {
    const Index at = static_cast<Index>(k);
    innovations_[at] = std::numeric_limits<double>::quiet_NaN();
    innovation_deviations_[at] = innovations_[at];
    if (!std::isfinite(y[at])) continue;
    double innovation = y[at] - expected(k);
    const double noise = sensors_[k].noise * sensors_[k].noise;
    if (turned && q_.size() != n) {
      u_.noalias() = turned_.transpose().lazyProduct(row_.head(n));
      row_.head(n) = u_;
    }
    innovation -= row_.dot(change_) - row_.dot(about_);
    phi_.noalias() = L_.transpose() * row_;
    const double variance = phi_.squaredNorm() + noise;
    gain_.noalias() = L_ * phi_;
    const double less = 1.0 / (variance + std::sqrt(variance * noise));  // Potter (1963)
    for (Index j = 0; j < L_.cols(); ++j) L_.col(j) -= less * phi_[j] * gain_;
    change_ += innovation / variance * gain_;
    innovations_[at] = innovation;
    innovation_deviations_[at] = std::sqrt(variance);
    nis_ += innovation * innovation / variance;
    ++used_;
  }
}

void KalmanFilter::place(const PlacedSlice& at, Eigen::Vector3d& p, Eigen::Matrix3d& covariance) {
  Workspace& ws = step_->system().ws;
  move_arm(*arm_, ws, q_, v_);
  slice_jacobian(*arm_, ws, at, J_);
  p = slice_pose(ws, at).p;
  covariance.setZero();
  for (Index j = 0; j < L_.cols(); ++j) {
    const Eigen::Vector3d moved = J_.topRows<3>().lazyProduct(L_.col(j).head(v_.size()));
    covariance += moved * moved.transpose();
  }
}

VectorXd KalmanFilter::state() const {
  const VectorXd memory = step_->memory();
  VectorXd out(q_.size() + v_.size() + p_.size() + f_.size() + 2 * innovations_.size() + L_.size() + 3 + memory.size());
  out << q_, v_, p_, f_, innovations_, innovation_deviations_, L_.reshaped(), t_, nis_, used_, memory;
  return out;
}

void KalmanFilter::resume(const VectorXd& state) {
  const double* at = state.data();
  for (VectorXd* x : {&q_, &v_, &p_, &f_, &innovations_, &innovation_deviations_}) {
    *x = Eigen::Map<const VectorXd>(at, x->size());
    at += x->size();
  }
  L_ = Eigen::Map<const Eigen::MatrixXd>(at, L_.rows(), L_.cols());
  at += L_.size();
  t_ = *at++;
  nis_ = *at++;
  used_ = static_cast<int>(*at++);
  step_->recall(state.tail(state.data() + state.size() - at));
}

}  // namespace flexarm
