// The equations of the paper as they stand, on matrices of the whole arm: what the library's kernel is tested against.
// Slow on purpose: nothing here is clever.
//
// Subscript rfr: of a link's [V; dqe]. J_n, 6 x nv, is row n of Phi H: the link's velocity by all rates.
#pragma once

#include <vector>

#include "flexarm/arm.hpp"
#include "flexarm/control.hpp"
#include "flexarm/load.hpp"
#include "oracle/joint.hpp"
#include "oracle/link.hpp"

namespace oracle {

struct Pose {
  Eigen::Vector3d p = Eigen::Vector3d::Zero();      ///< world axes
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();  ///< columns: the frame's axes in world axes
};

class Oracle {
 public:
  explicit Oracle(const flexarm::Arm& arm, const std::vector<bool>& prescribed = {},
                  const std::vector<flexarm::Load>& loads = {});

  std::vector<Vector6d> wrenches;                  ///< of the loads, now
  std::vector<flexarm::AppliedFeedback> feedback;  ///< with their offsets, now

  /// M(q) = H^T Phi^T M Phi H (Eq. 90) with the reflected inertias.
  Eigen::MatrixXd mass_matrix(const Eigen::VectorXd& q) const;
  /// Generalised forces of accelerations a (Eq. 84-87), less those of loads and feedback.
  Eigen::VectorXd inverse(const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a) const;
  /// Accelerations (Eq. 90); `a` holds those that are prescribed. Not a number where M is not positive definite.
  Eigen::VectorXd forward(const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& tau,
                          const Eigen::VectorXd& a) const;
  /// S = M + damping D + stiffness K of an implicit step at q, v, with feedback.
  Eigen::MatrixXd shifted(const Eigen::VectorXd& q, const Eigen::VectorXd& v, double damping, double stiffness) const;
  /// S^-1 r on what is free, zero elsewhere.
  Eigen::VectorXd solve_free(const Eigen::MatrixXd& S, const Eigen::VectorXd& r) const;
  /// Of a strut: its length and its derivative (nv): of its rate by the rates.
  struct Stretch {
    double length = 0.0;
    Eigen::VectorXd by_rates;
  };
  Stretch stretch(const flexarm::Strut& strut, const Eigen::VectorXd& q) const;
  double potential(const Eigen::VectorXd& q) const;
  /// Sum of mass times place, world axes.
  Eigen::Vector3d mass_moment(const Eigen::VectorXd& q) const;
  /// Of the whole arm about the world's origin, world axes.
  Vector6d momentum(const Eigen::VectorXd& q, const Eigen::VectorXd& v) const;

  // Of a slice, or (null) of the link's end; world axes, [linear; angular] (Eq. 91, 85, 86).
  Pose pose(std::size_t link, const flexarm::SliceTable* slice, const Eigen::VectorXd& q) const;
  Matrix6Xd jacobian(std::size_t link, const flexarm::SliceTable* slice, const Eigen::VectorXd& q) const;
  Vector6d motion(std::size_t link, const flexarm::SliceTable* slice, const Eigen::VectorXd& q,
                  const Eigen::VectorXd& v, const Eigen::VectorXd& a) const;
  /// The pose of a link's own frame.
  Pose link_pose(std::size_t link, const Eigen::VectorXd& q) const;

 private:
  /// One link in motion.
  struct Moved {
    LinkMotion link;
    Pose pose;
    Matrix6Xd J;               ///< Phi H
    Vector6d V, N;             ///< velocity; acceleration where all of a is zero and nothing falls
    Eigen::VectorXd qe, dqe;   ///< elastic coordinates and rates
    Eigen::VectorXd resisted;  ///< forces of springs, dampers and stops of the joint
  };
  std::vector<Moved> move(const Eigen::VectorXd& q, const Eigen::VectorXd& v) const;
  Section section(const Moved& m, const flexarm::SliceTable* slice) const;
  Eigen::VectorXd loads_on(std::size_t n, const Moved& m) const;
  Matrix6Xd section_jacobian(std::size_t n, const Moved& m, const Section& at) const;
  Eigen::MatrixXd by_rates(std::size_t n, const Moved& m) const;

  const flexarm::Arm* arm_;
  std::vector<int> free_;
  std::vector<flexarm::Load> loads_;
  std::vector<LinkMotion> links_;
};

}  // namespace oracle
