// Pinocchio behind a wall: its headers take minutes to compile, and need not be compiled again when flexarm's change.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

/// A rigid body of a chain: about its joint, inertia about the centre of mass.
struct PeerBody {
  double mass;
  Eigen::Vector3d com;
  Eigen::Matrix3d inertia;
};

/// Pinocchio's model of a chain of hinges along z and y in turn, each at `end` of the body below.
class Peer {
 public:
  Peer(const std::vector<PeerBody>& bodies, const Eigen::Vector3d& end, const Eigen::Vector3d& gravity);
  ~Peer();
  /// Accelerations; by algorithms in local or in world axes.
  const Eigen::VectorXd& aba(const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& tau,
                             bool local);
  /// The mass matrix, its upper half alone.
  const Eigen::MatrixXd& crba(const Eigen::VectorXd& q, bool local);
  /// Inverse dynamics.
  const Eigen::VectorXd& rnea(const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a);
  /// Derivatives of the accelerations by q, v and the forces (of these the upper half), which stay in pinocchio's data.
  void aba_derivatives(const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& tau);
  /// Those by q and by v side by side.
  Eigen::MatrixXd last_derivatives() const;
  static const char* version();

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};
