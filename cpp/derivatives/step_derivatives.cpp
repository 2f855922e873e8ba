#include "flexarm/step_derivatives.hpp"

#include "flexarm/dry_friction.hpp"
#include "flexarm/run_derivatives.hpp"
#include "system.hpp"

namespace flexarm {

StepDerivatives::StepDerivatives(const std::string& method, const Arm& arm, double h, const ImplicitOptions& options,
                                 const std::vector<Load>& loads)
    : problem_(std::shared_ptr<const Arm>(std::shared_ptr<void>(), &arm)),
      h_(h),
      options_(options),
      step_(method, arm, h, options),
      tape_(step_.stages()) {
  refuse_friction(arm, "step_derivatives");
  refuse_contact_friction(arm, "step_derivatives");
  refuse_balls(arm, "derivatives of steps");
  for (const Load& load : loads) problem_.loads.push_back({load, {}, {}});
}

Status StepDerivatives::operator()(Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau) {
  problem_.tau = tau;
  for (std::size_t k = 0; k < ws.loads.size(); ++k)
    problem_.loads[k].wrench = [wrench = ws.loads[k].wrench](double) { return wrench; };
  tape_ = Tape(step_.stages());
  step_.record(&tape_);
  Status status = step_.start(ws, q, v, tau);
  if (status == Status::ok) status = step_.advance(h_, ws, q, v, tau, {});
  if (status != Status::ok) return status;
  tape_.rows.push_back({static_cast<Eigen::Index>(tape_.entries.size()) - 1, 1.0, {}, {}, -1});
  complete(problem_, tape_);
  return status;
}

void StepDerivatives::matrices(Eigen::MatrixXd& A, Eigen::MatrixXd& B) const {
  state_matrices(problem_, tape_, options_, A, B);
}

}  // namespace flexarm
