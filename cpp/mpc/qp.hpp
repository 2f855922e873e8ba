// Quadratic programs of one size, one after the other, by DAQP.
#pragma once

#include <Eigen/Core>
#include <memory>

namespace flexarm {

/// Least 1/2 z' H z + f' z with lower <= [z; A z] <= upper. Some rows of A are soft: breaking one by s costs
/// linear s + quadratic s^2 / 2. After construction nothing is allocated.
class Qp {
 public:
  /// @param linear, quadratic  of each row of A; zero: the row is not soft
  Qp(int variables, const Eigen::VectorXd& linear, const Eigen::VectorXd& quadratic, int max_iterations);
  ~Qp();
  Eigen::MatrixXd H;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> A;
  Eigen::VectorXd f, lower, upper;
  Eigen::VectorXd z;  ///< the solution
  int iterations = 0;

  /// To be called when H and A are there; f and the bounds need not be the last.
  /// @return whether H is positive definite
  bool prepare();
  /// @return whether it was solved; if not, z is as it was
  bool solve();
  /// Forgets the active set.
  void forget();

 private:
  struct Solver;
  std::unique_ptr<Solver> solver_;
};

}  // namespace flexarm
