// Batches for the tests.
#pragma once

#include <vector>

#include "flexarm/batch.hpp"

namespace flexarm_test {

/// A problem for each arm, or one, at rest with nothing acting on it, through `steps` steps of h; rows at the end.
inline flexarm::BatchProblem batch_of(const std::vector<const flexarm::Arm*>& arms, Eigen::Index scenarios, double h,
                                      Eigen::Index steps) {
  flexarm::BatchProblem p;
  for (const flexarm::Arm* arm : arms)
    p.problems.push_back(
        std::make_shared<flexarm::Problem>(std::shared_ptr<const flexarm::Arm>(std::shared_ptr<void>(), arm)));
  p.scenarios = scenarios;
  p.t = Eigen::VectorXd::LinSpaced(steps + 1, 0.0, h * static_cast<double>(steps));
  p.step = h;
  p.every = steps;
  return p;
}

/// With these starts, (n, scenarios), from column `first` on.
inline void begin_at(flexarm::BatchProblem& p, const Eigen::MatrixXd& q0, const Eigen::MatrixXd& v0,
                     Eigen::Index first = 0) {
  p.q0 = {q0.col(first).data(), q0.rows(), 0};
  p.v0 = {v0.col(first).data(), v0.rows(), 0};
}

}  // namespace flexarm_test
