// Struts and tendons: massless lines that run straight from point to point of an arm and of the world, with a force
// along them. Cylinders, springs between two points, ropes.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace flexarm {

struct Strut {
  struct Point {
    enum On { origin, end, slice };
    int link = -1;   ///< -1: the world
    On on = end;     ///< the link's own frame, its end, where the next joint sits, or a slice of its beam
    double x = 0.0;  ///< of that slice (m)
    Eigen::Vector3d offset = Eigen::Vector3d::Zero();  ///< in the axes of that frame or slice; the world's (m)
  };
  std::vector<Point> points;  ///< two or more; it slides through the inner ones without friction
  double stiffness = 0.0;     ///< N/m
  double damping = 0.0;       ///< N s/m
  double length = 0.0;        ///< at which its spring has no force (m)
  double force = 0.0;         ///< with which it pushes its ends apart, beside spring and damper (N)
  bool tension_only =
      false;  ///< a rope: where it is shorter than `length`, spring and damper have no force; it never pushes
};

}  // namespace flexarm
