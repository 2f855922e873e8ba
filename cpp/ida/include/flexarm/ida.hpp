// Variable-step, variable-order integration by SUNDIALS IDA (as its superset IDAS has it) on the inverse-dynamics
// residual
//   [dq/dt - v; M(q) dv/dt + h(q, v) - tau] = 0
// of the coordinates that are not prescribed. Its linear systems are solved with the exact Jacobian, or, on long arms,
// in O(N) by GMRES preconditioned with AB's elimination.
#pragma once

#include <functional>
#include <vector>

#include "flexarm/parameter.hpp"
#include "flexarm/trajectory.hpp"

namespace flexarm {

enum class LinearSolver {
  automatic,  ///< chain (dense with rigid loops), which is the faster one at any number of links
  dense,      ///< exact Jacobian, factored: O(N^3) once in several steps
  chain  ///< not with rigid loops, which take `dense`: AB's elimination of M + C/cj + K/cj^2, within GMRES where it is
         ///< not enough by itself: O(N)
};

struct IdaOptions {
  double rtol = 1e-6;
  double atol = 1e-9;  ///< of every coordinate and rate, in its own unit; with rigid loops, not of elastic rates
  int max_order = 5;   ///< of the backward differentiation formulas, 1 to 5
  LinearSolver linear_solver = LinearSolver::automatic;
  /// Told the time reached and the steps taken after 20 000 steps, and whenever there are twice as many.
  std::function<void(double t, long steps)> slow = {};
};

/// Integrates from t[0] to the last of t, which must increase. Events are found by IDA's root finding, to the precision
/// of its interpolation; at a switch of dry friction it starts again.
/// @param parameters of Trajectory::tangents: IDAS' forward sensitivities, whose errors count as those of the
///                   state do
/// @throws std::invalid_argument for bad arguments; exceptions of drives, events and `alive` pass through
Trajectory simulate_ida(const Problem& problem, const Eigen::VectorXd& t, const IdaOptions& options,
                        const Alive& alive = {}, const std::vector<Parameter>& parameters = {});

}  // namespace flexarm
