// Scenarios of a batch one after the other on workspaces: arms and loads that the kernels do not know. To be deleted
// when they know all.
#pragma once

#include <functional>
#include <memory>

#include "batch_lanes.hpp"
#include "flexarm/step.hpp"
#include "system.hpp"

namespace flexarm {

/// One thread's memory.
class Serial {
 public:
  /// @param tell  told about the steps done; answers false to end the batch
  Serial(const BatchProblem& problem, const BatchOutput& out, std::function<bool(long)> tell);
  void run(Eigen::Index scenario, BatchStats& stats);

 private:
  void prepare();
  bool hold(Eigen::Index row);
  BatchStatus run_scenario(BatchStats& stats);
  bool write_row();
  void put(double* block, const double* x, int n) const;

  const BatchProblem& p_;
  const BatchOutput& out_;
  std::function<bool(long)> tell_;
  Pace pace_;
  bool own_laws_ = false;  // whether columns or gains differ from scenario to scenario
  bool varies_ = false;    // whether anything changes within a step
  Eigen::Index b_ = 0;     // scenario
  Eigen::Index step_ = 0, half_ = 0, row_done_ = 0;
  const Arm* arm_ = nullptr;
  std::vector<Drive> drives_;
  std::vector<LoadDrive> loads_;
  Eigen::VectorXd tau_;  // held now
  std::unique_ptr<Control> control_;
  std::unique_ptr<System> system_;
  std::unique_ptr<OneStep> method_;
  Trajectory row_;     // of one row
  Eigen::VectorXd q_;  // with quaternions of unit length
};

}  // namespace flexarm
