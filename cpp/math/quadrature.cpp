#include "flexarm/quadrature.hpp"

#include <Eigen/Eigenvalues>
#include <cmath>

#include "flexarm/spatial.hpp"

namespace flexarm {

GaussRule::GaussRule(int n, double length) : points(n), weights(n) {
  for (int i = 0; i < n; ++i) {
    // Newton's iteration on P_n from Tricomi's estimate of the root
    double x = -std::cos(kPi * (i + 0.75) / (n + 0.5)), slope = 1.0;
    for (int it = 0; it < 8; ++it) {
      double p0 = 1.0, p1 = x;
      for (int k = 2; k <= n; ++k) {
        const double p2 = ((2 * k - 1) * x * p1 - (k - 1) * p0) / k;
        p0 = p1;
        p1 = p2;
      }
      slope = n * (x * p1 - p0) / (x * x - 1.0);
      x -= p1 / slope;
    }
    points[i] = 0.5 * length * (1.0 + x);
    weights[i] = length / ((1.0 - x * x) * slope * slope);
  }
}

GaussRule::GaussRule(int n, double length, const std::vector<double>& breaks) : GaussRule(n, length) {
  if (breaks.empty()) return;
  std::vector<double> ends = breaks;
  ends.push_back(length);
  points.resize(n * static_cast<Eigen::Index>(ends.size()));
  weights.resize(points.size());
  double from = 0.0;
  for (std::size_t k = 0; k < ends.size(); ++k) {
    const GaussRule part(n, ends[k] - from);
    points.segment(static_cast<Eigen::Index>(k) * n, n) = part.points.array() + from;
    weights.segment(static_cast<Eigen::Index>(k) * n, n) = part.weights;
    from = ends[k];
  }
}

GaussRule gauss_rule_of(const GaussRule& measure, int n, Eigen::MatrixXd* shares) {
  // Lanczos on diag(points) from sqrt(weights), every vector made orthogonal to all before it: the matrix of the
  // three-term recurrence of the measure's orthogonal polynomials.
  Eigen::MatrixXd Q(measure.points.size(), n);
  Eigen::VectorXd diagonal(n), beside = Eigen::VectorXd::Zero(std::max(n - 1, 0));
  const double total = measure.weights.sum();
  Q.col(0) = (measure.weights / total).cwiseSqrt();
  for (int k = 0; k < n; ++k) {
    Eigen::VectorXd next = measure.points.cwiseProduct(Q.col(k));
    diagonal[k] = Q.col(k).dot(next);
    if (k + 1 == n) break;
    for (int twice = 0; twice < 2; ++twice) next -= Q.leftCols(k + 1) * (Q.leftCols(k + 1).transpose() * next);
    beside[k] = next.norm();
    Q.col(k + 1) = next / beside[k];
  }
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> nodes;
  nodes.computeFromTridiagonal(diagonal, beside);
  GaussRule rule(n);
  rule.points = nodes.eigenvalues();
  rule.weights = total * nodes.eigenvectors().row(0).cwiseAbs2().transpose();
  if (shares) {  // the polynomial that is 1 at one of the rule's points, 0 at the others, over the weight there
    const Eigen::RowVectorXd one = nodes.eigenvectors().row(0);
    *shares = one.cwiseInverse().asDiagonal() * (Q * nodes.eigenvectors()).transpose() * Q.col(0).asDiagonal();
  }
  return rule;
}

Eigen::RowVectorXd integral_weights(const GaussRule& rule, double length, double x) {
  // The polynomial's Legendre coefficients are c_k = (2k + 1)/L sum_j w_j P_k(s_j) f_j, and the integral of P_k from
  // the left end is L/2 (P_{k+1} - P_{k-1})/(2k + 1), with P_{-1} = -1.
  const Eigen::Index n = rule.points.size();
  const auto legendre = [&](double s) {
    Eigen::VectorXd p = Eigen::VectorXd::Ones(n + 1);
    p[1] = s;
    for (Eigen::Index k = 2; k <= n; ++k) {
      const double d = static_cast<double>(k);
      p[k] = ((2.0 * d - 1.0) * s * p[k - 1] - (d - 1.0) * p[k - 2]) / d;
    }
    return p;
  };
  const Eigen::VectorXd end = legendre(2.0 * x / length - 1.0);
  Eigen::RowVectorXd weights(n);
  for (Eigen::Index j = 0; j < n; ++j) {
    const Eigen::VectorXd p = legendre(2.0 * rule.points[j] / length - 1.0);
    double sum = 0.0;
    for (Eigen::Index k = 0; k < n; ++k) sum += 0.5 * p[k] * (end[k + 1] - (k == 0 ? -1.0 : end[k - 1]));
    weights[j] = rule.weights[j] * sum;
  }
  return weights;
}

}  // namespace flexarm
