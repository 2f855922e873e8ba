// The beam beyond order 2: its rotation and position as functions of X, by spectral integration over the Gauss points.
//
// Order 3 takes the paper's series term by term, R_i = int R_{i-1} K~ (Eq. 27), and the Magnus series for the rotation
// vector. "Exact" does not truncate: R' = R K~ is solved, as a unit quaternion, to what polynomials through the Gauss
// points resolve (Beam::truncation). Order 2 and below never come here.
#pragma once

#include <array>
#include <vector>

#include "flexarm/shape.hpp"
#include "flexarm/slice.hpp"

namespace flexarm {

/// A scalar function of X at the Gauss points (rows), with what an elastic motion does to it. Columns: value, rate,
/// convective part of the second rate, then the derivatives by the elastic coordinates.
template <class S>
using Jet = MatX<S>;
template <class S>
using JetVector = std::array<Jet<S>, 3>;
enum JetColumn { value_column, rate_column, bias_column, first_derivative_column };

/// Strains and integration at the Gauss points of one beam, built once.
struct SeriesTables {
  int order;                          ///< 3 or kExact
  int points;                         ///< the beam may have more slices: those of its patches
  Plane plane;                        ///< if any, then only `slope` and `shear` are kept of what follows
  Eigen::MatrixXd cumulative;         ///< row i: weights of the integral from 0 to X_i
  std::vector<StrainMatrix> strains;  ///< at X_i, per coordinate
  Eigen::MatrixXd slope, shear;       ///< row i: v' and phi at X_i per coordinate

  /// From the slices at the Gauss points.
  SeriesTables(int order, Plane plane, const std::vector<SliceTable>& at);
};

/// The slopes of what a slice needs, at the Gauss points; integrated from 0 to X they give the slice at X.
template <class S>
struct Series {
  JetVector<S> x;     ///< x'
  JetVector<S> turn;  ///< theta' at order 3; Omega' when exact (its value column is not used)
  // Exact only: R, the slope of its quaternion, and position and Omega themselves, for slices at the points.
  std::vector<Mat3<S>> R;
  MatX<S> spin;
  JetVector<S> place, turned;
  JetVector<S> K, phi;  ///< strains (phi has no first component)
  std::array<JetVector<S>, 5> scratch;
  /// Of a planar beam alone: columns of x', then those of y' (or z'). By rows, which a slice sums with its weights.
  Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> plane;

