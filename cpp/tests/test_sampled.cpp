// The fast kernels at order 3 and "exact".
#include "flexarm/batch.hpp"
#include "kernels.hpp"

using flexarm::kExact;
using flexarm_test::check;
using flexarm_test::flat;

namespace {

TEST_CASE("planar arms of order 3 and exact") {
  for (int order : {3, kExact})
    for (double damping : {0.0, 0.02}) {
      CAPTURE(order);
      check(flat({0, 0, 1}, {3, 0, 0, 0, 0}, order, damping), true);
      check(flat({0, 1, 0}, {0, 2, 0, 0, 1}, order, damping), true);
      check(flat({0, 0, 1}, {2, 0, 0, 2, 0}, order, damping), true);
    }
  std::vector<bool> first(9, false);
  first[0] = true;
  check(flat({0, 0, 1}, {3, 0, 0, 0, 0}, kExact), true, first);
}

TEST_CASE("arms in space of order 3 and exact") {
  for (int order : {3, kExact}) {
    CAPTURE(order);
    check(flexarm_test::spatial_arm(order), false);
    check(flat({0, 0, 1}, {3, 3, 1, 0, 0}, order, 0.01), false);
    check(flat({0, 1, 0}, {2, 0, 0, 0, 0}, order), false);  // bends out of the plane of its joints
    check(flat({0, 0, 1}, {0, 0, 2, 0, 0}, order), false);
    check(flat({0, 0, 1}, {0, 0, 0, 1, 1}, order), false);
    std::vector<bool> second(15, false);
    second[7] = true;
    check(flat({0, 0, 1}, {2, 1, 1, 1, 1}, order), false, second);
  }
}

}  // namespace
