// The link: joint, rigid hub, elastic beam, rigid tip (Sec. 4.2), with its mass matrix (Eq. 80) and its inertial force
// (Eq. 81).
#pragma once

#include <functional>
#include <optional>

#include "flexarm/link.hpp"
#include "oracle/sections.hpp"

namespace oracle {

class LinkMotion {
 public:
  explicit LinkMotion(const flexarm::Link& link);
  void move(const Eigen::VectorXd& qe, const Eigen::VectorXd& dqe);

  Eigen::Index ne() const { return link_->ne(); }
  Section end() const { return root().at(link_->tip().end); }
  Section at(const flexarm::SliceTable& table) const { return sections_->at(table).from(link_->hub().end); }
  /// M_rfr, (6 + ne)^2.
  Eigen::MatrixXd mass_matrix() const;
  /// M_rfr [A; ddqe] + N_rfr at a velocity V of the link. At order 0 gravity, in link axes, is not only in A.
  Eigen::VectorXd inertial_force(const Vector6d& V, const Vector6d& A, const Eigen::VectorXd& ddqe,
                                 const Eigen::Vector3d& gravity) const;
  /// Mass times the centre of mass.
  Eigen::Vector3d mass_moment() const;

 private:
  /// Order 0: kinetic energy cut at first order in (qe, dqe) together, plus dqe^T Mee(0) dqe / 2.
  struct Cut {
    double mass;
    Eigen::Vector3d S;                ///< mass moment at rest
    Eigen::Matrix3d J;                ///< second moment at rest
    Eigen::Matrix3Xd L, C;            ///< Mre: linear and angular rows; L is also dS/dqe
    std::vector<Eigen::Matrix3d> dJ;  ///< dJ/dqe_i
    Eigen::MatrixXd Mee;
    Eigen::Matrix3Xd tip;  ///< the tip body's part of L
  };
  using Visit = std::function<void(double mass, const Eigen::Matrix3d& inertia, const Section&)>;
  void for_each_body(const Visit& visit) const;
  Section root() const;
  void cut();
  Eigen::Vector3d tip_beyond_first_order() const;

  const flexarm::Link* link_;
  std::optional<Sections> sections_;
  Eigen::VectorXd qe_, dqe_;
  std::optional<Cut> cut_;
};

/// Absolute acceleration of a section when its link has V, A and elastic accelerations ddqe (Eq. 45, 46).
Vector6d acceleration(const Section& at, const Vector6d& V, const Vector6d& A, const Eigen::VectorXd& ddqe);

}  // namespace oracle
