// The slice: a rigid cross section of a beam at a place X, moved by its link's V and elastic coordinates.
// Inertia, gravity, the tip body, sensors and the next joint all hang on slices; this is the one way to move
// them.
#pragma once

#include <vector>

#include "flexarm/shape.hpp"
#include "flexarm/spatial.hpp"

namespace flexarm {

/// One term q_i^T C q_j of a slice's motion (or q_i^T C q_i / 2, C symmetric, when the two blocks are the
/// same one).
struct Product {
  int row;   ///< 0-2: position, 3-5: rotation vector
  int i, j;  ///< first coordinate of each block
  Eigen::MatrixXd C;
};

/// A beam that bends and shears in one plane alone: the rotations of its sections add, about one axis.
enum class Plane { none, xy, xz };
inline int row_across(Plane plane) { return plane == Plane::xy ? 1 : 2; }  ///< of the position, besides row 0
inline int row_of_turn(Plane plane) { return plane == Plane::xy ? 5 : 4; }

/// What a slice at X needs, built once at set-up. At order 0 to 2: position x = x0 + L_x q + products (Eq. 24) and
/// rotation vector theta = L_theta q + products (Magnus series), both cut at the beam's order. Blocks that a beam lacks
/// are not stored.
struct SliceTable {
  double X = 0.0;
  Plane plane = Plane::none;
  Eigen::Matrix<double, 6, Eigen::Dynamic> linear;  ///< [L_x; L_theta]
  std::vector<Product> products;                    ///< second order; empty at order 0 and 1
  StrainMatrix strains;                             ///< per coordinate (Eq. 28-32)
  Eigen::RowVectorXd weights;  ///< beyond order 2: of the integral from 0 to X over the Gauss points (series.hpp)
  int point = -1;              ///< of these, the one that the slice is at
};

/// Motion of a slice relative to its link, in link axes.
template <class S>
struct Slice {
  Vec3<S> x = Vec3<S>::Zero();           ///< position
  Mat3<S> R = Mat3<S>::Identity();       ///< orientation
  Mat6X<S> J;                            ///< [J_T; J_R]: velocities per elastic rate (Eq. 37, 39)
  Vec3<S> u_dot = Vec3<S>::Zero();       ///< J_T dq
  Vec3<S> Omega = Vec3<S>::Zero();       ///< J_R dq
  Vec3<S> u_bias = Vec3<S>::Zero();      ///< (dJ_T/dt) dq (Eq. 38)
  Vec3<S> Omega_bias = Vec3<S>::Zero();  ///< (dJ_R/dt) dq (Eq. 40)

