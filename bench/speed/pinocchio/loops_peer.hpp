// Pinocchio's robot with closed loops behind a wall, as in peer.hpp.
#pragma once

#include <Eigen/Core>
#include <istream>
#include <memory>

class LoopPeer {
 public:
  /// Reads joints, balls that close loops, and gravity, as bench/run/loops_pinocchio.py writes them.
  explicit LoopPeer(std::istream& file);
  ~LoopPeer();
  /// Accelerations on the loops, by the sparse Cholesky factors of the whole matrix of masses and constraints.
  const Eigen::VectorXd& constrained(const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& tau);
  /// The same by articulated bodies, which loops join.
  const Eigen::VectorXd& articulated(const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& tau);
  /// Accelerations of the tree, without loops.
  const Eigen::VectorXd& tree(const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& tau);
  static const char* version();

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};
