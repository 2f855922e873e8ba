// The joint (Sec. 4.1): its motion, its Jacobian, and its springs, dampers and stops.
#pragma once

#include <utility>

#include "flexarm/joint.hpp"
#include "oracle/sections.hpp"

namespace oracle {

/// Motion of a link's frame against the frame that its joint sits on.
struct JointMotion {
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();  ///< orientation of the link
  Eigen::Vector3d p = Eigen::Vector3d::Zero();      ///< place of its origin, in the axes the joint sits on
  Matrix6Xd H = Matrix6Xd::Zero(6, 0);              ///< V_rel = H v, in link axes (Eq. 66, 67)
  Vector6d V = Vector6d::Zero();                    ///< H v
  Vector6d c = Vector6d::Zero();                    ///< relative acceleration when dv/dt = 0, in link axes

  JointMotion(const flexarm::Joint& joint, const double* q, const double* v);

 private:
  void turn(const Eigen::Matrix3d& by);
  void shift(const Eigen::Vector3d& d);
  void free(bool rotation, const Eigen::Vector3d& axis, double rate);
};

/// Generalised force that opposes coordinate i of a joint; its slopes by coordinate and rate as an implicit step takes
/// them; the energy of springs and stops.
double resistance(const flexarm::Joint& joint, int i, const double* q, const double* v);
std::pair<double, double> resistance_slopes(const flexarm::Joint& joint, int i, const double* q, const double* v);
double potential(const flexarm::Joint& joint, const double* q);

}  // namespace oracle
