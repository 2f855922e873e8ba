// Contacts of an arm with surfaces: a compliant normal force (Hunt & Crossley 1975) and dry friction that sticks.
#pragma once

#include <Eigen/Core>

#include "flexarm/strut.hpp"

namespace flexarm {

/// Fixed to a link or to the world. The arm is outside: in front of a plane, around a sphere, around a box.
struct Surface {
  enum Kind { plane, sphere, box };
  Kind kind = plane;
  Strut::Point at;                                     ///< a point of the plane, the centre of a sphere or box
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  ///< columns, in those of `at`; the third is a plane's normal
  Eigen::Vector3d size = Eigen::Vector3d::Zero();      ///< of a sphere its radius, first; of a box its edges (m)
};

/// A sphere on the arm against a surface. In depth d it is pushed back by f = stiffness d^exponent (1 + damping dd/dt),
/// which never pulls. Friction is a spring along the surface, of tangential_stiffness since they touched, whose force
/// is at most coulomb f: there it slides. Beside that spring acts a damper of damping f; coulomb f limits their sum.
struct Contact {
  Strut::Point point;   ///< the sphere's centre, on a link
  double radius = 0.0;  ///< m; 0: a point
  Surface against;
  double stiffness = 0.0;             ///< N/m^exponent
  double exponent = 1.0;              ///< 1, or 1.5 (Hertz)
  double damping = 0.0;               ///< s/m
  double coulomb = 0.0;               ///< coefficient of friction
  double tangential_stiffness = 0.0;  ///< N/m
};

}  // namespace flexarm
