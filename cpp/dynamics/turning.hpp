// Turns of a ball by rotation vectors u, in the axes that turn, and their small changes (Bruels & Cardona 2010): exp(u
// + du) is exp(u), then a turn by T(u) du.
#pragma once

#include <Eigen/Core>
#include <cmath>

#include "flexarm/spatial.hpp"

namespace flexarm {

/// Factors of a turn by u: with c(n) = the sum of (-|u|^2)^k / (2 k + n)!, sin |u| / |u| is c(1), (1 - cos |u|) / |u|^2
/// is c(2).
inline double turn_factor(double square, int n) {
  constexpr double kSmall = 0.25;
  if (square > kSmall) {
    const double angle = std::sqrt(square);
    const double one = n % 2 ? std::sin(angle) / angle : (1.0 - std::cos(angle)) / square;
    return n < 3 ? one : (1.0 - one) / square;
  }
  double term = n == 1 ? 1.0 : n == 2 ? 0.5 : 1.0 / 6.0, sum = 0.0;
  for (int k = 0; k < 9; ++k) {
    sum += term;
    term *= -square / ((2.0 * k + n + 1.0) * (2.0 * k + n + 2.0));
  }
  return sum;
}
/// The rotation that undoes exp(u).
inline Eigen::Matrix3d turned_back(const Eigen::Vector3d& u) {
  const double square = u.squaredNorm();
  const Eigen::Matrix3d x = tilde(u);
  return Eigen::Matrix3d::Identity() - turn_factor(square, 1) * x + turn_factor(square, 2) * x * x;
}
/// T(u).
inline Eigen::Matrix3d turn_slopes(const Eigen::Vector3d& u) {
  const double square = u.squaredNorm();
  const Eigen::Matrix3d x = tilde(u);
  return Eigen::Matrix3d::Identity() - turn_factor(square, 2) * x + turn_factor(square, 3) * x * x;
}

/// Factor k of `turn_rate`, and its slope by |u|^2; |u| below 2 pi.
inline double turn_rate_factor(double square, double* slope = nullptr) {
  constexpr double kSmall = 2e-3;
  const double half = 0.5 * std::sqrt(square);
  if (square < kSmall) {
    if (slope) *slope = (1.0 + square * (1.0 + square * 0.0375) / 21.0) / 720.0;
    return (1.0 + square * (1.0 + square / 42.0) / 60.0) / 12.0;
  }
  const double k = (1.0 - half / std::tan(half)) / square, sine = std::sin(half);
  if (slope) *slope = (half / (sine * sine) - 1.0 / std::tan(half)) / (8.0 * half * square) - k / square;
  return k;
}
/// Rate of the rotation vector u by which a ball is turned, at an angular velocity w in the axes that turn.
inline Eigen::Vector3d turn_rate(const Eigen::Vector3d& u, const Eigen::Vector3d& w) {
  const Eigen::Vector3d uw = u.cross(w);
  return w + 0.5 * uw + turn_rate_factor(u.squaredNorm()) * u.cross(uw);
}
/// Its slopes by u and w.
inline void turn_rate_slopes(const Eigen::Vector3d& u, const Eigen::Vector3d& w, Eigen::Matrix3d& by_u,
                             Eigen::Matrix3d& by_w) {
  double slope = 0.0;
  const double k = turn_rate_factor(u.squaredNorm(), &slope);
  const Eigen::Vector3d uw = u.cross(w);
  const Eigen::Matrix3d x = tilde(u);
  by_w = Eigen::Matrix3d::Identity() + 0.5 * x + k * x * x;
  by_u = -0.5 * tilde(w) - k * (x * tilde(w) + tilde(uw)) + 2.0 * slope * u.cross(uw) * u.transpose();
}

/// Of a step of h by collocation, the turns u from its middle at its points, by angular velocities w there (a column
/// each), and their rates du: u_i = h sum_j weights_ij du_j, by fixed-point iteration, which contracts by a part of the
/// turn. @return whether it converges
template <class U, class W>
bool turn_at_points(double h, const Eigen::MatrixXd& weights, const W& w, U&& u, U&& du) {
  constexpr int kTurns = 60;         // most passes
  constexpr double kTurned = 2e-15;  // rad: they have converged
  double moved = 1.0;
  for (int pass = 0; pass < kTurns && moved > kTurned; ++pass) {
    for (Eigen::Index i = 0; i < u.cols(); ++i) du.col(i) = turn_rate(u.col(i), w.col(i));
    moved = 0.0;
    for (Eigen::Index i = 0; i < u.cols(); ++i) {
      const Eigen::Vector3d now = h * (du * weights.row(i).transpose());
      const double change = (now - u.col(i)).norm() / (1.0 + now.norm());
      if (!(change <= moved)) moved = change;  // NaN as well
      u.col(i) = now;
    }
  }
  return moved <= kTurned;
}

}  // namespace flexarm
