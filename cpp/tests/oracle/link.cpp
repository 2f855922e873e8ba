#include "oracle/link.hpp"

#include <Eigen/Geometry>

namespace oracle {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

Vector6d acceleration(const Section& at, const Vector6d& V, const Vector6d& A, const VectorXd& ddqe) {
  const Vector3d w = V.tail<3>(), dw = A.tail<3>();
  Vector6d out = at.J * ddqe;
  out.head<3>() += A.head<3>() + dw.cross(at.x) + w.cross(w.cross(at.x) + 2.0 * at.u_dot) + at.u_bias;
  out.tail<3>() += dw + w.cross(at.Omega) + at.Omega_bias;
  return out;
}

LinkMotion::LinkMotion(const flexarm::Link& link)
    : link_(&link), qe_(VectorXd::Zero(link.ne())), dqe_(VectorXd::Zero(link.ne())) {
  if (!link.beam()) return;
  sections_.emplace(*link.beam());
  if (link.beam()->order() == 0) cut();
}

void LinkMotion::move(const VectorXd& qe, const VectorXd& dqe) {
  qe_ = qe;
  dqe_ = dqe;
  if (sections_) sections_->move(qe, dqe);
}

Section LinkMotion::root() const { return sections_ ? at(link_->beam()->tip()) : Section(ne()).from(link_->hub().end); }

void LinkMotion::for_each_body(const Visit& visit) const {
  visit(link_->hub().mass, link_->hub().inertia, Section(ne()).at(link_->hub().com));
  if (sections_)
    for (const flexarm::MassSlice& s : link_->beam()->slices()) visit(s.mass, s.inertia, at(s.table).at(s.com));
  visit(link_->tip().mass, link_->tip().inertia, root().at(link_->tip().com));
}

namespace {

/// Velocity of a section by [V; dqe]: [1, -x~, J_T; 0, 1, J_R].
Matrix6Xd by_link(const Section& at) {
  Matrix6Xd out(6, 6 + at.J.cols());
  out << Eigen::Matrix<double, 6, 6>::Identity(), at.J;
  out.block<3, 3>(0, 3) = -cross_matrix(at.x);
  return out;
}

}  // namespace

MatrixXd LinkMotion::mass_matrix() const {
  MatrixXd M = MatrixXd::Zero(6 + ne(), 6 + ne());
  if (!cut_) {
    for_each_body([&](double m, const Matrix3d& inertia, const Section& at) {
      const Matrix6Xd B = by_link(at);
      M += m * B.topRows<3>().transpose() * B.topRows<3>() +
           B.bottomRows<3>().transpose() * (at.R * inertia * at.R.transpose()) * B.bottomRows<3>();
    });
    return M;
  }
  Vector3d moment = cut_->S + cut_->L * qe_;
  Matrix3d J = cut_->J;
  for (Index k = 0; k < ne(); ++k) J += cut_->dJ[static_cast<std::size_t>(k)] * qe_[k];
  M.topLeftCorner<3, 3>().diagonal().setConstant(cut_->mass);
  M.block<3, 3>(3, 0) = cross_matrix(moment);
  M.block<3, 3>(0, 3) = M.block<3, 3>(3, 0).transpose();
  M.block<3, 3>(3, 3) = J;
  M.topRightCorner(3, ne()) = cut_->L;
  M.block(3, 6, 3, ne()) = cut_->C;
  M.bottomLeftCorner(ne(), 6) = M.topRightCorner(6, ne()).transpose();
  M.bottomRightCorner(ne(), ne()) = cut_->Mee;
  return M;
}

VectorXd LinkMotion::inertial_force(const Vector6d& V, const Vector6d& A, const VectorXd& ddqe,
                                    const Vector3d& gravity) const {
  VectorXd F = VectorXd::Zero(6 + ne());
  const Vector3d w = V.tail<3>();
  if (!cut_) {
    for_each_body([&](double m, const Matrix3d& inertia, const Section& at) {
      const Vector6d a = acceleration(at, V, A, ddqe);
      const Matrix3d J = at.R * inertia * at.R.transpose();
      const Vector3d turning = w + at.Omega;
      Vector6d f;
      f << m * a.head<3>(), J * a.tail<3>() + turning.cross(J * turning);
      F += by_link(at).transpose() * f;
    });
    return F;
  }
  // Boltzmann-Hamel equations of the cut kinetic energy: momenta p = S x + L dq, h = J w + C dq + S x v.
  const Cut& c = *cut_;
  const Vector3d a = A.head<3>(), dw = A.tail<3>(), moment = c.S + c.L * qe_;
  Matrix3d J = c.J, J_dot = Matrix3d::Zero();
  for (Index k = 0; k < ne(); ++k) {
    const Matrix3d& dJ = c.dJ[static_cast<std::size_t>(k)];
    J += dJ * qe_[k];
    J_dot += dJ * dqe_[k];
    F[6 + k] = c.L.col(k).dot(a) + c.C.col(k).dot(dw) - 0.5 * w.dot(dJ * w);
  }
  F.tail(ne()) += c.Mee * ddqe;
  F.head<3>() = c.mass * a + dw.cross(moment) + w.cross(w.cross(moment) + 2.0 * c.L * dqe_) + c.L * ddqe;
  F.segment<3>(3) = moment.cross(a) + J * dw + J_dot * w + w.cross(J * w + c.C * dqe_) + c.C * ddqe;
  // Only the kinetic energy is cut: gravity, which comes in as an acceleration, acts where the tip body really is.
  F.segment<3>(3) -= tip_beyond_first_order().cross(gravity);
  const Matrix6Xd J_com = root().at(link_->tip().com).J;
  F.tail(ne()) -= (link_->tip().mass * J_com.topRows<3>() - c.tip).transpose() * gravity;
  return F;
}

Vector3d LinkMotion::tip_beyond_first_order() const {
  const Vector3d rest = link_->hub().end + link_->beam()->length() * Vector3d::UnitX() + link_->tip().com;
  return link_->tip().mass * (root().at(link_->tip().com).x - rest) - cut_->tip * qe_;
}

Vector3d LinkMotion::mass_moment() const {
  if (cut_) return cut_->S + cut_->L * qe_ + tip_beyond_first_order();
  Vector3d sum = Vector3d::Zero();
  for_each_body([&](double m, const Matrix3d&, const Section& at) { sum += m * at.x; });
  return sum;
}

void LinkMotion::cut() {
  move(VectorXd::Zero(ne()), VectorXd::Zero(ne()));
  const MatrixXd M = mass_matrix();
  Cut c;
  c.mass = M(0, 0);
  c.S = mass_moment();
  c.J = M.block<3, 3>(3, 3);
  c.L = M.block(0, 6, 3, ne());
  c.C = M.block(3, 6, 3, ne());
  c.Mee = M.bottomRightCorner(ne(), ne());
  c.tip = link_->tip().mass * root().at(link_->tip().com).J.topRows<3>();
  c.dJ.assign(static_cast<std::size_t>(ne()), Matrix3d::Zero());
  for_each_body([&](double m, const Matrix3d& inertia, const Section& at) {
    const Matrix3d x = cross_matrix(at.x);
    for (Index k = 0; k < ne(); ++k) {
      const Matrix3d xk = cross_matrix(Vector3d(at.J.col(k).head<3>())),
                     turn = cross_matrix(Vector3d(at.J.col(k).tail<3>()));
      c.dJ[static_cast<std::size_t>(k)] -= m * (xk * x + x * xk);
      c.dJ[static_cast<std::size_t>(k)] += turn * inertia - inertia * turn;
    }
  });
  cut_ = std::move(c);
}

}  // namespace oracle
