#include "flexarm/joint.hpp"

#include "flexarm/check.hpp"

namespace flexarm {

Joint::Joint(Type type, const Eigen::Vector3d& axis) : type_(type), axis_(finite("axis", axis)) {
  if (type == Type::fixed) return;
  if (!(axis.norm() > 0.0)) bad_value("axis", axis.transpose(), "must not be zero");
  axis_ = axis.normalized();
}

std::vector<std::string> Joint::coordinates() const {
  if (type_ == Type::revolute) return {"revolute"};
  if (type_ == Type::prismatic) return {"prismatic"};
  return {};
}

}  // namespace flexarm
