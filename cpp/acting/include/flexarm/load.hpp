// Loads: forces and moments on slices, and along a stretch of a beam (the external force term of Eq. 52, 53).
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "flexarm/arm.hpp"

namespace flexarm {

/// A force and moment [f; m] at time t, of the place p and the axes R (columns) of a slice in the world and of its
/// velocity [v; w] there.
using StateForce = std::function<Vec6<double>(double t, const Eigen::Vector3d& p, const Eigen::Matrix3d& R,
                                              const Vec6<double>& velocity)>;

/// Where a force and moment [f; m] (N, N m) act, and in whose axes they are given.
struct Load {
  struct Point {
    SliceTable slice;
    double weight;  ///< of the force and moment at this slice
  };
  std::size_t link;
  bool world_axes;            ///< or the axes of the slice, which turn with it
  std::vector<Point> points;  ///< empty: the link's end
  int strut = -1;             ///< or a strut, which pushes with the first of the six numbers besides its own force
  std::shared_ptr<const StateForce> by_state = nullptr;  ///< or they follow from the state of one slice or the link's
                                                         ///< end; then the first of the six numbers is the time

  /// At a link's end, where the next joint sits.
  static Load at_end(const Arm& arm, std::size_t link, bool world_axes);
  /// At the slice at x metres along a link's beam.
  static Load at_slice(const Arm& arm, std::size_t link, double x, bool world_axes);
  /// In a strut or tendon, which pushes its ends apart with the first of the six numbers (N).
  static Load on_strut(const Arm& arm, std::size_t strut);
  /// Along a beam from a to b metres: force and moment per length (N/m, N).
  static Load along(const Arm& arm, std::size_t link, double a, double b, bool world_axes);
};

/// A load and its value now, in a workspace.
struct AppliedLoad {
  Load load;
  Vec6<double> wrench = Vec6<double>::Zero();  ///< [f; m]
};

/// A load that changes with time, for the integrators.
struct LoadDrive {
  Load load;
  std::function<Vec6<double>(double)> wrench;
  Eigen::VectorXd breaks = {};  ///< times that no step may pass over
};

}  // namespace flexarm
