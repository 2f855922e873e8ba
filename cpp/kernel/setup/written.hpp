// How set-up writes the kernels' records (door/records.hpp), in the axes that the arm moves in.
#pragma once

#include <Eigen/Core>

#include "door/layout.hpp"
#include "door/records.hpp"
#include "wide/views.hpp"

namespace flexarm {
namespace lanes {

/// The world's axes that an arm moves in, and so do a beam's along it, across, and about which it turns.
struct Axes {
  bool planar = false;
  int x = 0, y = 1, z = 2;  ///< of the plane, and about which it turns
  double sign = 1.0;        ///< of a turn about z, seen with x to y as positive
};
inline Axes axes_of(const Layout& layout) {
  return {layout.planar, layout.along[0], layout.along[1], layout.about, layout.turning};
}

/// The vectors and matrices of records, of Eigen's.
template <bool planar>
struct Written {
  using Scalar = double;
  template <int n>
  struct List {
    double x[n];
  };
  using Lin = List<planar ? 2 : 3>;
  using Ang = List<planar ? 1 : 3>;
  using Sym = List<planar ? 1 : 6>;
  using Rot = List<planar ? 2 : 9>;

  Axes axes;

  Lin lin(const Eigen::Vector3d& v) const {
    if constexpr (planar)
      return {{v[axes.x], v[axes.y]}};
    else
      return {{v[0], v[1], v[2]}};
  }
  Ang ang(const Eigen::Vector3d& v) const {
    if constexpr (planar)
      return {{axes.sign * v[axes.z]}};
    else
      return lin(v);
  }
  Sym sym(const Eigen::Matrix3d& J) const {
    if constexpr (planar)
      return {{J(axes.z, axes.z)}};
    else
      return {{J(0, 0), J(1, 1), J(2, 2), J(0, 1), J(0, 2), J(1, 2)}};
  }
  Rot rot(const Eigen::Matrix3d& R) const {
    if constexpr (planar)
      return {{R(axes.x, axes.x), R(axes.y, axes.x)}};
    else
      return {{R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2), R(2, 0), R(2, 1), R(2, 2)}};
  }
};

/// write(Written) in these axes.
template <class Write>
void in_axes(const Axes& axes, const Write& write) {
  axes.planar ? write(Written<true>{axes}) : write(Written<false>{axes});
}

/// The numbers of a record, or of another list, behind others.
template <class Numbers, class Record>
void put_record(Numbers& out, const Record& record) {
  const double* x = view<const double>(&record);
  out.insert(out.end(), x, x + sizeof(Record) / sizeof(double));
}

}  // namespace lanes
}  // namespace flexarm