  explicit Slice(int ne = 0) : J(Mat6X<S>::Zero(6, ne)) {}
};

/// Orientation from the rotation vector t, its rate and the convective part of its second rate; out.J holds dt/dq.
/// R = exp(t), Omega = J_l(t) dt with the left Jacobian J_l = I + b t~ + c t~^2 (Eq. 35), and its rate
/// dOmega/dt = J_l ddt + (dJ_l/dt) dt.
template <class S>
void turn_slice(const Vec3<S>& t, const Vec3<S>& t_dot, const Vec3<S>& t_bias, Slice<S>& out) {
  const S s = t.dot(t);
  const RotationCoefficients<S> k(s);
  out.R = rotation(t, k);
  const auto left_jacobian = [&](const Vec3<S>& y) {
    const Vec3<S> ty = t.cross(y);
    return Vec3<S>(y + k.b * ty + k.c * t.cross(ty));
  };
  out.Omega = left_jacobian(t_dot);
  const Vec3<S> tt = t.cross(t_dot);
  const S s_dot = 2.0 * t.dot(t_dot);
  out.Omega_bias = left_jacobian(t_bias) + (k.db * s_dot) * tt + (k.dc * s_dot) * t.cross(tt) + k.c * t_dot.cross(tt);
  for (Eigen::Index i = 0; i < out.J.cols(); ++i) {
    const Vec3<S> column = out.J.col(i).template tail<3>();
    out.J.col(i).template tail<3>() = left_jacobian(column);
  }
}

/// The same in a plane, where the axis stands still and there is no convective term.
template <class S>
void turn_planar_slice(Plane plane, const S& turn, const S& rate, Slice<S>& out) {
  using std::cos;
  using std::sin;
  const S c = cos(turn), s = sin(turn);
  const int from = plane == Plane::xy ? 0 : 2, to = plane == Plane::xy ? 1 : 0;  // about z, or about y
  out.R(from, from) = out.R(to, to) = c;
  out.R(to, from) = s;
  out.R(from, to) = -s;
  out.Omega[row_of_turn(plane) - 3] = rate;
}

/// Moves a slice at order 0 to 2 (Eq. 23-27, 34-40). `origin` is the beam's base in link axes; q, dq are the link's
/// elastic coordinates and rates. Where nothing asks for the orientation (`orient` false), R, J_R and Omega are left
/// alone.
template <class S>
void move_slice(const SliceTable& table, const Eigen::Vector3d& origin, const S* q, const S* dq, bool orient,
                Slice<S>& out) {
  // rows of position and rotation vector that move
  int rows[6] = {0, 1, 2, 3, 4, 5}, moving = orient ? 6 : 3;
  if (table.plane != Plane::none) {
    rows[1] = row_across(table.plane);
    rows[2] = row_of_turn(table.plane);
    moving = orient ? 3 : 2;
  }
  const Eigen::Index ne = table.linear.cols();
  S value[6] = {origin[0] + table.X, S(origin[1]), S(origin[2]), S(0), S(0), S(0)};
  S rate[6], bias[6] = {S(0), S(0), S(0), S(0), S(0), S(0)};
  for (Eigen::Index k = 0; k < ne; ++k)
    for (int m = 0; m < moving; ++m) {
      const int r = rows[m];
      const double l = table.linear(r, k);
      out.J(r, k) = S(l);
      value[r] += l * q[k];
    }
  for (const Product& p : table.products) {
    if (p.row >= 3 && !orient) continue;
    const bool square = p.i == p.j;
    const Eigen::Index ni = p.C.rows(), nj = p.C.cols();
    for (Eigen::Index b = 0; b < nj; ++b) {
      const S qb = q[p.j + b], db = dq[p.j + b];
      S left(0), left_dot(0);  // (C^T q_i)_b and (C^T dq_i)_b
      for (Eigen::Index a = 0; a < ni; ++a) {
        const double c = p.C(a, b);
        left += c * q[p.i + a];
        left_dot += c * dq[p.i + a];
        if (!square) out.J(p.row, p.i + a) += c * qb;
      }
      out.J(p.row, p.j + b) += left;
      value[p.row] += square ? 0.5 * (left * qb) : left * qb;
      bias[p.row] += square ? left_dot * db : 2.0 * (left_dot * db);
    }
  }
  for (S& r : rate) r = S(0);
  for (int m = 0; m < moving; ++m)
    for (Eigen::Index k = 0; k < ne; ++k) rate[rows[m]] += out.J(rows[m], k) * dq[k];
  out.x = Vec3<S>(value[0], value[1], value[2]);
  out.u_dot = Vec3<S>(rate[0], rate[1], rate[2]);
  out.u_bias = Vec3<S>(bias[0], bias[1], bias[2]);
  if (!orient) return;
  if (table.plane != Plane::none)
    turn_planar_slice(table.plane, value[rows[2]], rate[rows[2]], out);
  else
    turn_slice(Vec3<S>(value[3], value[4], value[5]), Vec3<S>(rate[3], rate[4], rate[5]),
               Vec3<S>(bias[3], bias[4], bias[5]), out);
}

/// The point at `offset` in a slice's axes, moving with it: a centre of mass, the end of a tip body, the next
/// joint.
template <class S>
void shift_slice(const Slice<S>& at, const Vec3<S>& offset, Slice<S>& out) {
  const Vec3<S> r = at.R * offset;
  out.x = at.x + r;
  out.R = at.R;
  const Vec3<S> swing = at.Omega.cross(r);
  out.u_dot = at.u_dot + swing;
  out.Omega = at.Omega;
  out.u_bias = at.u_bias + at.Omega_bias.cross(r) + at.Omega.cross(swing);
  out.Omega_bias = at.Omega_bias;
  for (Eigen::Index k = 0; k < at.J.cols(); ++k) {
    const Vec3<S> turn = at.J.col(k).template tail<3>();
    out.J.col(k).template tail<3>() = turn;
    out.J.col(k).template head<3>() = at.J.col(k).template head<3>() + turn.cross(r);
  }
}

/// Absolute acceleration of a slice, in link axes, when its link has V, A and elastic accelerations ddq (Eq.
/// 45, 46).
template <class S>
void slice_acceleration(const Slice<S>& at, const Vec6<S>& V, const Vec6<S>& A, const S* ddq, Vec3<S>& a, Vec3<S>& dw) {
  const Vec3<S> w = V.template tail<3>(), w_dot = A.template tail<3>();
  const Vec3<S> sweep = w.cross(at.x) + 2.0 * at.u_dot;
  a = A.template head<3>() + w_dot.cross(at.x) + w.cross(sweep) + at.u_bias;
  dw = w_dot + w.cross(at.Omega) + at.Omega_bias;
  if (ddq == nullptr) return;
  for (Eigen::Index k = 0; k < at.J.cols(); ++k) {
    a += at.J.col(k).template head<3>() * ddq[k];
    dw += at.J.col(k).template tail<3>() * ddq[k];
  }
}

}  // namespace flexarm
