// Gauss-Legendre quadrature.
#pragma once

#include <Eigen/Core>

namespace flexarm {

/// Points and weights on [0, length]; exact for polynomials of degree 2n - 1.
struct GaussRule {
  Eigen::VectorXd points, weights;
  explicit GaussRule(int n, double length = 1.0);
};

/// Weights of the integral from 0 to x of the polynomial through values at the points of a Gauss rule on [0, length].
Eigen::RowVectorXd integral_weights(const GaussRule& rule, double length, double x);

}  // namespace flexarm
