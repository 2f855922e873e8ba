// What a run says where loops do not let it go on.
#pragma once

#include <string>
#include <vector>

#include "flexarm/arm.hpp"
#include "flexarm/drive.hpp"

namespace flexarm {

/// Why rigid loops do not let a run go on from q, v at time t: prescribed motions that contradict them within the next
/// steps of about h, or a singular position, where more of their equations depend on one another than at its start.
/// Empty where there is neither.
std::string told_of_loops(const Arm& arm, const std::vector<Drive>& drives, const Eigen::VectorXd& start,
                          const Eigen::VectorXd& q, const Eigen::VectorXd& v, double t, double h);

}  // namespace flexarm
