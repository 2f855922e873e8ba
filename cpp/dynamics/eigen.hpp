// The sweeps on Eigen, for arms that the kernel does not know, and under loads.
#pragma once

#include "flexarm/ab.hpp"

namespace flexarm {
namespace eigen {

Status forward_dynamics_ab(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                           const Eigen::VectorXd& tau);
Status factor_shifted(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                      const Shift& shift, bool have_masses);
void solve_shifted(const Arm& arm, Workspace& ws, const Eigen::VectorXd& r, Eigen::VectorXd& x);
void composite_inertias(const Arm& arm, Workspace& ws, bool have_masses);
void composite_mass_matrix(const Arm& arm, Workspace& ws, bool have_masses);

}  // namespace eigen
}  // namespace flexarm
