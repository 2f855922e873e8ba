// A rollout on a tape, for its derivatives.
#pragma once

#include <string>

#include "flexarm/step.hpp"
#include "flexarm/trajectory.hpp"

namespace flexarm {

/// A rollout with its tape.
struct TapedRollout {
  Tape tape;                        ///< whose rows are the start and the ends of all steps, without accelerations
  Trajectory::Rows q, v;            ///< (nstep + 1, nv)
  std::vector<Eigen::Index> first;  ///< the first place of each step, and one behind the last
  Eigen::Index failed = -1;         ///< the step that could not be taken
  Status status = Status::ok;       ///< of that
};

/// The steps that a batch takes (BatchProblem) under forces that are held over each: they begin anew where the forces
/// are others than before.
/// @param tau  (nstep, nv)
/// @throws std::invalid_argument naming the field and the value
TapedRollout roll_on_tape(const std::string& method, const Arm& arm, double h, const ImplicitOptions& options,
                          const Eigen::VectorXd& q0, const Eigen::VectorXd& v0, const Trajectory::Rows& tau);

}  // namespace flexarm
