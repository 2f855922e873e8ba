#include "loops_peer.hpp"

#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/constrained-dynamics.hpp>
#include <pinocchio/algorithm/loop-constrained-aba.hpp>
#include <pinocchio/config.hpp>
#include <pinocchio/multibody.hpp>

#include <stdexcept>
#include <string>
#include <vector>

#pragma GCC diagnostic ignored "-Wdeprecated-declarations"  // "the API will change"

namespace pin = pinocchio;

struct LoopPeer::Parts {
  pin::Model model;
  std::vector<pin::RigidConstraintModel> balls;
  pin::Data data, articulated;
  std::vector<pin::RigidConstraintData> held, held_articulated;
};

namespace {

template <int n>
Eigen::Matrix<double, n, 1> read(std::istream& file) {
  Eigen::Matrix<double, n, 1> x;
  for (double& number : x) file >> number;
  if (!file) throw std::invalid_argument("the robot's file ends too early");
  return x;
}

pin::SE3 moved(const Eigen::Vector3d& place) { return pin::SE3(Eigen::Matrix3d::Identity(), place); }

void add_joint(pin::Model& model, std::istream& file) {
  const auto parent = static_cast<pin::JointIndex>(read<1>(file)[0]);
  const Eigen::Vector3d axis = read<3>(file);
  const pin::SE3 seat = moved(read<3>(file));
  const std::string name = "joint" + std::to_string(model.njoints);
  const pin::JointIndex joint = axis.isZero()
                                    ? model.addJoint(parent, pin::JointModelSpherical(), seat, name)
                                    : model.addJoint(parent, pin::JointModelRevoluteUnaligned(axis), seat, name);
  const double mass = read<1>(file)[0];
  const Eigen::Vector3d com = read<3>(file);
  Eigen::Matrix3d inertia;
  inertia.reshaped<Eigen::RowMajor>() = read<9>(file);
  if (mass > 0.0) model.appendBodyToJoint(joint, pin::Inertia(mass, com, inertia), pin::SE3::Identity());
}

}  // namespace

LoopPeer::LoopPeer(std::istream& file) {
  pin::Model model;
  for (double left = read<1>(file)[0]; left > 0; --left) add_joint(model, file);
  std::vector<pin::RigidConstraintModel> balls;
  for (double left = read<1>(file)[0]; left > 0; --left) {
    const auto a = static_cast<pin::JointIndex>(read<1>(file)[0]);
    const pin::SE3 on_a = moved(read<3>(file));
    const auto b = static_cast<pin::JointIndex>(read<1>(file)[0]);
    const pin::SE3 on_b = moved(read<3>(file));
    balls.emplace_back(pin::CONTACT_3D, model, a, on_a, b, on_b, pin::LOCAL);
  }
  model.gravity.linear(read<3>(file));
  std::vector<pin::RigidConstraintData> held;
  for (const auto& ball : balls) held.push_back(ball.createData());
  parts_.reset(new Parts{model, balls, pin::Data(model), pin::Data(model), held, held});
  pin::initConstraintDynamics(model, parts_->data, parts_->balls, parts_->held);
  pin::computeJointMinimalOrdering(model, parts_->articulated, parts_->balls);
}

LoopPeer::~LoopPeer() = default;

// No redundant constraints: one iteration without damping is exact.
const Eigen::VectorXd& LoopPeer::constrained(const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                             const Eigen::VectorXd& tau) {
  pin::ProximalSettings once(1e-14, 0.0, 1);
  return pin::constraintDynamics(parts_->model, parts_->data, q, v, tau, parts_->balls, parts_->held, once);
}

// It needs damping. This one with two iterations has the smallest errors.
const Eigen::VectorXd& LoopPeer::articulated(const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                             const Eigen::VectorXd& tau) {
  pin::ProximalSettings twice(1e-14, 1e-6, 2);
  return pin::lcaba(parts_->model, parts_->articulated, q, v, tau, parts_->balls, parts_->held_articulated, twice);
}

const Eigen::VectorXd& LoopPeer::tree(const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& tau) {
  return pin::aba(parts_->model, parts_->articulated, q, v, tau, pin::Convention::WORLD);
}

const char* LoopPeer::version() { return PINOCCHIO_VERSION; }
