#include "place_error.hpp"

#include <cmath>

namespace flexarm {

namespace {

constexpr double kStepsPart = 0.25;            // of the tolerance, for one step: the errors of a run's steps add up
constexpr double kRubbingStepsPart = 0.03;     // of an arm with dry friction, whose switches pass errors of forces on
constexpr double kSeenRadians = 0.15;          // phase of a mode in a step: faster ones count by their size
constexpr double kJustBeforeEnd = 1.0 - 1e-6;  // part of a step: its end, before a force may leap there
constexpr int kSamples = 64;                   // of a step, for the largest error within

/// The largest displacement within a step of unit length by an acceleration that is one at its beginning, and a
/// multiple of the polynomial whose zeros are the points.
double largest_displacement(const Eigen::VectorXd& points) {
  const Eigen::Index degree = points.size();
  Eigen::VectorXd polynomial = Eigen::VectorXd::Unit(degree + 1, 0);  // its coefficients, lowest power first
  for (double zero : points)
    for (Eigen::Index k = degree; k >= 0; --k) polynomial[k] = (k > 0 ? polynomial[k - 1] : 0.0) - zero * polynomial[k];
  double largest = 0.0;
  for (int n = 1; n <= kSamples; ++n) {
    const double x = static_cast<double>(n) / kSamples;
    double twice = 0.0;
    for (Eigen::Index k = degree; k >= 0; --k)
      twice = twice * x + polynomial[k] / ((static_cast<double>(k) + 1.0) * (static_cast<double>(k) + 2.0));
    largest = std::max(largest, std::abs(twice) * x * x / std::abs(polynomial[0]));
  }
  return largest;
}

}  // namespace

PlaceError::PlaceError(const Arm& arm, Workspace& ws, const std::vector<int>& free, const Eigen::VectorXd& points,
                       bool rubs, double tolerance)
    : arm_(&arm),
      free_(&free),
      asked_(rubs ? Eigen::VectorXd(Eigen::VectorXd::Zero(1)) : Eigen::VectorXd(Eigen::Vector2d(0.0, kJustBeforeEnd))),
      allowed_(tolerance * (rubs ? kRubbingStepsPart : kStepsPart)),
      missed_part_(largest_displacement(points)) {
  move_arm(arm, ws, arm.zero(), Eigen::VectorXd::Zero(arm.nv()));
  Eigen::Vector3d before = Eigen::Vector3d::Zero();
  for (std::size_t n = 0; n < arm.size(); ++n) {
    places_.emplace_back(arm, n);
    if (const auto& beam = arm.link(n).beam()) places_.emplace_back(arm, n, 0.5 * beam->length());
    const Eigen::Vector3d end = slice_pose(ws, n).p;
    length_ += (end - before).norm();
    before = end;
  }
  if (length_ == 0.0) length_ = 1.0;
  moves_.setZero(6 * static_cast<Eigen::Index>(places_.size()) + arm.nv(), arm.nv());
  jacobian_.setZero(6, arm.nv());
  const auto n = static_cast<Eigen::Index>(free.size());
  filter_ = Eigen::MatrixXd::Identity(n, n);
  filtered_ = decltype(filtered_)(n);
  forced_ = displaced_ = Eigen::VectorXd::Zero(n);
}

void PlaceError::look(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  move_arm(*arm_, ws, q, v);
  Eigen::Index row = 0;
  for (const PlacedSlice& at : places_) {
    slice_jacobian(*arm_, ws, at, jacobian_);
    moves_.middleRows<3>(row) = jacobian_.topRows<3>() / (length_ * allowed_);
    if (!at.on_beam()) moves_.middleRows<3>(row + 3) = jacobian_.bottomRows<3>() / allowed_;
    row += 6;
  }
  for (std::size_t n = 0; n < arm_->size(); ++n) {
    Eigen::Index i = arm_->first(n);
    for (const auto& motion : arm_->link(n).joint().motions()) {
      moves_(row + i, i) = 1.0 / (allowed_ * (motion.rotation ? 1.0 : length_));
      ++i;
    }
  }
}

/// What the matrix of a damped step makes of a missed force are displacements: of modes that are slow, in proportion
/// to h^2; of modes that are too fast to be seen, their own size.
void PlaceError::factor(double h, const Eigen::MatrixXd& M, const Eigen::MatrixXd& C, const Eigen::MatrixXd& K) {
  missed_time2_ = h * h * missed_part_;
  filter_ = M + kSeenRadians * h * (C + kSeenRadians * h * K);
  filtered_.compute(filter_);
}

double PlaceError::operator()(const Eigen::VectorXd& missed_force) {
  forced_ = missed_time2_ * missed_force;
  displaced_ = filtered_.solve(forced_);
  double largest = 0.0;
  for (Eigen::Index row = 0; row < moves_.rows(); ++row) {
    double moved = 0.0;
    for (Eigen::Index k = 0; k < displaced_.size(); ++k)
      moved += moves_(row, (*free_)[static_cast<std::size_t>(k)]) * displaced_[k];
    largest = std::isfinite(moved) ? std::max(largest, std::abs(moved)) : HUGE_VAL;
  }
  return largest;
}

void PlaceError::memory(const std::function<void(double&)>& visit) {
  for (double& number : moves_.reshaped()) visit(number);
}

}  // namespace flexarm
