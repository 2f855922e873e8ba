// Resolution of an exact beam's bending by its Gauss points.
#pragma once

#include "flexarm/beam.hpp"

namespace flexarm {

/// At order "exact", the error of sections by too few Gauss points at elastic coordinates q (rows): in parts of the
/// length or radians, the larger, from a comparison with twice as many points. Zero at other orders.
Eigen::VectorXd truncation(const Beam& beam, const Eigen::MatrixXd& q);

}  // namespace flexarm
