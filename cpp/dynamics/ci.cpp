#include "flexarm/ci.hpp"

#include <Eigen/QR>

#include "arrays.hpp"
#include "setup/single.hpp"

namespace flexarm {

void take_composite(const Arm& arm, Workspace& ws) {
  const Eigen::Index n = static_cast<Eigen::Index>(ws.free.size());
  ws.M.resize(arm.nv(), arm.nv());  // resize does nothing where the size is right
  ws.M_free.setIdentity(n, n);
  ws.factor.compute(ws.M_free);
}

void composite_mass_matrix(const Arm& arm, Workspace& ws) {
  ws.M.resize(arm.nv(), arm.nv());
  ws.placed_chain().mass_matrix(ws.M.data());
}

void composite_mass_matrix(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q) {
  ws.chain_to_move().move(q.data(), nullptr);
  composite_mass_matrix(arm, ws);
}

namespace {

/// Accelerations of the tree become those of the closed loops: the smallest forces in them that make d^2 g/dt^2 zero.
void constrain(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  const Eigen::Index rows = ws.chain().layout().rigid_rows, n = static_cast<Eigen::Index>(ws.free.size());
  Eigen::MatrixXd all(arm.nv(), rows), G(n, rows);
  Eigen::Matrix3Xd found(3, rows);
  inverse_dynamics(arm, ws, q, v, ws.a);
  ws.chain().loop_rows(found.data(), all.data());
  for (Eigen::Index k = 0; k < n; ++k) G.row(k) = all.row(ws.free[static_cast<std::size_t>(k)]);
  const Eigen::MatrixXd by_force = ws.factor.solve(G);
  const Eigen::MatrixXd C = G.transpose() * by_force;
  ws.rhs = by_force * C.completeOrthogonalDecomposition().solve(-found.row(2).transpose());
  for (Eigen::Index k = 0; k < n; ++k) ws.a[ws.free[static_cast<std::size_t>(k)]] += ws.rhs[k];
}

}  // namespace

Status forward_dynamics_ci(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                           const Eigen::VectorXd& tau) {
  // tau - H^T Phi^T (M Phi N + N) of Eq. 90: inverse dynamics with the free accelerations at zero
  for (int i : ws.free) ws.a[i] = 0.0;
  inverse_dynamics(arm, ws, q, v, ws.a);
  composite_mass_matrix(arm, ws);
  const Eigen::Index n = static_cast<Eigen::Index>(ws.free.size());
  ws.M_free.resize(n, n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const int i = ws.free[k];
    ws.rhs[k] = tau[i] - ws.tau[i];
    for (Eigen::Index l = 0; l < n; ++l) ws.M_free(k, l) = ws.M(i, ws.free[l]);
  }
  ws.factor.compute(ws.M_free);
  if (ws.factor.info() != Eigen::Success) return all_finite(ws.M_free) ? Status::singular : Status::not_finite;
  ws.factor.solveInPlace(ws.rhs);
  for (Eigen::Index k = 0; k < n; ++k) ws.a[ws.free[k]] = ws.rhs[k];
  if (!arm.loops().empty()) constrain(arm, ws, q, v);
  return all_finite(q) && all_finite(v) && all_finite(ws.a) ? Status::ok : Status::not_finite;
}

}  // namespace flexarm
