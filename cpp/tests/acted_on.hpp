// A problem in which much acts at once.
#pragma once

#include <cmath>
#include <utility>

#include "arms.hpp"
#include "flexarm/kinematics.hpp"
#include "flexarm/problem.hpp"

namespace flexarm_test {

/// A floating arm with a ball, under a load that follows it, a motion, a law at its limit and one below.
inline flexarm::Problem acted_on() {
  using Eigen::VectorXd;
  flexarm::Problem out(floating_arm());
  const flexarm::Arm& arm = *out.arm;
  const int n = arm.nv();
  out.loads.push_back({flexarm::Load::at_end(arm, 1, false), [](double t) {
                         flexarm::Vec6<double> w;
                         w << 1.0, 40.0 * t, 0.5, 0.02, 0.0, 0.01;
                         return w;
                       }});
  out.drives.push_back({0, [](double t) { return flexarm::MotionValue{0.1 * t * t, 0.2 * t, 0.2}; }, {}});
  out.drives.push_back({1, {}, [](double t) { return 3.0 * std::cos(50.0 * t); }});
  for (const double limit : {1e-3, 1e3})
    out.feedback.push_back({VectorXd::Unit(n, 1),
                            20.0 * VectorXd::Unit(arm.nq(), 1),
                            2.0 * VectorXd::Unit(n, 4),
                            [](double t) { return 2.0 + t; },
                            {},
                            limit});
  return out;
}

/// q and v of it, displaced by d (2 nv).
inline std::pair<Eigen::VectorXd, Eigen::VectorXd> displaced(const flexarm::Problem& of, const Eigen::VectorXd& d) {
  const flexarm::Arm& arm = *of.arm;
  Eigen::VectorXd q = arm.zero(), turned = q;
  flexarm::displace(arm, q, wave_of(arm, 0.1, 0.4, 1e-4), turned);
  flexarm::displace(arm, turned, d.head(arm.nv()), q);
  return {q, wave_of(arm, 0.4, 0.8, 0.01) + d.tail(arm.nv())};
}

}  // namespace flexarm_test
