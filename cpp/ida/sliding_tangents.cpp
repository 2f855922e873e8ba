#include "sliding_tangents.hpp"

#include "flexarm/dry_friction.hpp"

namespace flexarm {

using Eigen::Index;
using Eigen::VectorXd;

Drive held(const Arm& arm, const RubbingJoint& joint, const VectorXd& q) {
  const double place = q[arm.coordinate_of(joint.coordinate)];
  const auto still = [place](double) { return MotionValue{place, 0.0, 0.0}; };
  return {joint.coordinate, still, {}, Eigen::Vector2d(-1e300, 1e300), {}, true};
}

Drive sliding_force(const RubbingJoint& joint, double coulomb) {
  const double force = -joint.sense * coulomb;
  return {joint.coordinate, {}, [force](double) { return force; }, Eigen::Vector2d(-1e300, 1e300), {}, true};
}

SlidingTangents::SlidingTangents(const std::vector<Parameter>& parameters, System& free, std::size_t joints)
    : parameters_(parameters), near_(parameters) {
  const StateTangents all(free, near_);  // which checks them
  by_q_ = all.q;
  by_v_ = all.v;
  coulomb_by_ = stiction_by_ = Eigen::MatrixXd::Zero(static_cast<Index>(joints), all.size());
  for (std::size_t k = 0; k < near_.size(); ++k)
    for (const Neighbour& n : near_[k].neighbours) {
      const std::vector<Rub> rub = rubs(*n.problem.arm);
      for (std::size_t j = 0; j < joints; ++j) {
        coulomb_by_(static_cast<Index>(j), static_cast<Index>(k)) += n.weight * rub[j].coulomb;
        stiction_by_(static_cast<Index>(j), static_cast<Index>(k)) += n.weight * rub[j].stiction;
      }
    }
}

void SlidingTangents::prepare(const Arm& arm, const std::vector<RubbingJoint>& joints, const VectorXd& q,
                              const VectorXd& v) {
  for (const RubbingJoint& c : joints)
    if (!c.given && c.sense == 0) by_v_.row(c.coordinate).setZero();
  for (std::size_t k = 0; k < near_.size(); ++k)
    for (std::size_t i = 0; i < near_[k].neighbours.size(); ++i) {
      const double offset = near_[k].neighbours[i].offset;
      Problem& n = near_[k].neighbours[i].problem;
      n.drives = parameters_[k].neighbours[i].problem.drives;
      n.q0 = q + offset * by_q_.col(static_cast<Index>(k));
      n.v0 = v + offset * by_v_.col(static_cast<Index>(k));
      const std::vector<Rub> rub = rubs(*n.arm);
      for (std::size_t j = 0; j < joints.size(); ++j) {
        const RubbingJoint& c = joints[j];
        if (c.given) continue;
        n.drives.push_back(c.sense == 0 ? held(arm, c, n.q0) : sliding_force(c, rub[j].coulomb));
      }
    }
}

void SlidingTangents::leap(const Trajectory& part, std::size_t n, const Saltation& switched) {
  Eigen::RowVectorXd gap(by_q_.cols());
  for (Index k = 0; k < gap.size(); ++k) {
    const Trajectory::Tangent& end = part.ends[static_cast<std::size_t>(k)];
    by_q_.col(k) = end.q.row(0);
    by_v_.col(k) = end.v.row(0);
    gap[k] = switched.tears == 0.0
                 ? end.v(0, switched.of)
                 : end.friction(0, switched.of) + switched.tears * stiction_by_(static_cast<Index>(n), k);
  }
  switched.leap(gap, by_v_);
}

void SlidingTangents::separate(Trajectory& out, Index row, std::size_t n, const RubbingJoint& joint,
                               double sense) const {
  for (std::size_t k = 0; k < out.tangents.size(); ++k) {
    double& force = out.tangents[k].friction(row, joint.coordinate);
    force = -sense * coulomb_by_(static_cast<Index>(n), static_cast<Index>(k));
    out.tangents[k].tau(row, joint.coordinate) -= force;
  }
}

}  // namespace flexarm
