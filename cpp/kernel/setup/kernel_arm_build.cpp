// Set-up of joints and rigid bodies.
#include "setup/kernel_arm_builder.hpp"

#include <algorithm>
#include <cmath>

namespace flexarm {
namespace lanes {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kAligned = 2.3e-16;  // of a unit vector's components: rounding, with which it is still along an axis

/// The axis that a unit vector is along, or -1. Decided by its parts across: the part along shows no tilt below 1e-8.
int aligned(const Vector3d& axis, double& sign) {
  for (int k = 0; k < 3; ++k)
    if (std::abs(axis[(k + 1) % 3]) < kAligned && std::abs(axis[(k + 2) % 3]) < kAligned) {
      sign = axis[k] > 0.0 ? 1.0 : -1.0;
      return k;
    }
  return -1;
}

bool is_identity(const Matrix3d& R) { return (R - Matrix3d::Identity()).cwiseAbs().maxCoeff() == 0.0; }
bool turns_about(const Matrix3d& R, int z) {
  double sign = 0.0;
  return aligned(R.col(z), sign) == z && sign > 0.0;
}

/// Whether a loop is one of an arm that moves square to z.
bool moves_in(const Loop& loop, int z) {
  double sign;
  for (const Loop::Side& side : {loop.a, loop.b}) {
    bool has_z = false;
    for (int k = 0; k < 3; ++k) has_z = has_z || aligned(side.axes.col(k), sign) == z;
    if (!has_z) return false;
  }
  return true;
}

/// The plane that the whole arm moves in, if there is one.
Axes find_plane(const Arm& arm) {
  for (const Axes axes : {Axes{true, 0, 1, 2, 1.0}, Axes{true, 0, 2, 1, -1.0}, Axes{true, 1, 2, 0, 1.0}}) {
    bool fits = true;
    for (const Link& link : arm.links()) {
      const Joint& joint = link.joint();
      fits = fits && !joint.has_ball() && turns_about(joint.inboard().rotation, axes.z) &&
             turns_about(joint.outboard().rotation, axes.z);
      for (const ElementaryMotion& m : joint.motions()) {
        double sign;
        const bool about = aligned(m.axis, sign) == axes.z;
        fits = fits && (m.rotation ? about : std::abs(m.axis[axes.z]) < kAligned);
      }
      if (link.beam() && link.ne() == 0) fits = fits && turns_about(link.beam()->tip().rest.R, axes.z);
      if (link.ne() > 0)
        fits =
            fits && link.beam()->tip().plane == (axes.z == 2 ? flexarm::Plane::xy : flexarm::Plane::xz) && axes.x == 0;
    }
    for (std::size_t n = 0; n < arm.size() && fits; ++n) {
      if (!arm.at(n)) continue;
      const Link& on = arm.link(static_cast<std::size_t>(arm.parent(n)));
      if (on.ne() == 0) fits = turns_about(on.slice_at(*arm.at(n)).rest.R, axes.z);
    }
    for (const Loop& loop : arm.loops()) fits = fits && moves_in(loop, axes.z);
    if (fits) return axes;
  }
  return {};
}

}  // namespace

ArmBuilder::ArmBuilder(const Arm& a, bool in_space) : arm(a), axes(in_space ? Axes{} : find_plane(a)) {
  set(out.layout_.planar, axes.planar);
  set(out.layout_.along[0], axes.x);
  set(out.layout_.along[1], axes.y);
  set(out.layout_.about, axes.z);
  set(out.layout_.turning, axes.sign);
}

Node& ArmBuilder::begin_node(const Matrix3d& R) {
  Node node;
  set(node.parent, parent);
  set(node.seat, seat);
  set(node.numbers, out.numbers_.size());
  set(node.turned, !is_identity(R));
  out.heights_.push_back(height + offset[axes.z]);
  height = out.heights_.back();
  put(offset);
  if (node.turned) put(R);
  offset.setZero();
  return append(node);
}

Node& ArmBuilder::begin_coincident() {
  Node node;
  set(node.parent, parent);
  set(node.numbers, out.numbers_.size());
  set(node.coincident, true);
  out.heights_.push_back(height);
  return append(node);
}

Node& ArmBuilder::append(const Node& node) {
  out.nodes_.push_back(node);
  out.lists_.emplace_back();
  out.few_.emplace_back();
  parent = static_cast<int>(out.nodes_.size()) - 1;
  seat = -1;
  return out.nodes_.back();
}

void ArmBuilder::add_motion(const Link& link, std::size_t n, std::size_t i) {
  const Joint& joint = link.joint();
  const ElementaryMotion& motion = joint.motions()[i];
  double sign = 1.0;
  int axis = aligned(motion.axis, sign);
  Matrix3d align = Matrix3d::Identity();  // its axis along a coordinate axis
  if (axis < 0) {
    motion.axis.cwiseAbs().maxCoeff(&axis);  // the smallest turn: one by nearly pi loses its digits
    sign = motion.axis[axis] < 0.0 ? -1.0 : 1.0;
    align = Eigen::Quaterniond::FromTwoVectors(Vector3d::Unit(axis), sign * motion.axis).toRotationMatrix();
  }
  Node& node = begin_node(turn * align);
  turn = align.transpose();
  if (axes.planar) {
    axis = motion.rotation ? 2 : axis == axes.x ? 0 : 1;
    if (motion.rotation) sign *= axes.sign;
  }
  set(node.kind, motion.rotation ? Node::revolute : Node::prismatic);
  set(node.axis, axis);
  set(node.sign, sign);
  set(node.v, arm.first(n) + static_cast<int>(i));
  set(node.q, arm.first_q(n) + static_cast<int>(i));
  if (!joint.passive()) return;
  const JointForce& f = joint.forces()[i];
  set(node.stops, std::isfinite(f.lower) || std::isfinite(f.upper));
  set(node.passive, node.stops || f.stiffness != 0.0 || f.damping != 0.0 || f.reflected_inertia != 0.0);
  if (!node.passive) return;
  put(records::Spring<double>{f.stiffness, f.rest, f.damping, f.reflected_inertia});
  if (node.stops) put(records::Stops<double>{f.lower, f.upper, f.limit_stiffness, f.limit_damping});
}

void ArmBuilder::add_ball(const Link& link, std::size_t n) {
  const Joint& joint = link.joint();
  const std::size_t before = joint.motions().size();
  std::vector<JointForce> forces(3);
  if (joint.passive())
    std::copy(joint.forces().begin() + static_cast<std::ptrdiff_t>(before), joint.forces().end(), forces.begin());
  bool passive = false;
  for (const JointForce& f : forces)
    passive = passive || std::isfinite(f.upper) || f.stiffness != 0.0 || f.damping != 0.0 || f.reflected_inertia != 0.0;
  for (int k = 0; k < 3; ++k) {
    Node& one = k == 0 ? begin_node(turn) : begin_coincident();
    set(one.ball, k == 0);
    set(one.kind, Node::revolute);
    set(one.axis, k);
    set(one.q, arm.first_q(n) + static_cast<int>(before));
    set(one.v, arm.first(n) + static_cast<int>(before) + k);
    set(one.passive, passive);
    set(one.stops, std::isfinite(forces[0].upper));
    if (k > 0 || !passive) continue;
    const JointForce &x = forces[0], &y = forces[1], &z = forces[2];
    put(records::BallSpring<double>{x.stiffness,
                                    {x.damping, x.reflected_inertia},
                                    {y.damping, y.reflected_inertia},
                                    {z.damping, z.reflected_inertia}});
    if (one.stops) put(records::BallStop<double>{x.upper, x.limit_stiffness, x.limit_damping});
  }
  turn.setIdentity();
}

void ArmBuilder::take_seat(std::size_t n) {
  Placement at;
  parent = -1;
  if (arm.parent(n) >= 0) {
    const auto on = static_cast<std::size_t>(arm.parent(n));
    const KernelArm::Seat& of = out.seats_[on];
    parent = of.node;
    if (!arm.at(n)) {
      at = of.end;
    } else if (const SliceTable slice = arm.link(on).slice_at(*arm.at(n)); arm.link(on).ne() == 0) {
      at = out.at_rest(arm.link(on), of, slice);
    } else {
      out.point();
      seat = out.fork_on(out.slice(arm, on, slice));
    }
  }
  offset = at.position;
  turn = at.rotation;
  height = 0.0;
  if (parent < 0) return;
  height = out.heights_[static_cast<std::size_t>(parent)];
  if (out.nodes_[static_cast<std::size_t>(parent)].ne > 0)
    height += arm.link(static_cast<std::size_t>(arm.parent(n))).hub().end[axes.z];
}

void ArmBuilder::add_link(std::size_t n) {
  const Link& link = arm.link(n);
  const Joint& joint = link.joint();
  take_seat(n);
  offset += turn * joint.inboard().position;
  turn = turn * joint.inboard().rotation;
  for (std::size_t i = 0; i < joint.motions().size(); ++i) add_motion(link, n, i);
  if (joint.has_ball()) add_ball(link, n);
  offset += turn * joint.outboard().position;
  turn = turn * joint.outboard().rotation;
  const bool elastic = link.ne() > 0;
  if (joint.nv() == 0 || (elastic && !(is_identity(turn) && offset.isZero(0.0)))) {
    begin_node(turn);
    turn.setIdentity();
  }
  KernelArm::Seat own;
  own.node = static_cast<int>(out.nodes_.size()) - 1;
  own.origin = {offset, turn};
  own.origin_spot = out.fixed(own.node, Place::frame, own.origin);
  if (elastic)
    add_beam(link, n);
  else
    add_rigid(link);
  own.end = {offset, turn};
  own.end_spot = out.fixed(own.node, Place::end, own.end);
  out.seats_.push_back(own);
}

void ArmBuilder::add_rigid(const Link& link) {
  Mass body;
  Vector3d end = link.hub().end;
  Matrix3d R = Matrix3d::Identity();
  body.add(link.hub(), Vector3d::Zero());
  if (link.beam()) {
    for (const MassSlice& s : link.beam()->slices()) {
      const SliceAtRest at = s.at_rest();
      body.add(s.mass, end + at.x, at.R * s.inertia * at.R.transpose());
    }
    end += link.beam()->tip().rest.x;
    R = link.beam()->tip().rest.R;
  }
  body.add(link.tip().mass, end + R * link.tip().com, R * link.tip().inertia * R.transpose());
  end += R * link.tip().end;
  set(node().body, Node::rigid);
  put(body.moved(turn, offset));
  offset += turn * end;
  turn = turn * R;
}

void ArmBuilder::add_beam(const Link& link, std::size_t n) {
  const Beam& beam = *link.beam();
  lists().body[0] = out.numbers_.size();
  lists().structure[0] = out.structure_.size();
  set(node().ne, beam.ne());
  set(node().ve, arm.first(n) + link.nj());
  set(node().qe, arm.first_q(n) + link.joint().nq());
  set(node().stretching, beam.options().modes[extension]);
  set(node().damped, beam.damped());
  beam.order() == 0 ? add_cut(link) : beam.order() <= 2 ? add_quadratic(link) : add_sampled(link);
  lists().body[1] = out.numbers_.size();
  lists().structure[1] = out.structure_.size();
  offset = link.tip().end;
  turn.setIdentity();
}

void ArmBuilder::put_stiffness(const Link& link) {
  put_lower(link.beam()->stiffness());
  if (node().damped) put_lower(link.beam()->damping());
}

void ArmBuilder::put_end(const Link& link) {
  const Vector3d rest = link.hub().end + link.beam()->length() * Vector3d::UnitX();
  put_slice(out.layout_, node(), rest, link.beam()->tip(), out.numbers_);
}

void ArmBuilder::put_tip(const Link& link) {
  set(node().tip, link.tip().mass > 0.0 || !link.tip().inertia.isZero(0.0));
  begin_part(node().tip_body);
  if (!node().tip) return;
  Mass tip;
  tip.add(link.tip(), Vector3d::Zero());
  put(tip);
}

void KernelArm::find_branches() {
  for (std::size_t k = 1; k < nodes_.size(); ++k) {
    Node& node = nodes_[k];
    node.branch = node.seat >= 0 || node.parent != static_cast<int>(k) - 1;
    layout_.branched = layout_.branched || node.branch;
    if (node.branch && node.seat < 0 && node.parent >= 0) node.seat = fork_on({{Place::end, node.parent}, {}});
  }
}

KernelArm KernelArm::build(const Arm& arm, bool in_space) {
  ArmBuilder b(arm, in_space);
  b.put(Vector3d(-arm.gravity()));
  for (std::size_t n = 0; n < arm.size(); ++n) b.add_link(n);
  b.out.find_branches();
  b.out.put_struts(arm);
  b.out.put_contacts(arm);
  b.out.put_loops(arm);
  b.set(b.out.layout_.nq, arm.nq());
  b.set(b.out.layout_.nv, arm.nv());
  b.out.structure_.push_back(static_cast<int>(b.out.numbers_.size()));
  b.out.point();
  return b.out;
}

}  // namespace lanes
}  // namespace flexarm
