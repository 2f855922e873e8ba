// Builds a KernelArm from an Arm, node by node; joints and rigid bodies in kernel_arm_build.cpp, each kind of elastic
// body in a file of its own.
#pragma once

#include "setup/kernel_arm.hpp"
#include "setup/written.hpp"

namespace flexarm {
namespace lanes {

/// Inertia of a second moment.
inline Eigen::Matrix3d second_moment_to_inertia(const Eigen::Matrix3d& Q) {
  return Q.trace() * Eigen::Matrix3d::Identity() - Q;
}

/// A rigid body about its frame's origin.
struct Mass {
  double m = 0.0;
  Eigen::Vector3d c = Eigen::Vector3d::Zero();
  Eigen::Matrix3d J = Eigen::Matrix3d::Zero();

  void add(double mass, const Eigen::Vector3d& at, const Eigen::Matrix3d& inertia) {
    m += mass;
    c += mass * at;
    J += inertia + mass * second_moment_to_inertia(at * at.transpose());
  }
  void add(const RigidBody& body, const Eigen::Vector3d& origin) { add(body.mass, origin + body.com, body.inertia); }
  /// In the axes, and about the origin, of a frame in which its own is at p, turned by R.
  Mass moved(const Eigen::Matrix3d& R, const Eigen::Vector3d& p) const {
    Mass out;
    const Eigen::Vector3d com = m > 0.0 ? Eigen::Vector3d(c / m) : Eigen::Vector3d::Zero();
    const Eigen::Matrix3d own = J - m * second_moment_to_inertia(com * com.transpose());
    out.add(m, p + R * com, R * own * R.transpose());
    return out;
  }
};

struct ArmBuilder {
  const Arm& arm;
  Axes axes;
  KernelArm out;
  // the place of the next node: from the frame of its parent, or the end of its beam
  int parent = -1;
  int seat = -1;  ///< the fork on a slice of that beam, where it sits on one
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  double height = 0.0;  ///< of that frame across the plane that the arm moves in

  ArmBuilder(const Arm& a, bool in_space);

  void put(double x) { out.numbers_.push_back(x); }
  void put(const Eigen::Vector3d& v) {
    in_axes(axes, [&](auto to) { put_record(out.numbers_, to.lin(v)); });
  }
  void put(const Eigen::Matrix3d& R) {
    in_axes(axes, [&](auto to) { put_record(out.numbers_, to.rot(R)); });
  }
  template <class Record, class = typename Record::Number>
  void put(const Record& record) {
    put_record(out.numbers_, record);
  }
  void put(const Mass& b) {
    in_axes(axes, [&](auto to) { put(records::Body<decltype(to)>{b.m, to.lin(b.c), to.sym(b.J)}); });
  }
  void put(const std::vector<double>& numbers) {
    out.numbers_.insert(out.numbers_.end(), numbers.begin(), numbers.end());
  }
  void put_lower(const Eigen::MatrixXd& M) {
    for (Eigen::Index i = 0; i < M.rows(); ++i)
      for (Eigen::Index j = 0; j <= i; ++j) put(M(i, j));
  }

  /// Sets a field of a node that arms must share to lie side by side.
  template <class T, class V>
  void set(T& field, V value) {
    field = static_cast<T>(value);
    out.structure_.push_back(static_cast<int>(field));
  }
  /// Of numbers of a body that come next; the structure has where they are in the body.
  void begin_part(std::size_t& at) {
    at = out.numbers_.size();
    out.structure_.push_back(static_cast<int>(at - lists().body[0]));
  }
  void note(const std::vector<int>& list) { out.structure_.insert(out.structure_.end(), list.begin(), list.end()); }
  Node& node() { return out.nodes_.back(); }
  Node& few() { return out.few_.back(); }
  KernelArm::Lists& lists() { return out.lists_.back(); }

  /// Begins a node at that place.
  Node& begin_node(const Eigen::Matrix3d& R);
  /// Begins one in the frame of the last one.
  Node& begin_coincident();
  Node& append(const Node& node);
  void add_link(std::size_t n);
  /// The next node sits where link n does.
  void take_seat(std::size_t n);
  void add_motion(const Link& link, std::size_t n, std::size_t i);
  void add_ball(const Link& link, std::size_t n);
  /// The node's body, one of these.
  void add_rigid(const Link& link);
  void add_beam(const Link& link, std::size_t n);
  void add_quadratic(const Link& link);
  void add_cut(const Link& link);
  void add_sampled(const Link& link);

  // parts that all beams have, in the order of their numbers, behind the constants of the inertia
  /// Their shape functions. @throws std::logic_error where it has not the forms of beam/elastic.hpp
  void find_slices(const Beam& beam);
  void put_stiffness(const Link& link);
  void begin_end() { begin_part(node().end); }  ///< the slice there
  void put_end(const Link& link);               ///< the slice there, for quadratic.hpp
  void put_tip(const Link& link);
  void begin_points() { begin_part(node().points); }  ///< of which kernels may take several at once
};

}  // namespace lanes
}  // namespace flexarm
