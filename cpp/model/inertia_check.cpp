// Whether every coordinate of an arm moves an inertia of its own: tested with the beams at rest, where the tables give
// the motion of sections.
#include <Eigen/Cholesky>
#include <cmath>

#include "flexarm/arm.hpp"
#include "flexarm/check.hpp"

namespace flexarm {

namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Matrix6Xd = Mat6X<double>;

/// A link's frame against the one its joint sits on, and its velocity there by the joint's rates, in link axes.
struct JointAt {
  Matrix3d R;
  Vector3d p;
  Matrix6Xd H;

  JointAt(const Joint& joint, const double* q)
      : R(joint.inboard().rotation), p(joint.inboard().position), H(6, joint.nv()) {
    H.setZero();
    std::vector<Vector3d> at;  // of each freedom
    const auto free = [&](bool rotation, const Vector3d& axis) {
      const Index k = static_cast<Index>(at.size());
      (rotation ? H.col(k).tail<3>() : H.col(k).head<3>()) = axis;
      at.push_back(p);
    };
    for (std::size_t i = 0; i < joint.motions().size(); ++i) {
      const ElementaryMotion& m = joint.motions()[i];
      const Vector3d axis = R * m.axis;
      if (!m.rotation) p += q[i] * axis;
      free(m.rotation, axis);
      if (m.rotation) R = R * Eigen::AngleAxisd(q[i], m.axis);
    }
    for (int k = 0; joint.has_ball() && k < 3; ++k) free(true, R.col(k));  // its quaternion is 1 0 0 0
    p += R * joint.outboard().position;
    R = R * joint.outboard().rotation;
    for (Index k = 0; k < H.cols(); ++k) {
      const Vector3d w = H.col(k).tail<3>();
      H.col(k).head<3>() = R.transpose() * (H.col(k).head<3>() + w.cross(p - at[static_cast<std::size_t>(k)]));
      H.col(k).tail<3>() = R.transpose() * w;
    }
  }
};

/// Velocity by a link's [V; dqe] of a section at x, which the elastic rates move by J.
Matrix6Xd moved(const Vector3d& x, const Matrix6Xd& J) {
  Matrix6Xd out(6, 6 + J.cols());
  out << Mat6<double>::Identity(), J;
  out.block<3, 3>(0, 3) = -tilde(x);
  return out;
}

/// A slice of the beam, or the hub's end where there is none.
struct At {
  Vector3d x;
  Matrix3d R = Matrix3d::Identity();
  Matrix6Xd J;

  At(const Link& link, const SliceTable& slice)
      : x(link.hub().end + slice.rest.x), R(slice.rest.R), J(slice.at_rest()) {}
  explicit At(const Link& link) : x(link.hub().end), J(Matrix6Xd::Zero(6, 0)) {
    if (link.beam()) *this = At(link, link.beam()->tip());
  }
  /// A point at `offset` from it.
  Matrix6Xd moved_at(const Vector3d& offset) const {
    const Vector3d r = R * offset;
    Matrix6Xd of = J;
    of.topRows<3>() -= (tilde(r) * J.bottomRows<3>()).eval();
    return moved(x + r, of);
  }
};

Matrix3d turned(const Matrix3d& R, const Matrix3d& inertia) { return R * inertia * R.transpose(); }

/// M_rfr (Eq. 80).
MatrixXd mass_matrix(const Link& link) {
  MatrixXd M = MatrixXd::Zero(6 + link.ne(), 6 + link.ne());
  const auto add = [&](double mass, const Matrix3d& inertia, const Matrix6Xd& B) {
    M += mass * B.topRows<3>().transpose() * B.topRows<3>() +
         B.bottomRows<3>().transpose() * inertia * B.bottomRows<3>();
  };
  add(link.hub().mass, link.hub().inertia, moved(link.hub().com, Matrix6Xd::Zero(6, link.ne())));
  if (link.beam())
    for (const MassSlice& s : link.beam()->slices()) {
      const SliceAtRest at = s.at_rest();
      add(s.mass, turned(at.R, s.inertia), moved(link.hub().end + at.x, at.J));
    }
  const At end(link);
  add(link.tip().mass, turned(end.R, link.tip().inertia), end.moved_at(link.tip().com));
  return M;
}

}  // namespace

/// The remaining part of a coordinate's inertia after the elimination of all coordinates beyond it (Eq. 93-96),
/// relative to its full inertia, at a pose without aligned joints.
void Arm::check_inertia() const {
  Eigen::VectorXd q = zero();
  for (std::size_t n = 0; n < size(); ++n)
    for (int k = first_[n]; k < first_[n] + links_[n].nj(); ++k)
      if (coordinate_of(k) >= 0) q[coordinate_of(k)] = 0.3 + 0.7 * std::sin(1.0 + 2.0 * k);
  const Mat6<double> none = Mat6<double>::Zero();
  std::vector<Mat6<double>> composite(size(), none), articulated = composite;  // of a link and all that it carries
  for (std::size_t n = size(); n-- > 0;) {
    const Link& link = links_[n];
    const Index nj = link.nj(), ne = link.ne();
    MatrixXd whole = mass_matrix(link), M = whole;
    for (std::size_t k = n + 1; k < size(); ++k) {  // through Phi_rfr of the links above (Eq. 68, 73)
      if (parent(k) != static_cast<int>(n)) continue;
      const JointAt above(links_[k].joint(), q.data() + first_q_[k]);
      const At seat = at(k) ? At(link, link.slice_at(*at(k))) : At(link);
      Matrix6Xd phi = seat.moved_at((at(k) ? Vector3d(Vector3d::Zero()) : link.tip().end) + above.p);
      const Matrix3d R = (seat.R * above.R).transpose();
      phi.topRows<3>() = (R * phi.topRows<3>()).eval();
      phi.bottomRows<3>() = (R * phi.bottomRows<3>()).eval();
      whole += phi.transpose() * composite[k] * phi;
      M += phi.transpose() * articulated[k] * phi;
    }
    MatrixXd H = MatrixXd::Zero(6 + ne, nj + ne);
    H.topLeftCorner(6, nj) = JointAt(link.joint(), q.data() + first_q_[n]).H;
    H.bottomRightCorner(ne, ne).setIdentity();
    const MatrixXd U = M * H;
    MatrixXd D = H.transpose() * U, own = H.transpose() * whole * H;
    for (std::size_t k = 0; k < link.joint().forces().size(); ++k)
      for (MatrixXd* m : {&D, &own}) m->diagonal()[static_cast<Index>(k)] += link.joint().forces()[k].reflected_inertia;
    const Eigen::LLT<MatrixXd> factor(D);
    const bool definite = factor.info() == Eigen::Success;
    for (Index k = 0; k < D.rows(); ++k) {
      const double rest = definite ? std::pow(factor.matrixLLT()(k, k), 2) : D(k, k);
      if (!(own(k, k) > 0.0) || !(rest > 1e-14 * own(k, k)))
        bad_value("inertia of coordinate '" + coordinates()[static_cast<std::size_t>(first_[n] + k)] + "'", rest,
                  "must be positive; give what moves with it a mass or an inertia (shear tells itself from bending by "
                  "rotary inertia alone), and a beam enough gauss_points");
    }
    if (!definite) bad_value("mass matrix", "singular", "its coordinates must move independent inertias");
    composite[n] = whole.topLeftCorner<6, 6>();
    articulated[n] = M.topLeftCorner<6, 6>() - U.topRows<6>() * factor.solve(U.topRows<6>().transpose());
  }
}

}  // namespace flexarm
