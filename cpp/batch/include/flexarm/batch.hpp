// Batches: problems that differ in their numbers, through the same fixed steps, from arrays to arrays, over threads.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "flexarm/problem.hpp"
#include "flexarm/simulation.hpp"

namespace flexarm {

/// Numbers of each scenario and time, in the caller's memory: those of scenario b and time k begin at
/// data + b scenario + k time. A stride of zero: alike for all. Null: nothing is given.
struct BatchTable {
  const double* data = nullptr;
  std::ptrdiff_t scenario = 0, time = 0;
  const double* at(Eigen::Index b, Eigen::Index k = 0) const { return data + b * scenario + k * time; }
};

struct BatchProblem {
  /// One, or one for each scenario: with as many coordinates, loads and continuous laws, and the same rates prescribed.
  /// One that is for all may have sampled laws and events if these share no memory.
  std::vector<std::shared_ptr<const Problem>> problems;
  Eigen::Index scenarios = 1;
  Eigen::VectorXd t;       ///< times (s) that steps end at
  double step = 0.0;       ///< longest (s)
  Eigen::Index every = 1;  ///< of t, from one row of the results to the next
  BatchTable q0, v0;       ///< starts, in place of the problems'
  BatchTable tau;          ///< forces beside the problems', row k held from t[k] to t[k + 1]
  int nq = 0, nv = 0;      ///< how many numbers the tables and rows have, the first ones; 0: all
  Method method = {};
  /// In place of that method, another integrator of a scenario's problem.
  std::function<Trajectory(Eigen::Index scenario, const Problem&, const Eigen::VectorXd& t, const Alive&)> integrate =
      {};
  bool lanes = true;       ///< whether scenarios may run side by side in the lanes of a pack
  Eigen::Index whole = 0;  ///< scenarios of the batch that this is a part of, or zero: too few of them run one by one

  int row_q() const { return nq > 0 ? nq : problems[0]->arm->nq(); }
  int row_v() const { return nv > 0 ? nv : problems[0]->arm->nv(); }
  int row_contacts() const { return 3 * static_cast<int>(problems[0]->arm->contacts().size()); }
  int row_loops() const { return 6 * static_cast<int>(problems[0]->arm->loops().size()); }
  Eigen::Index rows() const { return (t.size() - 1) / every + 1; }
  const Problem& of(Eigen::Index scenario) const {
    return *problems[problems.size() == 1 ? 0 : static_cast<std::size_t>(scenario)];
  }
  /// Whether the kernels run all scenarios. Else each is one run of `simulate_fixed`, or `integrate`.
  bool in_kernels() const;
};

/// Whether the kernels of batches know the method, and the dry friction of the arm's joints in it.
bool in_kernels(const std::string& method, const Arm& arm);

/// How a scenario ended. The first four are those of Status; `ended`: by an event.
enum class BatchStatus : int { ok, singular, not_converged, not_finite, not_done, ended };

/// The caller's memory, one row-major block (rows, n) for each scenario; null: not wanted. Rows behind a
/// failure or a terminal event are nan.
struct BatchOutput {
  double *q = nullptr, *v = nullptr, *a = nullptr, *tau = nullptr;  ///< nq, nv, nv, nv
  double* contacts = nullptr;               ///< forces of the contacts on the arm, in the world: three numbers each
  double* loops = nullptr;                  ///< force and moment of each loop on its side b, in the world
  int* status = nullptr;                    ///< BatchStatus of each scenario
  double* reached = nullptr;                ///< time reached (s) of each
  std::vector<EventLog>* events = nullptr;  ///< of each: the occurrences of each of its events
  std::string* failure = nullptr;           ///< of each run of an integrator: why it ended
  /// Of each; of the kernels' scenarios steps, failed_steps and doubt.
  SimulationStats* stats = nullptr;
};

struct BatchStats {
  long long steps = 0, evaluations = 0, factorisations = 0, iterations = 0;
  int workers = 1;
  int lanes = 1;  ///< scenarios side by side in the kernels; 0: each was a run by itself
  bool interrupted = false;
};

/// A function of one scenario's own problem has thrown the exception nested in this.
struct ScenarioError : std::runtime_error {
  Eigen::Index scenario;
  explicit ScenarioError(Eigen::Index which)
      : std::runtime_error("scenario " + std::to_string(which)), scenario(which) {}
};

/// Runs all scenarios, each as `simulate_fixed` runs its problem, side by side in the kernels where these can. The
/// result of one depends on nothing but its own numbers, and by rounding on whether they are few: not on the workers,
/// nor on the others. A scenario that fails is reported and spoils no other. Each worker has one workspace: memory does
/// not grow with the number of scenarios.
/// @param workers  threads, the calling one included; fewer where there is little to do. The problems' functions are
///                 called from all of them
/// @param alive    called by the calling thread about ten times a second with the share of steps done; answers false
///                 to end the batch: scenarios that are not done then have status not_done
/// @throws std::invalid_argument for bad arguments; ScenarioError; exceptions of `alive` and of functions that all
///         scenarios share. All workers are joined then. Interrupted ends the batch as `alive` does
BatchStats run_batch(const BatchProblem& problem, const BatchOutput& out, int workers,
                     const std::function<bool(double)>& alive = {});

}  // namespace flexarm
