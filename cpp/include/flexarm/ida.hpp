// Variable-step, variable-order integration by SUNDIALS IDA on the inverse-dynamics residual
//   [dq/dt - v; M(q) dv/dt + h(q, v) - tau] = 0
// of the coordinates that are not prescribed, with its exact Jacobian.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

#include "flexarm/arm.hpp"
#include "flexarm/drive.hpp"
#include "flexarm/load.hpp"

namespace flexarm {

struct IdaOptions {
  double rtol = 1e-6;
  double atol = 1e-9;      ///< of every coordinate and rate, in its own unit
  int max_order = 5;       ///< of the backward differentiation formulas, 1 to 5
  bool composite = false;  ///< accelerations at the output times by CI instead of AB
};

struct IdaStats {
  long steps = 0, residuals = 0, jacobians = 0, newton_iterations = 0, failed_steps = 0;
  double wall_time = 0.0;  ///< s
};

/// Trajectory::failure when `alive` asked to stop.
constexpr const char* kInterrupted = "interrupted";

/// One row per output time. Rows from `done` on are not written when the integration stopped early.
struct Trajectory {
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  Rows q, v, a, tau;  ///< tau: applied forces, and the reactions of prescribed motions
  Eigen::Index done = 0;
  double reached = 0.0;  ///< time reached (s)
  std::string failure;   ///< empty when all is done
  IdaStats stats;
};

/// Integrates from t[0] to the last of t, which must increase.
/// @param tau    constant generalised forces, length nv, to which force drives are added
/// @param alive  called now and then with the time reached; what is done is kept when it answers false
/// @throws std::invalid_argument for bad arguments; what a drive or `alive` throws goes through
Trajectory simulate_ida(const Arm& arm, const std::vector<Drive>& drives, const Eigen::VectorXd& t,
                        const Eigen::VectorXd& q0, const Eigen::VectorXd& v0, const Eigen::VectorXd& tau,
                        const IdaOptions& options, const std::function<bool(double)>& alive = {},
                        const std::vector<LoadDrive>& loads = {});

}  // namespace flexarm
