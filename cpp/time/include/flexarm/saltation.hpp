// Switches of dry friction in small changes.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <limits>

namespace flexarm {

/// A joint comes to rest, or is torn loose, at the time T when its gap becomes zero: its rate; or its holding force
/// less its stiction. T moves with the numbers of the run, dT = -dgap / (rate of the gap), and as the accelerations
/// leap there from a- to a+, the rates' changes leap by (a- - a+) dT (saltation: Aizerman & Gantmakher 1958; Galan,
/// Feehery & Barton 1999; Hiskens & Pai 2000).
struct Saltation {
  int of;             ///< the joint's rate
  double tears;       ///< 1 or -1: torn loose, to move this way; 0: it came to rest
  double gap_rate;    ///< infinite: T is given, as the forces leap there
  Eigen::VectorXd a;  ///< a-; then (a- - a+) / gap_rate

  static Saltation at_rest(int of, const Eigen::VectorXd& a) { return {of, 0.0, a[of], a}; }
  /// @param leapt  whether the forces may have leapt here, at a sample. (A leap of a function of time is seen.)
  /// @param force  (t, q, v) that holds the joint; its rate comes from differences along the motion, over steps of d
  template <class Force>
  static Saltation torn(int of, double stiction, bool leapt, double t, const Eigen::VectorXd& q,
                        const Eigen::VectorXd& v, const Eigen::VectorXd& a, double d, const Force& force) {
    constexpr double kAtOnce = 1e-6;  // parts of its stiction by which a holding force has leapt over it
    constexpr double kSmooth = 1e-3;  // parts of it by which a smooth force is off the cubic through those before it
    constexpr double weights[] = {-48.0, 36.0, -16.0, 3.0}, cubic[] = {4.0, -6.0, 4.0, -1.0};
    const double now = force(t, q, v);
    Saltation out{of, now > 0.0 ? -1.0 : 1.0, std::numeric_limits<double>::infinity(), a};
    if (leapt && std::abs(std::abs(now) - stiction) > kAtOnce * stiction) return out;
    double rate = 25.0 * now, ahead = 0.0;
    for (int s = 1; s <= 4; ++s) {
      const double before = force(t - s * d, q - s * d * v, v - s * d * a);
      rate += weights[s - 1] * before;
      ahead += cubic[s - 1] * before;
    }
    if (std::abs(now - ahead) <= kSmooth * stiction) out.gap_rate = rate / (12.0 * d);
    return out;
  }
  void end(const Eigen::VectorXd& a_behind) { a = (a - a_behind) / gap_rate; }

  /// Lets the rates' changes leap (nv, np). @param gap  the gap's (np)
  void leap(const Eigen::RowVectorXd& gap, Eigen::MatrixXd& v) const { v -= a * gap; }
  /// Of a number's derivatives by the rates behind, that by the gap.
  double back(const Eigen::VectorXd& v) const { return -a.dot(v); }
};

}  // namespace flexarm
