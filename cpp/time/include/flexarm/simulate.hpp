// The time loop of fixed-step methods: outputs, drives, failures.
#pragma once

#include <vector>

#include "flexarm/problem.hpp"
#include "flexarm/step.hpp"
#include "flexarm/trajectory.hpp"

namespace flexarm {

/// Integrates from t[0] to the last of t, which must increase, by any fixed-step method. Output times and the samples
/// of drives and loads are met exactly: the time between two of them is divided into equal steps, as few as `step`
/// allows. A method that interpolates ends its steps at the samples of forces and loads alone, and halves those that
/// would miss some of a motion, or whose equations cannot be solved.
/// Events are seen where their sign differs between the ends of a step, and located on cubic interpolants. Dry friction
/// that is not in the method's equations is treated by switches (see friction.hpp).
/// A method that chooses its steps takes those whose error is allowed; where a law is a function without samples, none
/// passes over an output time.
/// @param step   longest step (s); not read where the method chooses
/// @param tape  of the method's `stages`: its record, for derivatives
/// @throws std::invalid_argument for bad arguments; exceptions of drives, events and `alive` pass through
Trajectory simulate_fixed(const Problem& problem, const Eigen::VectorXd& t, Step& method, double step,
                          const Alive& alive = {}, Tape* tape = nullptr);

}  // namespace flexarm
