// The slice: a rigid cross section of a beam at a place X. Inertia, gravity, the tip body, sensors and the next joint
// are attached to slices. The kernel moves them; here are its data of each.
#pragma once

#include <vector>

#include "flexarm/shape.hpp"
#include "flexarm/spatial.hpp"

namespace flexarm {

/// Beam orders: 0, 1, 2, 3 and
constexpr int kExact = 4;

/// One term q_i^T C q_j of a slice's motion (or q_i^T C q_i / 2, C symmetric, when the two blocks are the
/// same one).
struct Product {
  int row;   ///< 0-2: position, 3-5: rotation vector
  int i, j;  ///< first coordinate of each block
  Eigen::MatrixXd C;
};

/// A beam that bends and shears in one plane alone: the rotations of its sections add, about one axis.
enum class Plane { none, xy, xz };

/// A slice of a beam that is not strained, in the axes at X = 0.
struct SliceAtRest {
  Eigen::Vector3d x = Eigen::Vector3d::Zero();      ///< place
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();  ///< orientation
  Eigen::Vector4d p = Eigen::Vector4d::Unit(0);     ///< its quaternion w x y z, without jumps from 1 0 0 0 at X = 0
  Eigen::Vector3d K = Eigen::Vector3d::Zero();      ///< twist and curvatures K1, K2, K3 there (1/m),
  Eigen::Vector3d theta = Eigen::Vector3d::Zero();  ///< and their integrals from 0 (rad)
  Eigen::Matrix<double, 6, Eigen::Dynamic> J;       ///< [J_T; J_R] (Eq. 37, 39), where the beam is curved
};

/// The data of a slice at X, built once at set-up. At order 0 to 2: position x = x0 + L_x q + products (Eq. 24) and
/// rotation vector theta = L_theta q + products (Magnus series), both cut at the beam's order. Blocks that a beam lacks
/// are not stored.
struct SliceTable {
  double X = 0.0;
  Plane plane = Plane::none;
  Eigen::Matrix<double, 6, Eigen::Dynamic> linear;  ///< [L_x; L_theta]
  std::vector<Product> products;                    ///< second order; empty at order 0 and 1
  StrainMatrix strains;                             ///< per coordinate (Eq. 28-32)
  SliceAtRest rest;
  /// [J_T; J_R] at rest (Eq. 37, 39).
  const Eigen::Matrix<double, 6, Eigen::Dynamic>& at_rest() const { return rest.J.size() > 0 ? rest.J : linear; }
  Eigen::RowVectorXd weights;  ///< beyond order 2: of the integral from 0 to X over the Gauss points
  int point = -1;              ///< of these, the one that the slice is at
};

}  // namespace flexarm
