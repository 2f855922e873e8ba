#include "peer.hpp"

#include <pinocchio/algorithm/aba-derivatives.hpp>
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/config.hpp>
#include <pinocchio/multibody.hpp>

#include <string>

namespace pin = pinocchio;

struct Peer::Parts {
  pin::Model model;
  pin::Data data;
};

namespace {

pin::Model model_of(const std::vector<PeerBody>& bodies, const Eigen::Vector3d& end, const Eigen::Vector3d& gravity) {
  pin::Model model;
  model.gravity.linear(gravity);
  for (std::size_t k = 0; k < bodies.size(); ++k) {
    const pin::SE3 seat(Eigen::Matrix3d::Identity(), k == 0 ? Eigen::Vector3d::Zero().eval() : end);
    const std::string name = "joint" + std::to_string(k);
    const pin::JointIndex joint =
        k % 2 ? model.addJoint(k, pin::JointModelRY(), seat, name) : model.addJoint(k, pin::JointModelRZ(), seat, name);
    model.appendBodyToJoint(joint, pin::Inertia(bodies[k].mass, bodies[k].com, bodies[k].inertia),
                            pin::SE3::Identity());
  }
  return model;
}

pin::Convention axes(bool local) { return local ? pin::Convention::LOCAL : pin::Convention::WORLD; }

}  // namespace

Peer::Peer(const std::vector<PeerBody>& bodies, const Eigen::Vector3d& end, const Eigen::Vector3d& gravity) {
  pin::Model model = model_of(bodies, end, gravity);
  pin::Data data(model);
  parts_.reset(new Parts{std::move(model), std::move(data)});
}

Peer::~Peer() = default;

// The answers stay in pinocchio's data, and are not copied.
const Eigen::VectorXd& Peer::aba(const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& tau,
                                 bool local) {
  return pin::aba(parts_->model, parts_->data, q, v, tau, axes(local));
}

const Eigen::MatrixXd& Peer::crba(const Eigen::VectorXd& q, bool local) {
  return pin::crba(parts_->model, parts_->data, q, axes(local));
}

const Eigen::VectorXd& Peer::rnea(const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a) {
  return pin::rnea(parts_->model, parts_->data, q, v, a);
}

void Peer::aba_derivatives(const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& tau) {
  pin::computeABADerivatives(parts_->model, parts_->data, q, v, tau);
}

Eigen::MatrixXd Peer::last_derivatives() const {
  const Eigen::Index n = parts_->model.nv;
  Eigen::MatrixXd out(n, 2 * n);
  out << parts_->data.ddq_dq, parts_->data.ddq_dv;
  return out;
}

const char* Peer::version() { return PINOCCHIO_VERSION; }
