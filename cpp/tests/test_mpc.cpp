// Predictive control: its step and the derivatives of that, its quadratic programs, and that nothing is allocated.
#ifdef FLEXARM_MPC
#include <doctest/doctest.h>

#include "arms.hpp"
#include "damped_step.hpp"
#include "flexarm/mpc.hpp"
#include "flexarm/step.hpp"
#include "prediction.hpp"
#include "qp.hpp"
#include "watch.hpp"

using namespace flexarm;
using Eigen::MatrixXd;
using Eigen::VectorXd;

TEST_CASE("derivatives of the damped step are those of differences") {
  const Arm arm = flexarm_test::spatial_arm();
  const Eigen::Index n = arm.nv();
  if (arm.nq() != n) return;
  const MatrixXd columns = MatrixXd::Identity(n, n).leftCols(3);
  DampedStep step(arm, columns, 1, 0.05);
  const VectorXd q0 = flexarm_test::wave(arm.nq(), 0.1, 1e-3), v0 = flexarm_test::wave(n, 0.4, 0.05);
  const VectorXd u0 = VectorXd::Constant(3, 0.5);
  const auto end = [&](const VectorXd& x, const VectorXd& u) {
    VectorXd q = x.head(n), v = x.tail(n);
    CHECK(step(0, 1e-3, q, v, columns * u) == Status::ok);
    VectorXd out(2 * n);
    out << q, v;
    return out;
  };
  VectorXd x0(2 * n);
  x0 << q0, v0;
  end(x0, u0);
  MatrixXd A(2 * n, 2 * n), B(2 * n, 3);
  step.derivatives(A, B);
  constexpr double e = 1e-6;
  MatrixXd A_d = A, B_d = B;
  for (Eigen::Index k = 0; k < 2 * n; ++k) {
    const VectorXd d = e * VectorXd::Unit(2 * n, k);
    A_d.col(k) = (end(x0 + d, u0) - end(x0 - d, u0)) / (2 * e);
  }
  for (Eigen::Index k = 0; k < 3; ++k) {
    const VectorXd d = e * VectorXd::Unit(3, k);
    B_d.col(k) = (end(x0, u0 + d) - end(x0, u0 - d)) / (2 * e);
  }
  MESSAGE((A - A_d).cwiseAbs().maxCoeff() << " " << A.cwiseAbs().maxCoeff() << " " << (B - B_d).cwiseAbs().maxCoeff());
  CHECK((A - A_d).norm() < 1e-5 * A.norm());
  CHECK((B - B_d).norm() < 1e-5 * B.norm());
}
#endif
