// Batches: many scenarios of one structure through the same fixed steps, from arrays to arrays, over threads.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "flexarm/load.hpp"

namespace flexarm {

/// Numbers of each scenario and time, in the caller's memory: those of scenario b and time k begin at
/// data + b scenario + k time. A stride of zero: alike for all.
struct BatchTable {
  const double* data = nullptr;
  std::ptrdiff_t scenario = 0, time = 0;
  const double* at(Eigen::Index b, Eigen::Index k = 0) const { return data + b * scenario + k * time; }
};

/// What is known at half steps: at the start, in the middle of the first step, at its end, and so on: 2 steps + 1
/// times.
struct BatchMotion {
  int coordinate;    ///< a prescribed rate
  BatchTable value;  ///< q, v, a at half steps
};
struct BatchForce {
  BatchTable column;  ///< generalised force per unit (nv)
  BatchTable value;   ///< one number at half steps
};
struct BatchLoad {
  std::vector<Load> places;  ///< one, or one for each scenario
  BatchTable wrench;         ///< [f; m] (N, N m) at half steps
};
/// See Feedback.
struct BatchFeedback {
  BatchTable column, by_q, by_v;  ///< (nv), (nq), (nv)
  BatchTable reference;           ///< one number at half steps
  BatchTable limit;               ///< one number
};

struct BatchProblem {
  std::vector<const Arm*> arms;  ///< one, or one for each scenario, of equal sizes
  Eigen::Index scenarios = 1;
  std::vector<double> lengths;     ///< of the steps (s)
  std::vector<double> times;       ///< at which they end, and before them the start's (s)
  std::vector<Eigen::Index> hold;  ///< for each step, the row of `tau` that is held over it
  std::vector<Eigen::Index> rows;  ///< a row is written after so many steps; increasing
  BatchTable q0, v0, tau;          ///< (nq), (nv), (nv); tau's times are rows that `hold` names
  std::vector<BatchMotion> motions = {};
  std::vector<BatchForce> forces = {};
  std::vector<BatchLoad> loads = {};
  std::vector<BatchFeedback> feedback = {};
  std::string integrator = "implicit";  ///< one of OneStep::methods
  double spectral_radius = 1.0;         ///< see ImplicitOptions
  double rtol = 1e-10;                  ///< see ImplicitOptions
  bool lanes = true;                    ///< whether scenarios may run side by side in the lanes of a pack
  Eigen::Index whole = 0;  ///< scenarios of the batch that this is a part of, or zero: too few of them run one by one
};

/// How a scenario ended. The first four are those of Status.
enum class BatchStatus : int { ok, singular, not_converged, not_finite, not_done };

/// The caller's memory, one row-major block (rows, n) for each scenario; what is null is not wanted. Rows behind a
/// failure are nan.
struct BatchOutput {
  double *q = nullptr, *v = nullptr, *a = nullptr, *tau = nullptr;  ///< nq, nv, nv, nv
  int* status = nullptr;                                            ///< BatchStatus of each scenario
  double* reached = nullptr;                                        ///< time reached (s) of each
};

struct BatchStats {
  long long steps = 0, evaluations = 0, factorisations = 0, iterations = 0;
  int workers = 1;
  int lanes = 1;  ///< scenarios side by side
  bool interrupted = false;
};

/// Runs all scenarios. What one gives depends on nothing but its own numbers, and by rounding on whether they are few:
/// not on the workers, nor on the others.
/// A scenario that fails is reported and spoils no other. Each worker has one workspace: memory does not grow with the
/// number of scenarios.
/// @param workers  threads, the calling one included; fewer where there is little to do
/// @param alive    called by the calling thread about ten times a second with the share of steps done; answers false
///                 to end the batch: what is not done then has status not_done
/// @throws std::invalid_argument for bad arguments; what `alive` throws goes through, all workers joined
BatchStats run_batch(const BatchProblem& problem, const BatchOutput& out, int workers,
                     const std::function<bool(double)>& alive = {});

}  // namespace flexarm
