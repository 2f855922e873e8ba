#include "oracle/joint.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace oracle {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using flexarm::JointForce;

namespace {

constexpr double kSoftEntry = 1e-3;  // rad or m past a stop over which its damping sets in

/// The rotation vector of a ball's quaternion, at most pi long.
Vector3d turned(const double* q) {
  const Vector3d e(q[1], q[2], q[3]);
  const double length = e.norm(), sign = q[0] < 0.0 ? -1.0 : 1.0;
  if (length < 1e-150) return Vector3d::Zero();
  return sign * 2.0 * std::atan2(length, sign * q[0]) / length * e;
}

}  // namespace

/// Into a frame turned against this one.
void JointMotion::turn(const Matrix3d& by) {
  const auto out = [&](auto&& x) {
    x.template topRows<3>() = (by.transpose() * x.template topRows<3>()).eval();
    x.template bottomRows<3>() = (by.transpose() * x.template bottomRows<3>()).eval();
  };
  out(V);
  out(c);
  out(H);
  R = R * by;
}

/// To a point at d in this frame.
void JointMotion::shift(const Vector3d& d) {
  p += R * d;
  const Vector3d w = V.tail<3>();
  V.head<3>() += w.cross(d);
  c.head<3>() += c.tail<3>().cross(d) + w.cross(w.cross(d));
  for (Eigen::Index k = 0; k < H.cols(); ++k) H.col(k).head<3>() += H.col(k).tail<3>().cross(d);
}

/// A freedom more, as of a joint on a massless link: V = Phi V + H dq and A = Phi A + H ddq + N (Eq. 68, 69).
void JointMotion::free(bool rotation, const Vector3d& axis, double rate) {
  Vector6d h = Vector6d::Zero();
  (rotation ? h.tail<3>() : h.head<3>()) = axis;
  const Vector3d w = V.tail<3>(), relative = rate * axis;
  if (rotation)
    c.tail<3>() += w.cross(relative);
  else
    c.head<3>() += 2.0 * w.cross(relative);
  V += rate * h;
  H.conservativeResize(6, H.cols() + 1);
  H.col(H.cols() - 1) = h;
}

JointMotion::JointMotion(const flexarm::Joint& joint, const double* q, const double* v) {
  p = joint.inboard().position;
  R = joint.inboard().rotation;
  for (std::size_t i = 0; i < joint.motions().size(); ++i) {
    const flexarm::ElementaryMotion& m = joint.motions()[i];
    if (m.rotation)
      turn(Eigen::AngleAxisd(q[i], m.axis).toRotationMatrix());
    else
      shift(q[i] * m.axis);
    free(m.rotation, m.axis, v[i]);
  }
  if (joint.has_ball()) {
    const std::size_t n = joint.motions().size();
    const Matrix3d e = cross_matrix(Vector3d(q[n + 1], q[n + 2], q[n + 3]));
    const double square = Eigen::Map<const Eigen::Vector4d>(q + n).squaredNorm();
    turn(Matrix3d::Identity() + 2.0 / square * (e * e + q[n] * e));
    const Vector3d w(v[n], v[n + 1], v[n + 2]), before = V.tail<3>();
    for (int k = 0; k < 3; ++k) free(true, Vector3d::Unit(k), 0.0);
    V.tail<3>() += w;
    c.tail<3>() += before.cross(w);
  }
  shift(joint.outboard().position);
  turn(joint.outboard().rotation);
}

double resistance(const flexarm::Joint& joint, int i, const double* q, const double* v) {
  if (!joint.passive()) return 0.0;
  const JointForce& f = joint.forces()[static_cast<std::size_t>(i)];
  double force = f.damping * v[i];
  const auto stop = [&](double depth, double rate) {
    return f.limit_stiffness * depth + f.limit_damping * std::min(std::abs(depth) / kSoftEntry, 1.0) * rate;
  };
  const int n = static_cast<int>(joint.motions().size());
  if (i >= n) {
    const Vector3d t = turned(q + n), w(v[n], v[n + 1], v[n + 2]);
    const double angle = t.norm();
    force += f.stiffness * t[i - n];
    if (angle > f.upper) force += t[i - n] / angle * stop(angle - f.upper, t.dot(w) / angle);
    return force;
  }
  force += f.stiffness * (q[i] - f.rest);
  if (q[i] < f.lower) force += stop(q[i] - f.lower, v[i]);
  if (q[i] > f.upper) force += stop(q[i] - f.upper, v[i]);
  return force;
}

std::pair<double, double> resistance_slopes(const flexarm::Joint& joint, int i, const double* q, const double* v) {
  if (!joint.passive()) return {0.0, 0.0};
  const JointForce& f = joint.forces()[static_cast<std::size_t>(i)];
  double by_q = f.stiffness, by_v = f.damping;
  const auto stop = [&](double depth, double rate) {
    const double entry = std::abs(depth) / kSoftEntry;
    by_q += f.limit_stiffness;
    if (entry < 1.0) by_q += f.limit_damping * rate / std::copysign(kSoftEntry, depth);
    by_v += f.limit_damping * std::min(entry, 1.0);
  };
  const int n = static_cast<int>(joint.motions().size());
  if (i < n) {
    if (q[i] < f.lower) stop(q[i] - f.lower, v[i]);
    if (q[i] > f.upper) stop(q[i] - f.upper, v[i]);
  } else {
    const double depth = turned(q + n).norm() - f.upper;
    if (depth > 0.0) stop(depth, 0.0);
  }
  return {std::max(by_q, 0.0), by_v};
}

double potential(const flexarm::Joint& joint, const double* q) {
  if (!joint.passive()) return 0.0;
  double sum = 0.0;
  const int n = static_cast<int>(joint.motions().size());
  for (int i = 0; i < n + (joint.has_ball() ? 1 : 0); ++i) {
    const JointForce& f = joint.forces()[static_cast<std::size_t>(i)];
    const double at = i < n ? q[i] : turned(q + n).norm(), rest = i < n ? f.rest : 0.0;
    const double depth = std::max(0.0, at - f.upper) + (i < n ? std::max(0.0, f.lower - at) : 0.0);
    sum += 0.5 * f.stiffness * (at - rest) * (at - rest);
    if (depth > 0.0) sum += 0.5 * f.limit_stiffness * depth * depth;
  }
  return sum;
}

}  // namespace oracle
