#include "oracle/oracle.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <limits>

namespace oracle {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using flexarm::SliceTable;

namespace {

/// Phi = [R^T, -R^T r~; 0, R^T] to a frame at r, turned by R (Eq. 68).
Eigen::Matrix<double, 6, 6> phi(const Matrix3d& R, const Vector3d& r) {
  Eigen::Matrix<double, 6, 6> out;
  out << R.transpose(), -R.transpose() * cross_matrix(r), Matrix3d::Zero(), R.transpose();
  return out;
}

template <class M>
void turn_rows(const Matrix3d& R, M& x) {
  x.template topRows<3>() = (R * x.template topRows<3>()).eval();
  x.template bottomRows<3>() = (R * x.template bottomRows<3>()).eval();
}

}  // namespace

Oracle::Oracle(const flexarm::Arm& arm, const std::vector<bool>& prescribed, const std::vector<flexarm::Load>& loads)
    : wrenches(loads.size(), Vector6d::Zero()), arm_(&arm), loads_(loads) {
  for (int i = 0; i < arm.nv(); ++i)
    if (prescribed.empty() || !prescribed[static_cast<std::size_t>(i)]) free_.push_back(i);
  for (const flexarm::Link& link : arm.links()) links_.emplace_back(link);
}

/// Outward: positions, velocities, bias accelerations (Eq. 68, 69, 73-75, 82, 83).
std::vector<Oracle::Moved> Oracle::move(const VectorXd& q, const VectorXd& v) const {
  std::vector<Moved> out;
  for (std::size_t n = 0; n < arm_->size(); ++n) {
    const flexarm::Joint& joint = arm_->link(n).joint();
    const int i = arm_->first_q(n), j = arm_->first(n);
    const JointMotion motion(joint, q.data() + i, v.data() + j);
    Moved m{links_[n], {}, Matrix6Xd::Zero(6, arm_->nv()), motion.V, motion.c, {}, {}, VectorXd::Zero(joint.nv())};
    m.qe = q.segment(i + joint.nq(), arm_->link(n).ne());
    m.dqe = v.segment(j + joint.nv(), arm_->link(n).ne());
    m.link.move(m.qe, m.dqe);
    for (int k = 0; k < joint.nv(); ++k) m.resisted[k] = resistance(joint, k, q.data() + i, v.data() + j);
    if (arm_->parent(n) == flexarm::Arm::kWorld) {
      m.pose = {motion.p, motion.R};
    } else {
      const auto parent = static_cast<std::size_t>(arm_->parent(n));
      const Moved& below = out[parent];
      const std::optional<double>& at = arm_->at(n);
      const Section end = at ? below.link.at(arm_->link(parent).slice_at(*at)) : below.link.end();
      const Section seat = end.at(motion.p);
      const Matrix3d R = seat.R * motion.R;
      m.pose = {below.pose.p + below.pose.R * seat.x, below.pose.R * R};
      // the seat in link axes, then its Jacobian by all rates: Phi J + Phi_e of the elastic rates below
      Matrix6Xd phi_e = seat.J;
      turn_rows(R.transpose(), phi_e);
      m.J = phi(R, seat.x) * below.J;
      m.J.middleCols(arm_->first(parent) + arm_->link(parent).nj(), phi_e.cols()) += phi_e;
      const Vector6d carried = phi(R, seat.x) * below.V + phi_e * below.dqe;
      m.V += carried;
      Vector6d a = acceleration(seat, below.V, below.N, VectorXd::Zero(phi_e.cols()));
      turn_rows(R.transpose(), a);
      const Vector3d w = carried.tail<3>();
      m.N += a;
      m.N.head<3>() += 2.0 * w.cross(motion.V.head<3>());
      m.N.tail<3>() += w.cross(motion.V.tail<3>());
    }
    m.J.middleCols(j, joint.nv()) += motion.H;
    out.push_back(std::move(m));
  }
  return out;
}

/// The link's [V; dqe] by all rates.
MatrixXd Oracle::by_rates(std::size_t n, const Moved& m) const {
  const Index ne = m.qe.size();
  MatrixXd out = MatrixXd::Zero(6 + ne, arm_->nv());
  out.topRows<6>() = m.J;
  out.block(6, arm_->first(n) + arm_->link(n).nj(), ne, ne).setIdentity();
  return out;
}

MatrixXd Oracle::mass_matrix(const VectorXd& q) const {
  const std::vector<Moved> moved = move(q, VectorXd::Zero(arm_->nv()));
  MatrixXd M = MatrixXd::Zero(arm_->nv(), arm_->nv());
  for (std::size_t n = 0; n < moved.size(); ++n) {
    const MatrixXd B = by_rates(n, moved[n]);
    M += B.transpose() * moved[n].link.mass_matrix() * B;
    const flexarm::Joint& joint = arm_->link(n).joint();
    for (std::size_t k = 0; k < joint.forces().size(); ++k)
      M.diagonal()[arm_->first(n) + static_cast<Index>(k)] += joint.forces()[k].reflected_inertia;
  }
  return M;
}

Section Oracle::section(const Moved& m, const SliceTable* slice) const {
  return slice ? m.link.at(*slice) : m.link.end();
}

/// Forces of the loads on a link's [V; dqe] (Eq. 53).
VectorXd Oracle::loads_on(std::size_t n, const Moved& m) const {
  VectorXd F = VectorXd::Zero(6 + m.qe.size());
  for (std::size_t l = 0; l < loads_.size(); ++l) {
    const flexarm::Load& load = loads_[l];
    if (load.strut >= 0 || load.link != n) continue;
    const auto act = [&](const Section& at, double weight) {
      Vector6d W = weight * wrenches[l];
      turn_rows(load.world_axes ? Matrix3d(m.pose.R.transpose()) : at.R, W);
      F.head<6>() += W;
      F.segment<3>(3) += at.x.cross(Vector3d(W.head<3>()));
      F.tail(m.qe.size()) += at.J.transpose() * W;
    };
    if (load.points.empty()) act(m.link.end(), 1.0);
    for (const flexarm::Load::Point& point : load.points) act(m.link.at(point.slice), point.weight);
  }
  return F;
}

VectorXd Oracle::inverse(const VectorXd& q, const VectorXd& v, const VectorXd& a) const {
  VectorXd tau = VectorXd::Zero(arm_->nv());
  const std::vector<Moved> moved = move(q, v);
  for (std::size_t n = 0; n < moved.size(); ++n) {
    const Moved& m = moved[n];
    const flexarm::Link& link = arm_->link(n);
    const int j = arm_->first(n), e = j + link.nj();
    const MatrixXd B = by_rates(n, m);
    // A = Phi (H ddq + N) (Eq. 86), in a world that accelerates against gravity
    const Vector3d g = m.pose.R.transpose() * arm_->gravity();
    Vector6d A = m.J * a + m.N;
    A.head<3>() -= g;
    VectorXd F = m.link.inertial_force(m.V, A, a.segment(e, link.ne()), g) - loads_on(n, m);                   // Eq. 84
    if (link.ne() > 0) F.tail(link.ne()) += link.beam()->stiffness() * m.qe + link.beam()->damping() * m.dqe;  // Eq. 62
    tau += B.transpose() * F;                                                                                  // Eq. 87
    tau.segment(j, link.nj()) += m.resisted;
    for (std::size_t k = 0; k < link.joint().forces().size(); ++k)
      tau[j + static_cast<Index>(k)] += link.joint().forces()[k].reflected_inertia * a[j + static_cast<Index>(k)];
  }
  for (const flexarm::AppliedFeedback& f : feedback) tau -= (*f.law)(f.offset, q, v) * f.law->column;
  for (std::size_t k = 0; k < arm_->struts().size(); ++k) {
    const flexarm::Strut& strut = arm_->struts()[k];
    const Stretch line = stretch(strut, q);
    double push = strut.force;
    for (std::size_t l = 0; l < loads_.size(); ++l)
      if (loads_[l].strut == static_cast<int>(k)) push += wrenches[l][0];
    const double depth = line.length - strut.length, rate = line.by_rates.dot(v);
    const double soft = strut.tension_only ? std::min(1.0, depth / 1e-3) : 1.0;
    if (depth > 0.0 || !strut.tension_only) push -= strut.stiffness * depth + soft * strut.damping * rate;
    if (strut.tension_only) push = std::min(push, 0.0);
    tau -= push * line.by_rates;
  }
  return tau;
}

Oracle::Stretch Oracle::stretch(const flexarm::Strut& strut, const VectorXd& q) const {
  std::vector<Vector3d> at;
  std::vector<MatrixXd> moved;
  for (const flexarm::Strut::Point& point : strut.points) {
    at.push_back(point.offset);
    moved.push_back(MatrixXd::Zero(3, arm_->nv()));
    if (point.link < 0) continue;
    const auto link = static_cast<std::size_t>(point.link);
    flexarm::SliceTable slice;
    if (point.on == flexarm::Strut::Point::slice) slice = arm_->link(link).slice_at(point.x);
    const bool on_slice = point.on == flexarm::Strut::Point::slice;
    Pose pose = this->pose(link, on_slice ? &slice : nullptr, q);
    Matrix6Xd J = jacobian(link, on_slice ? &slice : nullptr, q);
    if (point.on == flexarm::Strut::Point::origin) {
      const Pose own = link_pose(link, q);
      const Moved m = move(q, VectorXd::Zero(arm_->nv()))[link];
      J << own.R * m.J.topRows<3>(), own.R * m.J.bottomRows<3>();
      pose = own;
    }
    const Vector3d across = pose.R * point.offset;
    at.back() = pose.p + across;
    moved.back() = J.topRows<3>();
    for (Index k = 0; k < J.cols(); ++k) moved.back().col(k) += Vector3d(J.col(k).tail<3>()).cross(across);
  }
  Stretch out{0.0, VectorXd::Zero(arm_->nv())};
  for (std::size_t i = 1; i < at.size(); ++i) {
    const Vector3d d = at[i] - at[i - 1];
    out.length += d.norm();
    out.by_rates += (moved[i] - moved[i - 1]).transpose() * d.normalized();
  }
  return out;
}

VectorXd Oracle::solve_free(const MatrixXd& S, const VectorXd& r) const {
  const VectorXd x = S(free_, free_).partialPivLu().solve(VectorXd(r(free_)));
  VectorXd out = VectorXd::Zero(r.size());
  out(free_) = x;
  return out;
}

VectorXd Oracle::forward(const VectorXd& q, const VectorXd& v, const VectorXd& tau, const VectorXd& a) const {
  const MatrixXd M = mass_matrix(q);
  VectorXd out = a;
  out(free_).setZero();
  const VectorXd rest = tau - inverse(q, v, out);
  if (Eigen::LLT<MatrixXd>(M(free_, free_)).info() != Eigen::Success)
    return VectorXd::Constant(a.size(), std::numeric_limits<double>::quiet_NaN());
  out += solve_free(M, rest);
  return out;
}

MatrixXd Oracle::shifted(const VectorXd& q, const VectorXd& v, double damping, double stiffness) const {
  MatrixXd S = mass_matrix(q);
  for (std::size_t n = 0; n < arm_->size(); ++n) {
    const flexarm::Link& link = arm_->link(n);
    const int j = arm_->first(n), e = j + link.nj(), ne = link.ne();
    for (int k = 0; k < link.nj(); ++k) {
      const auto [by_q, by_v] = resistance_slopes(link.joint(), k, q.data() + arm_->first_q(n), v.data() + j);
      S(j + k, j + k) += stiffness * by_q + damping * by_v;
    }
    if (ne > 0) S.block(e, e, ne, ne) += stiffness * link.beam()->stiffness() + damping * link.beam()->damping();
  }
  for (const flexarm::AppliedFeedback& f : feedback) {
    if (!(std::abs((*f.law)(f.offset, q, v)) < f.law->limit)) continue;
    VectorXd slopes = damping * f.law->by_v;
    for (int i = 0; i < arm_->nv(); ++i)
      if (arm_->coordinate_of(i) >= 0) slopes[i] += stiffness * f.law->by_q[arm_->coordinate_of(i)];
    S += f.law->column * slopes.transpose();
  }
  for (const flexarm::Strut& strut : arm_->struts()) {  // away from the kinks of ropes
    const Stretch line = stretch(strut, q);
    const double depth = line.length - strut.length;
    if (strut.tension_only &&
        (depth < 0.0 || strut.force > strut.stiffness * depth + strut.damping * line.by_rates.dot(v)))
      continue;
    S += (stiffness * strut.stiffness + damping * strut.damping) * line.by_rates * line.by_rates.transpose();
  }
  return S;
}

double Oracle::potential(const VectorXd& q) const {
  double sum = -arm_->gravity().dot(mass_moment(q));
  for (std::size_t n = 0; n < arm_->size(); ++n) {
    const flexarm::Link& link = arm_->link(n);
    sum += oracle::potential(link.joint(), q.data() + arm_->first_q(n));
    if (link.ne() == 0) continue;
    const VectorXd qe = q.segment(arm_->first_q(n) + link.joint().nq(), link.ne());
    sum += 0.5 * qe.dot(link.beam()->stiffness() * qe);
  }
  for (const flexarm::Strut& strut : arm_->struts()) {
    const double depth = stretch(strut, q).length - strut.length;
    if (depth > 0.0 || !strut.tension_only) sum += 0.5 * strut.stiffness * depth * depth;
  }
  return sum;
}

Vector3d Oracle::mass_moment(const VectorXd& q) const {
  Vector3d sum = Vector3d::Zero();
  const std::vector<Moved> moved = move(q, VectorXd::Zero(arm_->nv()));
  for (std::size_t n = 0; n < moved.size(); ++n)
    sum += arm_->link(n).mass() * moved[n].pose.p + moved[n].pose.R * moved[n].link.mass_moment();
  return sum;
}

Vector6d Oracle::momentum(const VectorXd& q, const VectorXd& v) const {
  Vector6d sum = Vector6d::Zero();
  for (const Moved& m : move(q, v)) {
    VectorXd rates(6 + m.dqe.size());
    rates << m.V, m.dqe;
    Vector6d P = m.link.mass_matrix().topRows<6>() * rates;  // about the link's origin: the rigid rows of Eq. 80
    turn_rows(m.pose.R, P);
    sum += P;
    sum.tail<3>() += m.pose.p.cross(Vector3d(P.head<3>()));
  }
  return sum;
}

Pose Oracle::link_pose(std::size_t link, const VectorXd& q) const {
  return move(q, VectorXd::Zero(arm_->nv()))[link].pose;
}

Pose Oracle::pose(std::size_t link, const SliceTable* slice, const VectorXd& q) const {
  const std::vector<Moved> moved = move(q, VectorXd::Zero(arm_->nv()));
  const Pose& pose = moved[link].pose;
  const Section at = section(moved[link], slice);
  return {pose.p + pose.R * at.x, pose.R * at.R};
}

/// Of a section in link axes: [1, -x~] J + [J_T; J_R].
Matrix6Xd Oracle::section_jacobian(std::size_t n, const Moved& m, const Section& at) const {
  Matrix6Xd J = m.J;
  J.topRows<3>() -= (cross_matrix(at.x) * m.J.bottomRows<3>()).eval();
  J.middleCols(arm_->first(n) + arm_->link(n).nj(), at.J.cols()) += at.J;
  return J;
}

Matrix6Xd Oracle::jacobian(std::size_t link, const SliceTable* slice, const VectorXd& q) const {
  const std::vector<Moved> moved = move(q, VectorXd::Zero(arm_->nv()));
  Matrix6Xd J = section_jacobian(link, moved[link], section(moved[link], slice));
  turn_rows(moved[link].pose.R, J);
  return J;
}

Vector6d Oracle::motion(std::size_t link, const SliceTable* slice, const VectorXd& q, const VectorXd& v,
                        const VectorXd& a) const {
  const std::vector<Moved> moved = move(q, v);
  const Moved& m = moved[link];
  Vector6d out = acceleration(section(m, slice), m.V, m.J * a + m.N,
                              a.segment(arm_->first(link) + arm_->link(link).nj(), m.qe.size()));
  turn_rows(m.pose.R, out);
  return out;
}

}  // namespace oracle
