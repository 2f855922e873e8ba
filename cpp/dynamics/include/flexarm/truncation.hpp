// How well an exact beam's Gauss points resolve its bending.
#pragma once

#include "flexarm/beam.hpp"

namespace flexarm {

/// At order "exact", by how much too few Gauss points put the sections wrong at elastic coordinates q (rows): parts of
/// the length and radians, the larger. Against twice as many points. Zero at other orders.
Eigen::VectorXd truncation(const Beam& beam, const Eigen::MatrixXd& q);

}  // namespace flexarm
