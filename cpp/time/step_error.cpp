#include "step_error.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace flexarm {

namespace {

constexpr double kStepsPart = 0.25;            // of the tolerance, for one step: the errors of a run's steps add up
constexpr double kRubbingStepsPart = 0.03;     // of an arm with dry friction, whose switches pass errors of forces on
constexpr double kSeenRadians = 0.15;          // phase of a mode in a step: faster ones count by their size
constexpr double kJustBeforeEnd = 1.0 - 1e-6;  // part of a step: its end, before a force may leap there
constexpr int kLookedAt = 64;                  // of a step, for the largest error within
constexpr double kUnseenPart = 1e-2;  // of the error allowed of places: one of less does not count for its energy

/// The largest displacement and change of velocity within a step of unit length, by an acceleration that is one at its
/// beginning and a multiple of the polynomial whose zeros are the points.
std::pair<double, double> largest_missed(const Eigen::VectorXd& points) {
  const Eigen::Index degree = points.size();
  Eigen::VectorXd polynomial = Eigen::VectorXd::Unit(degree + 1, 0);  // its coefficients, lowest power first
  for (double zero : points)
    for (Eigen::Index k = degree; k >= 0; --k) polynomial[k] = (k > 0 ? polynomial[k - 1] : 0.0) - zero * polynomial[k];
  double place = 0.0, rate = 0.0;
  for (int n = 1; n <= kLookedAt; ++n) {
    const double x = static_cast<double>(n) / kLookedAt;
    double once = 0.0, twice = 0.0;
    for (Eigen::Index k = degree; k >= 0; --k) {
      const double power = static_cast<double>(k) + 1.0;
      once = once * x + polynomial[k] / power;
      twice = twice * x + polynomial[k] / (power * (power + 1.0));
    }
    rate = std::max(rate, std::abs(once) * x / std::abs(polynomial[0]));
    place = std::max(place, std::abs(twice) * x * x / std::abs(polynomial[0]));
  }
  return {place, rate};
}

}  // namespace

StepError::StepError(const Arm& arm, Workspace& ws, const std::vector<int>& free, const Eigen::VectorXd& points,
                     bool rubs, double tolerance)
    : arm_(&arm),
      free_(&free),
      asked_(rubs ? Eigen::VectorXd(Eigen::VectorXd::Zero(1)) : Eigen::VectorXd(Eigen::Vector2d(0.0, kJustBeforeEnd))),
      tolerance_(tolerance),
      allowed_(tolerance * (rubs ? kRubbingStepsPart : kStepsPart)) {
  std::tie(places_missed_, rates_missed_) = largest_missed(points);
  move_arm(arm, ws, arm.zero(), Eigen::VectorXd::Zero(arm.nv()));
  std::vector<Eigen::Vector3d> ends;
  std::vector<double> lengths;  // from the base to each link's end
  for (std::size_t n = 0; n < arm.size(); ++n) {
    places_.emplace_back(arm, n);
    if (const auto& beam = arm.link(n).beam()) places_.emplace_back(arm, n, 0.5 * beam->length());
    ends.push_back(slice_pose(ws, n).p);
    const bool carried = arm.parent(n) != Arm::kWorld;
    const auto below = static_cast<std::size_t>(carried ? arm.parent(n) : 0);
    lengths.push_back(carried ? lengths[below] + (ends[n] - ends[below]).norm() : ends[n].norm());
    length_ = std::max(length_, lengths.back());
  }
  if (length_ == 0.0) length_ = 1.0;
  moves_.setZero(6 * static_cast<Eigen::Index>(places_.size()) + arm.nv(), arm.nv());
  jacobian_.setZero(6, arm.nv());
  const auto n = static_cast<Eigen::Index>(free.size());
  filter_ = Eigen::MatrixXd::Identity(n, n);
  filtered_ = decltype(filtered_)(n);
  forced_ = displaced_ = Eigen::VectorXd::Zero(n);
  impulse_ = inertia_ = Eigen::VectorXd::Zero(arm.nv());
}

void StepError::look(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
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

/// The matrix of a damped step makes displacements of a missed force: of modes that are slow, in proportion
/// to h^2; of modes that are too fast to be seen, their own size.
void StepError::factor(double h, const Eigen::MatrixXd& M, const Eigen::MatrixXd& C, const Eigen::MatrixXd& K) {
  h_ = h;
  filter_ = M + kSeenRadians * h * (C + kSeenRadians * h * K);
  filtered_.compute(filter_);
}

double StepError::operator()(const Eigen::VectorXd& missed_force, const Eigen::MatrixXd& M, const Eigen::VectorXd& v,
                             const Eigen::VectorXd& a, double kinetic) {
  forced_ = h_ * h_ * places_missed_ * missed_force;
  displaced_ = filtered_.solve(forced_);
  kinetic_ = std::max(kinetic_, kinetic);
  const double places = of_places();
  return std::max(places, std::min(of_energy(missed_force, M, v, a), places / kUnseenPart));
}

double StepError::of_places() const {
  double largest = 0.0;
  for (Eigen::Index row = 0; row < moves_.rows(); ++row) {
    double moved = 0.0;
    for (Eigen::Index k = 0; k < displaced_.size(); ++k)
      moved += moves_(row, (*free_)[static_cast<std::size_t>(k)]) * displaced_[k];
    largest = std::isfinite(moved) ? std::max(largest, std::abs(moved)) : HUGE_VAL;
  }
  return largest;
}

/// The errors of rates, which are in proportion to those of places, change the kinetic energy; those of places the
/// energy that the forces, which balance inertia, have put in. At the end of a step energy is right again: so these
/// errors do not add up.
double StepError::of_energy(const Eigen::VectorXd& missed_force, const Eigen::MatrixXd& M, const Eigen::VectorXd& v,
                            const Eigen::VectorXd& a) {
  impulse_.noalias() = M * v;
  inertia_.noalias() = M * a;
  double by_rates = 0.0, by_places = 0.0;
  for (Eigen::Index k = 0; k < displaced_.size(); ++k) {
    const int row = (*free_)[static_cast<std::size_t>(k)];
    by_rates += impulse_[row] * displaced_[k];
    by_places += (inertia_[row] + missed_force[k]) * displaced_[k];
  }
  const double off = std::abs(by_places) + rates_missed_ / (h_ * places_missed_) * std::abs(by_rates);
  return off > 0.0 ? off / (tolerance_ * kinetic_) : 0.0;
}

void StepError::memory(const std::function<void(double&)>& visit) {
  for (double& number : moves_.reshaped()) visit(number);
  visit(kinetic_);
}

}  // namespace flexarm
