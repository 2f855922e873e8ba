// The messages of a run that loops do not let go on.
#pragma once

#include <string>

#include "system.hpp"

namespace flexarm {

/// Why rigid loops do not let a run go on from the state of a system at time t: prescribed motions that contradict them
/// within the next steps of about h, or a singular position, where more of their equations depend on one another than
/// at its start. Empty where there is neither.
/// @param start  its coordinates there
std::string told_of_loops(const System& s, const Eigen::VectorXd& start, double t, double h);

}  // namespace flexarm
