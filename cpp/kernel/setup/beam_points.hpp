// Points over which the lane kernels sum a beam's inertia.
#pragma once

#include "flexarm/beam.hpp"

namespace flexarm {
namespace lanes {

/// Products in the order of the blocks: those of position, those of rotation.
template <class Visit>
void for_products(const std::vector<Product>& products, bool position, const Visit& visit) {
  for (const Product& p : products)
    if ((p.row < 3) == position)
      for (Eigen::Index c = 0; c < p.C.cols(); ++c)  // the kernel's order
        for (Eigen::Index r = 0; r < p.C.rows(); ++r) visit(p.C(r, c));
}

/// Orthonormal functions that span the products of all slices' positions, times the root of the masses; columns. Made
/// at the first asking, and kept with the beam.
const Eigen::MatrixXd& basis_of(const Beam& beam);

}  // namespace lanes
}  // namespace flexarm
