// Gauss-Legendre quadrature.
#pragma once

#include <Eigen/Core>

namespace flexarm {

/// Points and weights on [0, length]; exact for polynomials of degree 2n - 1.
struct GaussRule {
  Eigen::VectorXd points, weights;
  explicit GaussRule(int n, double length = 1.0);
};

}  // namespace flexarm
