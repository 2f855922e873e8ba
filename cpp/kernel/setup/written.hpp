// How set-up writes the kernels' records (door/records.hpp), in the axes that the arm moves in.
#pragma once

#include <Eigen/Core>

#include "door/layout.hpp"
#include "door/records.hpp"
#include "space/plane.hpp"
#include "space/space.hpp"

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

/// The vectors and matrices of records in Sp, of Eigen's.
template <class Sp>
struct Written : Sp {
  Axes axes;
  explicit Written(const Axes& in) : axes(in) {}

  typename Sp::Lin lin(const Eigen::Vector3d& v) const {
    if constexpr (Sp::planar)
      return {v[axes.x], v[axes.y]};
    else
      return {v[0], v[1], v[2]};
  }
  typename Sp::Ang ang(const Eigen::Vector3d& v) const {
    if constexpr (Sp::planar)
      return {axes.sign * v[axes.z]};
    else
      return lin(v);
  }
  typename Sp::Sym sym(const Eigen::Matrix3d& J) const {
    if constexpr (Sp::planar)
      return {J(axes.z, axes.z)};
    else
      return {J(0, 0), J(1, 1), J(2, 2), J(0, 1), J(0, 2), J(1, 2)};
  }
  typename Sp::Rot rot(const Eigen::Matrix3d& R) const {
    if constexpr (Sp::planar)
      return {R(axes.x, axes.x), R(axes.y, axes.x)};
    else
      return {R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2), R(2, 0), R(2, 1), R(2, 2)};
  }
};

/// write(Written) in these axes.
template <class Write>
void in_axes(const Axes& axes, const Write& write) {
  axes.planar ? write(Written<::Plane<double>>(axes)) : write(Written<::Space<double>>(axes));
}

/// The numbers of a record, or of another list, behind others.
template <class Numbers, class Record>
void put_record(Numbers& out, const Record& record) {
  const double* x = view<const double>(&record);
  out.insert(out.end(), x, x + sizeof(Record) / sizeof(double));
}

}  // namespace lanes
}  // namespace flexarm
