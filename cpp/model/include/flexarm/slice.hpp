// The slice: a rigid cross section of a beam at a place X. Inertia, gravity, the tip body, sensors and the next joint
// all hang on slices. What moves them is in the kernel; here is what it needs to know of each.
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

/// What a slice at X needs, built once at set-up. At order 0 to 2: position x = x0 + L_x q + products (Eq. 24) and
/// rotation vector theta = L_theta q + products (Magnus series), both cut at the beam's order. Blocks that a beam lacks
/// are not stored.
struct SliceTable {
  double X = 0.0;
  Plane plane = Plane::none;
  Eigen::Matrix<double, 6, Eigen::Dynamic> linear;  ///< [L_x; L_theta]
  std::vector<Product> products;                    ///< second order; empty at order 0 and 1
  StrainMatrix strains;                             ///< per coordinate (Eq. 28-32)
  Eigen::RowVectorXd weights;  ///< beyond order 2: of the integral from 0 to X over the Gauss points
  int point = -1;              ///< of these, the one that the slice is at
};

}  // namespace flexarm
