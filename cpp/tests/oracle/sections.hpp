// The motion of a beam's cross sections (Eq. 20-40), at every order, in formulas rather than in haste.
#pragma once

#include <vector>

#include "flexarm/beam.hpp"
#include "oracle/jet.hpp"

namespace oracle {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6Xd = Eigen::Matrix<double, 6, Eigen::Dynamic>;

/// a~ b = a x b (Eq. 2).
template <class V>
Eigen::Matrix<typename V::Scalar, 3, 3> cross_matrix(const V& a) {
  using S = typename V::Scalar;
  Eigen::Matrix<S, 3, 3> m;
  m << S(0.0), -a[2], a[1], a[2], S(0.0), -a[0], -a[1], a[0], S(0.0);
  return m;
}

/// A cross section in motion against the axes of the beam's base.
struct Section {
  Eigen::Vector3d x = Eigen::Vector3d::Zero();           ///< position
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();       ///< orientation
  Matrix6Xd J;                                           ///< [J_T; J_R]: velocities per elastic rate (Eq. 37, 39)
  Eigen::Vector3d u_dot = Eigen::Vector3d::Zero();       ///< J_T dq
  Eigen::Vector3d Omega = Eigen::Vector3d::Zero();       ///< J_R dq
  Eigen::Vector3d u_bias = Eigen::Vector3d::Zero();      ///< (dJ_T/dt) dq (Eq. 38)
  Eigen::Vector3d Omega_bias = Eigen::Vector3d::Zero();  ///< (dJ_R/dt) dq (Eq. 40)

  explicit Section(Eigen::Index ne = 0) : J(Matrix6Xd::Zero(6, ne)) {}
  /// The point at `offset` in this section's axes, which moves with it.
  Section at(const Eigen::Vector3d& offset) const;
  /// The same seen from axes in which the base is at `origin`.
  Section from(const Eigen::Vector3d& origin) const;
};

/// All sections of one beam, at elastic coordinates q and rates dq.
class Sections {
 public:
  explicit Sections(const flexarm::Beam& beam);
  void move(const Eigen::VectorXd& q, const Eigen::VectorXd& dq);
  Section at(const flexarm::SliceTable& table) const;

 private:
  Jet linear(const Eigen::RowVectorXd& row) const;
  Jet3 integral(const Eigen::RowVectorXd& weights, const std::vector<Jet3>& f) const;
  void move_planar();
  void move_order_3();
  void move_exact();
  Section quadratic(const flexarm::SliceTable& table) const;
  Section planar(const flexarm::SliceTable& table) const;

  const flexarm::Beam* beam_;
  Eigen::VectorXd q_, dq_;
  // beyond order 2: at the points of the beam's Gauss rule
  std::vector<flexarm::SliceTable> points_;
  std::vector<Jet3> x_slope_, turn_slope_;  ///< x'; theta' at order 3, and Omega' where exact (without its value)
  std::vector<Eigen::Vector4d> spin_;       ///< exact: slope of R's quaternion (w x y z)
};

}  // namespace oracle