  Series() = default;
  Series(const SeriesTables& tables, int ne) {
    const int points = tables.points;
    if (tables.plane != Plane::none) {
      plane.setZero(points, 2 * (first_derivative_column + ne));
      return;
    }
    R.assign(static_cast<std::size_t>(points), Mat3<S>::Identity());
    spin = MatX<S>::Zero(points, 4);
    const auto zero = [&](JetVector<S>& v) {
      for (auto& c : v) c = MatX<S>::Zero(points, first_derivative_column + ne);
    };
    for (JetVector<S>* v : {&x, &turn, &K, &phi, &place, &turned}) zero(*v);
    for (JetVector<S>& v : scratch) zero(v);
  }
};

/// Beam orders: 0, 1, 2, 3 and
constexpr int kExact = 4;

/// Fills a series from the elastic coordinates q and rates dq.
template <class S>
void fill_series(const SeriesTables& tables, const S* q, const S* dq, Series<S>& s);

/// Moves a slice of a planar beam beyond order 2.
template <class S>
void move_planar_slice(const SliceTable& table, const Eigen::Vector3d& origin, const Series<S>& s, const S* q,
                       const S* dq, bool orient, Slice<S>& out) {
  const Eigen::Index up = row_across(table.plane), about = row_of_turn(table.plane);
  const Eigen::Index ne = out.J.cols(), columns = first_derivative_column + ne, all = 2 * columns;
  S sum[2 * (first_derivative_column + kStrains * kMostModes)];
  for (Eigen::Index c = 0; c < all; ++c) sum[c] = S(0);
  for (Eigen::Index j = 0; j < table.weights.size(); ++j) {
    const double w = table.weights[j];
    const S* row = s.plane.data() + j * all;
    for (Eigen::Index c = 0; c < all; ++c) sum[c] += w * row[c];
  }
  const S *along = sum, *across = sum + columns;
  out.x = origin.template cast<S>();
  out.x[0] += along[value_column];
  out.x[up] += across[value_column];
  out.u_dot[0] = along[rate_column];
  out.u_dot[up] = across[rate_column];
  out.u_bias[0] = along[bias_column];
  out.u_bias[up] = across[bias_column];
  for (Eigen::Index k = 0; k < ne; ++k) {
    out.J(0, k) = along[first_derivative_column + k];
    out.J(up, k) = across[first_derivative_column + k];
  }
  if (!orient) return;
  S turn(0), rate(0);
  for (Eigen::Index k = 0; k < ne; ++k) {
    const double l = table.linear(about, k);
    out.J(about, k) = S(l);
    turn += l * q[k];
    rate += l * dq[k];
  }
  turn_planar_slice(table.plane, turn, rate, out);
}

/// R of a quaternion of any length.
template <class S>
Mat3<S> rotation_of(const S& w, const Vec3<S>& v) {
  const S scale = 2.0 / (w * w + v.dot(v));
  const Mat3<S> vt = tilde(v);
  Mat3<S> R = scale * (vt * vt) + (scale * w) * vt;
  R.diagonal().array() += S(1);
  return R;
}

/// Moves a slice beyond order 2.
template <class S>
void move_slice(const SliceTable& table, const Eigen::Vector3d& origin, int order, const Series<S>& s, Slice<S>& out) {
  const auto entry = [](const JetVector<S>& f, Eigen::Index j, Eigen::Index column) {
    return Vec3<S>(f[0](j, column), f[1](j, column), f[2](j, column));
  };
  if (table.point >= 0 && order == kExact) {
    const Eigen::Index j = table.point;
    out.x = origin.template cast<S>() + entry(s.place, j, value_column);
    out.u_dot = entry(s.place, j, rate_column);
    out.u_bias = entry(s.place, j, bias_column);
    for (Eigen::Index k = 0; k < out.J.cols(); ++k) {
      out.J.col(k).template head<3>() = entry(s.place, j, first_derivative_column + k);
      out.J.col(k).template tail<3>() = entry(s.turned, j, first_derivative_column + k);
    }
    out.Omega = entry(s.turned, j, rate_column);
    out.Omega_bias = entry(s.turned, j, bias_column);
    out.R = s.R[static_cast<std::size_t>(j)];
    return;
  }
  const auto integral = [&](const JetVector<S>& slope, Eigen::Index column) {
    Vec3<S> sum = Vec3<S>::Zero();
    for (Eigen::Index j = 0; j < table.weights.size(); ++j) sum += table.weights[j] * entry(slope, j, column);
    return sum;
  };
  out.x = origin.template cast<S>() + integral(s.x, value_column);
  out.u_dot = integral(s.x, rate_column);
  out.u_bias = integral(s.x, bias_column);
  for (Eigen::Index k = 0; k < out.J.cols(); ++k) {
    out.J.col(k).template head<3>() = integral(s.x, first_derivative_column + k);
    out.J.col(k).template tail<3>() = integral(s.turn, first_derivative_column + k);
  }
  if (order < kExact) {
    turn_slice<S>(integral(s.turn, value_column), integral(s.turn, rate_column), integral(s.turn, bias_column), out);
    return;
  }
  out.Omega = integral(s.turn, rate_column);
  out.Omega_bias = integral(s.turn, bias_column);
  S p[4] = {S(1), S(0), S(0), S(0)};
  for (Eigen::Index j = 0; j < table.weights.size(); ++j)
    for (Eigen::Index c = 0; c < 4; ++c) p[c] += table.weights[j] * s.spin(j, c);
  out.R = rotation_of(p[0], Vec3<S>(p[1], p[2], p[3]));
}

}  // namespace flexarm
