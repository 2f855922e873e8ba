// Closed loops along a tape, in small changes. Of m rigid rows, with equations g = 0 and forces y:
//   r = M da + C dv + K dq - G dy = 0                              of the tree, under these forces
//   G^T da + second_by_v dv + second_by_q dq = 0                   of d^2 g/dt^2
// Behind each step the state is moved onto g = 0 and dg/dt = 0, in the metric of the step's own equations.
#pragma once

#include <Eigen/LU>
#include <Eigen/QR>

namespace flexarm {
namespace taped {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Slopes of the tree and of its loops at a place. Rows of rates that do not count are zero, but for M, where they are
/// those of the identity.
struct OpenSlopes {
  MatrixXd M, C, K;
  MatrixXd G, G_free;                            ///< (n, m); with zeros for rates that do not count
  MatrixXd rate_by_q, second_by_q, second_by_v;  ///< (m, n)
};

/// Of a matrix of rows, some of which may depend on others.
inline MatrixXd pseudo_inverse(const MatrixXd& C) {
  constexpr double kDependent = 1e-9;
  Eigen::VectorXd size = C.diagonal().cwiseAbs().cwiseSqrt();
  for (double& x : size) x = x > 0.0 ? 1.0 / x : 1.0;
  Eigen::CompleteOrthogonalDecomposition<MatrixXd> factor;
  factor.setThreshold(kDependent);
  factor.compute(size.asDiagonal() * C * size.asDiagonal());
  return size.asDiagonal() * factor.pseudoInverse() * size.asDiagonal();
}

inline MatrixXd below(const MatrixXd& upper, const MatrixXd& lower) {
  MatrixXd out(upper.rows() + lower.rows(), upper.cols());
  out << upper, lower;
  return out;
}

/// Changes of accelerations and of the loops' forces for each change of [r; d^2 g/dt^2].
struct Constrained {
  MatrixXd accelerations, forces;  ///< (n, n + m), (m, n + m)

  explicit Constrained(const OpenSlopes& at) {
    const Index n = at.M.rows();
    MatrixXd both(n, n + at.G.cols());
    both << MatrixXd::Identity(n, n), at.G_free;
    const MatrixXd moved = Eigen::PartialPivLU<MatrixXd>(at.M).solve(both), by_G = moved.rightCols(at.G.cols());
    const MatrixXd inverse = pseudo_inverse(at.G.transpose() * by_G);
    forces.resize(at.G.cols(), both.cols());
    forces << -inverse * (at.G.transpose() * moved.leftCols(n)), inverse;
    accelerations.resize(n, both.cols());
    accelerations << moved.leftCols(n), MatrixXd::Zero(n, at.G.cols());
    accelerations += by_G * forces;
  }
};

/// The move onto the loops behind a step: to q + w and v + z with N w = G y, g = 0, and the same of z and dg/dt. N is
/// M + shift: the slopes of the step's residual by its accelerations, at rest.
class Closing {
 public:
  Closing() = default;
  /// @param N  zero in rows of rates that do not count, but for ones on its diagonal
  /// @param by_q  derivatives of N w - G y and N z - G y by q, at fixed w, z and y (n, n)
  Closing(const OpenSlopes& at, const MatrixXd& N, const MatrixXd& w_by_q, const MatrixXd& z_by_q) {
    const Index n = N.rows(), m = at.G.cols();
    MatrixXd all(n, n + m);
    all << MatrixXd::Identity(n, n), at.G_free;
    all = Eigen::PartialPivLU<MatrixXd>(N).solve(all);
    const MatrixXd by_gap = all.rightCols(m) * pseudo_inverse(at.G.transpose() * all.rightCols(m));
    MatrixXd same = MatrixXd::Identity(n, n);
    v_ = {same - by_gap * at.G.transpose(), by_gap, {}};
    v_.by_force = v_.tangent * all.leftCols(n);
    same += v_.by_force * w_by_q;
    const Eigen::PartialPivLU<MatrixXd> turned(same);
    q_ = {turned.solve(v_.tangent), turned.solve(v_.by_gap), turned.solve(v_.by_force)};
    v_by_q_ = by_gap * at.rate_by_q + v_.by_force * z_by_q;
  }
  /// Changes of the state become those of the closed one.
  void close(MatrixXd& q, MatrixXd& v) const {
    q = q_.tangent * q;
    v = v_.tangent * v - v_by_q_ * q;
  }
  /// The changes of the closed state by those of [g; dg/dt; N w - G y; N z - G y].
  void follow(const MatrixXd& by, MatrixXd& q, MatrixXd& v) const {
    const Index n = v_by_q_.rows(), m = q_.by_gap.cols();
    q = -q_.by_gap * by.topRows(m) - q_.by_force * by.middleRows(2 * m, n);
    v = -v_.by_gap * by.middleRows(m, m) - v_.by_force * by.bottomRows(n) - v_by_q_ * q;
  }
  /// Both backwards: of derivatives of a number by q and v.
  void close_back(VectorXd& q, VectorXd& v) const {
    q = q_.tangent.transpose() * (q - v_by_q_.transpose() * v);
    v = v_.tangent.transpose() * v;
  }
  VectorXd follow_back(const VectorXd& q, const VectorXd& v) const {
    const VectorXd whole = q - v_by_q_.transpose() * v;
    VectorXd out(2 * (q_.by_gap.cols() + whole.size()));
    out << q_.by_gap.transpose() * whole, v_.by_gap.transpose() * v, q_.by_force.transpose() * whole,
        v_.by_force.transpose() * v;
    return -out;
  }
  /// Slopes by the state that is closed become those by the state before.
  void put_before(MatrixXd& by_v, MatrixXd& by_q) const {
    by_q = (by_q - by_v * v_by_q_) * q_.tangent;
    by_v = by_v * v_.tangent;
  }

 private:
  struct Changes {
    MatrixXd tangent, by_gap, by_force;
  };
  Changes q_, v_;
  MatrixXd v_by_q_;
};

}  // namespace taped
}  // namespace flexarm
