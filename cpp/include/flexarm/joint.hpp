// Joints (Sec. 4.1). A joint offers its motion, its Jacobian H and the rate term; no algorithm asks for its
// type.
#pragma once

#include <string>
#include <vector>

#include "flexarm/spatial.hpp"

namespace flexarm {

/// Motion of a link's frame relative to the frame that its joint sits on.
template <class S>
struct JointMotion {
  Mat3<S> R = Mat3<S>::Identity();  ///< orientation of the link
  Vec3<S> p = Vec3<S>::Zero();      ///< position of the link's origin, in the axes the joint sits on
  Eigen::Matrix<S, 6, Eigen::Dynamic, Eigen::ColMajor, 6, 6> H;  ///< V_rel = H dq, in link axes (Eq. 66, 67)
  Vec6<S> V = Vec6<S>::Zero();                                   ///< H dq
  Vec6<S> c = Vec6<S>::Zero();                                   ///< (dH/dt) dq, and w_rel x v_rel in its linear rows
};

class Joint {
 public:
  enum class Type { fixed, revolute, prismatic };

  /// @param axis in the axes the joint sits on; need not be a unit vector
  /// @throws std::invalid_argument naming the field and the value
  explicit Joint(Type type, const Eigen::Vector3d& axis = Eigen::Vector3d::UnitZ());

  Type type() const { return type_; }
  const Eigen::Vector3d& axis() const { return axis_; }
  int nv() const { return type_ == Type::fixed ? 0 : 1; }
  std::vector<std::string> coordinates() const;

  template <class S>
  void move(const S* q, const S* dq, JointMotion<S>& out) const {
    out.H.setZero(6, nv());
    if (type_ == Type::fixed) return;
    const Vec3<S> u = axis_.template cast<S>();
    if (type_ == Type::revolute) {
      const Vec3<S> turn = u * q[0];
      out.R = rotation(turn, RotationCoefficients<S>(q[0] * q[0]));
      out.H.col(0).template tail<3>() = u;
    } else {
      out.p = u * q[0];
      out.H.col(0).template head<3>() = u;
    }
    out.V = out.H.col(0) * dq[0];
  }

 private:
  Type type_;
  Eigen::Vector3d axis_;
};

}  // namespace flexarm
