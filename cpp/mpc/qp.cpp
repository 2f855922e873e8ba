#include "qp.hpp"

#include <vector>

extern "C" {
#include "api.h"
#include "utils.h"
}

namespace flexarm {

struct Qp::Solver {
  DAQPWorkspace work{};
  DAQPProblem problem{};
  DAQPSettings settings{};
  DAQPResult result{};
  std::vector<int> sense;
  Eigen::VectorXd x, multipliers;
  bool prepared = false;

  ~Solver() {
    work.settings = nullptr;  // our own
    free_daqp_workspace(&work);
    free_daqp_ldp(&work);
  }
};

Qp::Qp(int variables, const Eigen::VectorXd& linear, const Eigen::VectorXd& quadratic, int max_iterations)
    : solver_(std::make_unique<Solver>()) {
  const int rows = static_cast<int>(linear.size()), all = variables + rows;
  H = Eigen::MatrixXd::Identity(variables, variables);
  A.setOnes(rows, variables);
  f = z = Eigen::VectorXd::Zero(variables);
  lower = Eigen::VectorXd::Constant(all, -1.0);
  upper = -lower;
  Solver& s = *solver_;
  s.sense.assign(static_cast<std::size_t>(all), 0);
  for (int k = 0; k < rows; ++k)
    if (quadratic[k] > 0.0) s.sense[static_cast<std::size_t>(variables + k)] = DAQP_SOFT;
  s.x = z;
  s.multipliers = Eigen::VectorXd::Zero(all);
  s.result.x = s.x.data();
  s.result.lam = s.multipliers.data();
  daqp_default_settings(&s.settings);
  s.settings.iter_limit = max_iterations;
  s.settings.primal_tol = 1e-9;
  s.settings.eq_reduction = DAQP_EQ_REDUCTION_OFF;
  s.settings.presolve = 0;
  s.problem.n = variables;
  s.problem.m = all;
  s.problem.ms = variables;
  s.problem.H = H.data();
  s.problem.f = f.data();
  s.problem.A = rows > 0 ? A.data() : nullptr;
  s.problem.bupper = upper.data();
  s.problem.blower = lower.data();
  s.problem.sense = s.sense.data();
  s.work.settings = &s.settings;
  setup_daqp(&s.problem, &s.work, nullptr);
  daqp_allocate_soft_weights(&s.work);
  for (int k = 0; k < rows; ++k) {
    if (!(quadratic[k] > 0.0)) continue;
    const int at = variables + k;
    s.work.rho_ls[at] = s.work.rho_us[at] = 1.0 / quadratic[k];
    s.work.w_ls[at] = s.work.w_us[at] = linear[k];
  }
}

Qp::~Qp() = default;

bool Qp::prepare() {
  Solver& s = *solver_;
  s.prepared =
      daqp_update_ldp(DAQP_UPDATE_Rinv | DAQP_UPDATE_M | DAQP_UPDATE_v | DAQP_UPDATE_d, &s.work, &s.problem) >= 0 &&
      s.work.n_prox == 0;
  return s.prepared;
}

bool Qp::solve() {
  Solver& s = *solver_;
  iterations = 0;
  if (!s.prepared || !f.allFinite()) return false;
  if (daqp_update_ldp(DAQP_UPDATE_v | DAQP_UPDATE_d, &s.work, &s.problem) < 0) return false;
  daqp_solve(&s.result, &s.work);
  iterations = s.result.iter;
  const int flag = s.result.exitflag;
  const bool good = flag == DAQP_EXIT_OPTIMAL || flag == DAQP_EXIT_SOFT_OPTIMAL || flag == DAQP_EXIT_OPTIMAL_INEXACT;
  if (!good || !s.x.allFinite()) {
    forget();
    return false;
  }
  z = s.x;
  return true;
}

void Qp::forget() {
  Solver& s = *solver_;
  reset_daqp_workspace(&s.work);
  for (std::size_t k = 0; k < s.sense.size(); ++k) s.work.sense[k] = s.sense[k];
}

}  // namespace flexarm
