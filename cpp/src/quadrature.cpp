#include "flexarm/quadrature.hpp"

#include <cmath>

namespace flexarm {

GaussRule::GaussRule(int n, double length) : points(n), weights(n) {
  for (int i = 0; i < n; ++i) {
    // Newton's iteration on P_n from Tricomi's estimate of the root
    double x = -std::cos(3.14159265358979323846 * (i + 0.75) / (n + 0.5)), slope = 1.0;
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

}  // namespace flexarm
