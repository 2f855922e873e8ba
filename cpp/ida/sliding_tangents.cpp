#include "sliding_tangents.hpp"

#include <cmath>

#include "flexarm/dry_friction.hpp"

namespace flexarm {

using Eigen::Index;
using Eigen::VectorXd;

namespace {

constexpr double kDifference = 2e-6;  // of the time simulated, for the rate of a holding force
constexpr double kAtOnce = 1e-6;      // parts of its stiction by which a holding force has leapt over it

}  // namespace

Drive held(const Arm& arm, const Contact& contact, const VectorXd& q) {
  const double place = q[arm.coordinate_of(contact.coordinate)];
  const auto still = [place](double) { return MotionValue{place, 0.0, 0.0}; };
  return {contact.coordinate, still, {}, Eigen::Vector2d(-1e300, 1e300), {}, true};
}

Drive sliding_force(const Contact& contact, double coulomb) {
  const double force = -contact.sense * coulomb;
  return {contact.coordinate, {}, [force](double) { return force; }, Eigen::Vector2d(-1e300, 1e300), {}, true};
}

SlidingTangents::SlidingTangents(const std::vector<Parameter>& parameters, System& free, std::size_t contacts)
    : parameters_(parameters), near_(parameters) {
  const StateTangents all(free, near_);  // which checks them
  by_q_ = all.q;
  by_v_ = all.v;
  coulomb_by_ = stiction_by_ = Eigen::MatrixXd::Zero(static_cast<Index>(contacts), all.size());
  for (std::size_t k = 0; k < near_.size(); ++k)
    for (const Neighbour& n : near_[k].neighbours) {
      const std::vector<Rub> rub = rubs(*n.problem.arm);
      for (std::size_t j = 0; j < contacts; ++j) {
        coulomb_by_(static_cast<Index>(j), static_cast<Index>(k)) += n.weight * rub[j].coulomb;
        stiction_by_(static_cast<Index>(j), static_cast<Index>(k)) += n.weight * rub[j].stiction;
      }
    }
}

void SlidingTangents::prepare(const Arm& arm, const std::vector<Contact>& contacts, const VectorXd& q,
                              const VectorXd& v) {
  for (const Contact& c : contacts)
    if (!c.given && c.sense == 0) by_v_.row(c.coordinate).setZero();
  for (std::size_t k = 0; k < near_.size(); ++k)
    for (std::size_t i = 0; i < near_[k].neighbours.size(); ++i) {
      const double offset = near_[k].neighbours[i].offset;
      Problem& n = near_[k].neighbours[i].problem;
      n.drives = parameters_[k].neighbours[i].problem.drives;
      n.q0 = q + offset * by_q_.col(static_cast<Index>(k));
      n.v0 = v + offset * by_v_.col(static_cast<Index>(k));
      const std::vector<Rub> rub = rubs(*n.arm);
      for (std::size_t j = 0; j < contacts.size(); ++j) {
        const Contact& c = contacts[j];
        if (c.given) continue;
        n.drives.push_back(c.sense == 0 ? held(arm, c, n.q0) : sliding_force(c, rub[j].coulomb));
      }
    }
}

Eigen::RowVectorXd SlidingTangents::lead(const Trajectory& part, std::size_t n, const Contact& contact,
                                         const VectorXd& q, const VectorXd& v, const VectorXd& a, double span,
                                         const Holding& holding) const {
  const int i = contact.coordinate;
  Eigen::RowVectorXd by(static_cast<Index>(near_.size()));
  if (contact.sense != 0) {  // its speed has come down to zero
    for (Index k = 0; k < by.size(); ++k) by[k] = -part.ends[static_cast<std::size_t>(k)].v(0, i) / a[i];
    return by;
  }
  const double t = part.reached, force = holding(n, t, q, v), d = kDifference * span;
  if (std::abs(std::abs(force) - contact.stiction) > kAtOnce * contact.stiction) return by.setZero();  // at a sample
  double rate = 25.0 * force;  // along the flow's tangent, backwards
  const double weights[] = {-48.0, 36.0, -16.0, 3.0};
  for (int s = 1; s <= 4; ++s) rate += weights[s - 1] * holding(n, t - s * d, q - s * d * v, v - s * d * a);
  rate /= 12.0 * d;
  const double sense = force > 0.0 ? 1.0 : -1.0;
  for (Index k = 0; k < by.size(); ++k)
    by[k] =
        (sense * stiction_by_(static_cast<Index>(n), k) - part.ends[static_cast<std::size_t>(k)].friction(0, i)) / rate;
  return by;
}

void SlidingTangents::end(const Trajectory& part) {
  for (std::size_t k = 0; k < near_.size(); ++k) {
    by_q_.col(static_cast<Index>(k)) = part.ends[k].q.row(0);
    by_v_.col(static_cast<Index>(k)) = part.ends[k].v.row(0);
  }
}

void SlidingTangents::leap(const VectorXd& a_before, const VectorXd& a_behind, const Eigen::RowVectorXd& lead) {
  by_v_ += (a_before - a_behind) * lead;
}

void SlidingTangents::separate(Trajectory& out, Index row, std::size_t n, const Contact& contact, double sense) const {
  for (std::size_t k = 0; k < out.tangents.size(); ++k) {
    double& force = out.tangents[k].friction(row, contact.coordinate);
    force = -sense * coulomb_by_(static_cast<Index>(n), static_cast<Index>(k));
    out.tangents[k].tau(row, contact.coordinate) -= force;
  }
}

}  // namespace flexarm
