#include "oracle/sections.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "flexarm/quadrature.hpp"

namespace oracle {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::RowVectorXd;
using Eigen::Vector3d;
using Eigen::Vector4d;
using Eigen::VectorXd;
using flexarm::kStrainFields;
using flexarm::SliceTable;
using flexarm::StrainField;

Section Section::at(const Vector3d& offset) const {
  const Vector3d r = R * offset;
  Section out = *this;
  out.x += r;
  out.u_dot += Omega.cross(r);
  out.u_bias += Omega_bias.cross(r) + Omega.cross(Omega.cross(r));
  for (Index k = 0; k < J.cols(); ++k) out.J.col(k).head<3>() += J.col(k).tail<3>().cross(r);
  return out;
}

Section Section::from(const Vector3d& origin) const {
  Section out = *this;
  out.x += origin;
  return out;
}

namespace {

/// Orientation from the rotation vector: R = exp(t~), Omega = J_l(t) dt/dt with J_l = 1 + b t~ + c t~^2 (Eq. 35), and
/// its rate.
void turn(const Jet3& t, Section& out) {
  const Vector3d v = values(t), v_dot = rates(t);
  const double s = v.squaredNorm(), angle = std::sqrt(s);
  double b, c, db, dc;  // (1 - cos)/s, (1 - sin/angle)/s, and their slopes by s
  if (s < 1.0) {
    b = c = db = dc = 0.0;
    double term = 0.5;  // (-s)^k / (2k + 2)!
    for (int k = 0; k < 12; ++k) {
      b += term;
      c += term / (2 * k + 3);
      const double next = -term / ((2 * k + 3.0) * (2 * k + 4.0));
      db += (k + 1) * next;
      dc += (k + 1) * next / (2 * k + 5);
      term = next * s;
    }
  } else {
    b = (1.0 - std::cos(angle)) / s;
    c = (1.0 - std::sin(angle) / angle) / s;
    db = (std::sin(angle) / angle - 2.0 * b) / (2.0 * s);
    dc = (b - 3.0 * c) / (2.0 * s);
  }
  const Matrix3d tt = cross_matrix(v), left = Matrix3d::Identity() + b * tt + c * tt * tt;
  out.R = left * tt + Matrix3d::Identity();  // exp(t~) = 1 + J_l t~
  out.Omega = left * v_dot;
  const Matrix3d td = cross_matrix(v_dot);
  const double s_dot = 2.0 * v.dot(v_dot);
  out.Omega_bias = left * biases(t) + (db * s_dot * tt + dc * s_dot * tt * tt + c * (td * tt + tt * td)) * v_dot;
  for (Index k = 0; k < out.J.cols(); ++k) out.J.col(k).tail<3>() = left * slopes(t, k);
}

void place(const Jet3& x, Section& out) {
  out.x = values(x);
  out.u_dot = rates(x);
  out.u_bias = biases(x);
  for (Index k = 0; k < out.J.cols(); ++k) out.J.col(k).head<3>() = slopes(x, k);
}

Matrix3d rotation_of(const Vector4d& p) {  // of a quaternion w x y z of any length
  const Matrix3d e = cross_matrix(Vector3d(p.tail<3>()));
  return Matrix3d::Identity() + 2.0 / p.squaredNorm() * (e * e + p[0] * e);
}

const StrainField& bending_in(flexarm::Plane plane) {
  return kStrainFields[plane == flexarm::Plane::xy ? flexarm::bending_y : flexarm::bending_z];
}
const StrainField& shear_in(flexarm::Plane plane) {
  return kStrainFields[plane == flexarm::Plane::xy ? flexarm::shear_y : flexarm::shear_z];
}

}  // namespace

Sections::Sections(const flexarm::Beam& beam)
    : beam_(&beam), q_(VectorXd::Zero(beam.ne())), dq_(VectorXd::Zero(beam.ne())) {
  if (beam.order() <= 2 || beam.ne() == 0) return;
  const flexarm::GaussRule rule(static_cast<int>(beam.tip().weights.size()), beam.length());
  for (double X : rule.points) points_.push_back(beam.slice_at(X));
  x_slope_.resize(points_.size());
  turn_slope_.resize(points_.size());
  spin_.resize(points_.size());
}

Jet Sections::linear(const RowVectorXd& row) const { return {row.dot(q_), row.dot(dq_), 0.0, row.transpose()}; }

Jet3 Sections::integral(const RowVectorXd& weights, const std::vector<Jet3>& f) const {
  Jet3 sum = Jet3::Zero();
  for (std::size_t j = 0; j < f.size(); ++j) sum += Jet(weights[static_cast<Index>(j)]) * f[j];
  return sum;
}

void Sections::move(const VectorXd& q, const VectorXd& dq) {
  q_ = q;
  dq_ = dq;
  if (points_.empty()) return;
  if (points_[0].plane != flexarm::Plane::none)
    move_planar();
  else if (beam_->order() == 3)
    move_order_3();
  else
    move_exact();
}

Section Sections::at(const SliceTable& table) const {
  if (points_.empty()) return quadratic(table);
  if (table.plane != flexarm::Plane::none) return planar(table);
  Section out(beam_->ne());
  place(integral(table.weights, x_slope_), out);
  const Jet3 turned = integral(table.weights, turn_slope_);
  if (beam_->order() == 3) {
    turn(turned, out);
    return out;
  }
  out.Omega = rates(turned);
  out.Omega_bias = biases(turned);
  for (Index k = 0; k < out.J.cols(); ++k) out.J.col(k).tail<3>() = slopes(turned, k);
  Vector4d p = Vector4d::Unit(0);
  for (std::size_t j = 0; j < spin_.size(); ++j) p += table.weights[static_cast<Index>(j)] * spin_[j];
  out.R = rotation_of(p);
  return out;
}

/// Orders 0 to 2: position (Eq. 24) and rotation vector are quadratic in the coordinates.
Section Sections::quadratic(const SliceTable& table) const {
  if (q_.size() == 0) {
    Section still(0);
    still.x = table.rest.x;
    still.R = table.rest.R;
    return still;
  }
  Jet row[6];
  for (int r = 0; r < 6; ++r) row[r] = linear(table.linear.row(r));
  row[0] += table.X;
  for (const flexarm::Product& p : table.products) {
    const Index ni = p.C.rows(), nj = p.C.cols();
    const double w = p.i == p.j ? 0.5 : 1.0;
    const VectorXd qi = q_.segment(p.i, ni), qj = q_.segment(p.j, nj), di = dq_.segment(p.i, ni),
                   dj = dq_.segment(p.j, nj);
    Jet product(w * qi.dot(p.C * qj), w * (di.dot(p.C * qj) + qi.dot(p.C * dj)), 2.0 * w * di.dot(p.C * dj),
                VectorXd::Zero(q_.size()));
    product.slopes.segment(p.i, ni) += w * p.C * qj;
    product.slopes.segment(p.j, nj) += w * p.C.transpose() * qi;
    row[p.row] += product;
  }
  Section out(q_.size());
  place(Jet3(row[0], row[1], row[2]), out);
  turn(Jet3(row[3], row[4], row[5]), out);
  return out;
}

/// In a plane the turns of sections add, whatever the order: b about one axis. x' = [1 + e, p] turned by b (Eq. 22), to
/// third order in all at order 3.
void Sections::move_planar() {
  for (std::size_t j = 0; j < points_.size(); ++j) {
    const SliceTable& at = points_[j];
    const StrainField& bending = bending_in(at.plane);
    const Jet b = bending.sign * (linear(at.linear.row(3 + bending.rotation)) + Jet(at.rest.theta[bending.rotation])),
              p = linear(at.strains.row(shear_in(at.plane).strain)),
              e = linear(at.strains.row(flexarm::StrainRow::eps));
    const bool exact = beam_->order() == flexarm::kExact;
    const Jet bb = 0.5 * (b * b), c = exact ? cos(b) : 1.0 - bb;
    const Jet s = exact ? sin(b) : b * (1.0 - (1.0 / 3.0) * bb), s1 = exact ? s : b;  // s1: to second order
    Jet3& x = x_slope_[j];
    x = Jet3::Zero();
    x[0] = c + e * c - p * s1;
    x[bending.position] = s + e * s1 + p * c;
  }
}
Section Sections::planar(const SliceTable& table) const {
  Section out(q_.size());
  place(integral(table.weights, x_slope_), out);
  const StrainField& bending = bending_in(table.plane);
  Jet3 t = Jet3::Zero();
  t[bending.rotation] = linear(table.linear.row(3 + bending.rotation)) + Jet(table.rest.theta[bending.rotation]);
  turn(t, out);
  return out;
}

/// R = 1 + R_1 + R_2 + R_3 with R_i = int R_{i-1} K~ (Eq. 25-27), its products with the shear angles and the stretch to
/// the same order, and the Magnus series of the rotation vector.
void Sections::move_order_3() {
  const std::size_t n = points_.size();
  std::vector<Jet3> K(n), phi(n);
  for (std::size_t j = 0; j < n; ++j) {
    K[j] = phi[j] = Jet3::Zero();
    for (const StrainField& f : kStrainFields)
      (f.is_curvature() ? K[j][f.rotation] : phi[j][f.position]) = linear(points_[j].strains.row(f.strain));
  }
  const auto integrated = [&](const std::vector<Jet3>& f) {
    std::vector<Jet3> out;
    for (const SliceTable& at : points_) out.push_back(integral(at.weights, f));
    return out;
  };
  std::vector<Jet3> row[3];  // of x' by axis, summed over i
  for (int m = 0; m < 3; ++m) {
    Jet3 unit = Jet3::Zero();
    unit[m] = 1.0;
    std::vector<Jet3> r(n, unit);  // a row of R_i: r' = r_{i-1} x K
    for (std::size_t j = 0; j < n; ++j) x_slope_[j][m] = 0.0;
    for (int i = 0; i <= 3; ++i) {
      for (std::size_t j = 0; j < n; ++j) {
        x_slope_[j][m] += r[j][0];
        if (i < 3) x_slope_[j][m] += r[j][0] * phi[j][0] + r[j][1] * phi[j][1] + r[j][2] * phi[j][2];
      }
      for (std::size_t j = 0; j < n; ++j) r[j] = -cross_matrix(K[j]) * r[j];
      r = integrated(r);
    }
  }
  // theta' = K + theta_1 x K / 2 + theta_2 x K / 2 + theta_1 x (theta_1 x K) / 12
  const std::vector<Jet3> theta_1 = integrated(K);
  std::vector<Jet3> twist(n), half(n);
  for (std::size_t j = 0; j < n; ++j) {
    twist[j] = cross_matrix(theta_1[j]) * K[j];
    half[j] = Jet(0.5) * twist[j];
  }
  const std::vector<Jet3> theta_2 = integrated(half);
  for (std::size_t j = 0; j < n; ++j)
    turn_slope_[j] = K[j] + half[j] + Jet(0.5) * (cross_matrix(theta_2[j]) * K[j]) +
                     Jet(1.0 / 12.0) * (cross_matrix(theta_1[j]) * twist[j]);
}

/// R' = R K~, as a unit quaternion: p' = p (0, K) / 2. Then Omega' = R dK/dt, J_R' = R dK/dq,
/// and x' = R (e_x + phi).
void Sections::move_exact() {
  const std::size_t n = points_.size();
  const Index ne = q_.size();
  std::vector<Vector3d> K(n), K_dot(n), phi(n), phi_dot(n);
  std::vector<Eigen::Matrix3Xd> dK(n, Eigen::Matrix3Xd::Zero(3, ne)), dphi = dK;
  for (std::size_t j = 0; j < n; ++j) {
    for (const StrainField& f : kStrainFields)
      (f.is_curvature() ? dK[j].row(f.rotation) : dphi[j].row(f.position)) = points_[j].strains.row(f.strain);
    K[j] = points_[j].rest.K + dK[j] * q_;
    K_dot[j] = dK[j] * dq_;
    phi[j] = Vector3d::UnitX() + dphi[j] * q_;
    phi_dot[j] = dphi[j] * dq_;
  }
  const auto integrated = [&](const auto& f) {
    auto out = f;
    for (std::size_t i = 0; i < n; ++i) {
      out[i] = points_[i].weights[0] * f[0];
      for (std::size_t j = 1; j < n; ++j) out[i] += points_[i].weights[static_cast<Index>(j)] * f[j];
    }
    return out;
  };
  // p_i = (1, 0, 0, 0) + sum_j w_ij Q_j p_j, with Q p = p (0, K) / 2
  std::vector<Eigen::Matrix4d> Q(n);
  for (std::size_t j = 0; j < n; ++j) {
    Q[j] << 0.0, -K[j].transpose(), K[j], -cross_matrix(K[j]);
    Q[j] *= 0.5;
  }
  const Index size = 4 * static_cast<Index>(n);
  Eigen::MatrixXd system = Eigen::MatrixXd::Identity(size, size);
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < n; ++j)
      system.block<4, 4>(4 * static_cast<Index>(i), 4 * static_cast<Index>(j)) -=
          points_[i].weights[static_cast<Index>(j)] * Q[j];
  const VectorXd solved = system.partialPivLu().solve(Vector4d(Vector4d::Unit(0)).replicate(static_cast<Index>(n), 1));
  std::vector<Vector4d> p(n);
  for (std::size_t j = 0; j < n; ++j) {
    p[j] = solved.segment<4>(4 * static_cast<Index>(j));
    spin_[j] = Q[j] * p[j];
  }
  std::vector<Matrix3d> R(n);
  std::vector<Vector3d> Omega_slope(n), bias_slope(n);
  std::vector<Eigen::Matrix3Xd> JR_slope(n);
  for (std::size_t j = 0; j < n; ++j) {
    R[j] = rotation_of(p[j]);
    Omega_slope[j] = R[j] * K_dot[j];
    JR_slope[j] = R[j] * dK[j];
  }
  const std::vector<Vector3d> Omega = integrated(Omega_slope);
  const std::vector<Eigen::Matrix3Xd> JR = integrated(JR_slope);
  for (std::size_t j = 0; j < n; ++j) bias_slope[j] = Omega[j].cross(Omega_slope[j]);  // (dR/dt) dK/dt
  const std::vector<Vector3d> Omega_bias = integrated(bias_slope);
  for (std::size_t j = 0; j < n; ++j) {
    const Vector3d t = R[j] * phi[j], strained = R[j] * phi_dot[j], swing = Omega[j].cross(t);
    const Vector3d bias = Omega_bias[j].cross(t) + Omega[j].cross(swing + 2.0 * strained);
    const Eigen::Matrix3Xd JT_slope = R[j] * dphi[j] - cross_matrix(t) * JR[j];
    for (int m = 0; m < 3; ++m) {
      x_slope_[j][m] = {t[m], swing[m] + strained[m], bias[m], JT_slope.row(m).transpose()};
      turn_slope_[j][m] = {0.0, Omega_slope[j][m], bias_slope[j][m], JR_slope[j].row(m).transpose()};
    }
  }
}

}  // namespace oracle
