// Joints that close loops: between places of two links of a tree, or of one and the world.
#pragma once

#include <Eigen/Core>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "flexarm/strut.hpp"

namespace flexarm {

/// Its joint lets the frame on b move against that on a, as a joint of the tree lets a link against its parent, and
/// holds all other directions: rigidly, or by springs and dampers.
struct Loop {
  struct Side {
    Strut::Point at;  ///< of the place; its offset is the origin of the joint's frame
    Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  ///< of that frame, columns, in the place's axes
  };
  /// The third axis is that of a revolute, prismatic or cylindrical joint, and the normal of a planar one; a universal
  /// joint turns about the first on a and the second on b.
  enum Kind { fixed, revolute, prismatic, cylindrical, universal, planar, spherical };
  /// An equation: axis i on a sees no displacement; or, of turns, is square to axis j on b. It is so where an axis
  /// points the other way, too: a motion begins, and stays, where they point the same way.
  struct Row {
    bool turns;
    int i, j;
  };

  Side a, b;
  Kind kind = revolute;
  double stiffness = std::numeric_limits<double>::infinity();  ///< of the directions it holds (N/m); infinite: rigid
  double damping = 0.0;                                        ///< N s/m
  double angular_stiffness = std::numeric_limits<double>::infinity();  ///< N m/rad
  double angular_damping = 0.0;                                        ///< N m s/rad

  /// Displacements first.
  std::vector<Row> rows() const;
  /// Of the direction that a row holds (N/m, or N m/rad); infinite: rigid.
  double stiffness_of(const Row& row) const { return row.turns ? angular_stiffness : stiffness; }
  static const char* name(Kind kind);
  /// The kind of this name, or none.
  static std::optional<Kind> named(const std::string& name);
};

}  // namespace flexarm
