// Gauss-Legendre quadrature.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace flexarm {

/// Points and weights on [0, length]; exact for polynomials of degree 2n - 1.
struct GaussRule {
  Eigen::VectorXd points, weights;
  explicit GaussRule(int n, double length = 1.0);
  /// n points on each stretch between the breaks.
  GaussRule(int n, double length, const std::vector<double>& breaks);
};

/// The n-point Gauss rule of a measure given by many points and positive weights: it integrates polynomials of degree
/// 2n - 1 as they do (Golub & Welsch 1969, from a Lanczos process).
/// `shares` maps a function's values at the measure's points to values at the rule's points with the same integrals of
/// the function times polynomials of degree n - 1, also for functions with kinks.
GaussRule gauss_rule_of(const GaussRule& measure, int n, Eigen::MatrixXd* shares = nullptr);

/// Weights of the integral from 0 to x of the polynomial through values at the points of a Gauss rule on [0, length].
Eigen::RowVectorXd integral_weights(const GaussRule& rule, double length, double x);

}  // namespace flexarm
