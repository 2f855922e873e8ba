// Predictive control, as a law of a run.
#pragma once

#include "interpreter.hpp"

#ifdef FLEXARM_MPC
#include "flexarm/mpc.hpp"

/// The law for an arm whose coordinates differ from the model's.
struct MpcLaw {
  std::unique_ptr<flexarm::Mpc> mpc;
  Eigen::MatrixXd to_q, to_v;          ///< the model's coordinates and rates by those of the arm
  Eigen::MatrixXd forces;              ///< the arm's forces by the inputs
  std::shared_ptr<py::object> failed;  ///< called with the time and status of a sample that was not solved
  /// Generalised forces of the arm.
  Eigen::VectorXd operator()(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v);
};
#endif
