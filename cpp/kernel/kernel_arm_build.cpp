#include <algorithm>
#include <cmath>

#include "lanes/beam_points.hpp"
#include "lanes/kernel_arm.hpp"
#include "lanes/sampled_tables.hpp"

namespace flexarm {
namespace lanes {

namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kAligned = 2.3e-16;  // of a unit vector's components: rounding, with which it is still along an axis

/// The world's axes that an arm moves in.
struct Axes {
  bool planar = false;
  int x = 0, y = 1, z = 2;  ///< of the plane, and about which it turns
  double sign = 1.0;        ///< of a turn about z, seen with x to y as positive
};

/// The axis that a unit vector is along, or -1. By what it has across: what it has along tells no tilt below 1e-8.
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

Matrix3d second_moment_to_inertia(const Matrix3d& Q) { return Q.trace() * Matrix3d::Identity() - Q; }

/// The plane that the whole arm moves in, if there is one.
Axes find_plane(const Arm& arm) {
  for (const Axes axes : {Axes{true, 0, 1, 2, 1.0}, Axes{true, 0, 2, 1, -1.0}, Axes{true, 1, 2, 0, 1.0}}) {
    bool fits = true;
    for (const Link& link : arm.links()) {
      const Joint& joint = link.joint();
      fits = fits && turns_about(joint.inboard().rotation, axes.z) && turns_about(joint.outboard().rotation, axes.z);
      for (const ElementaryMotion& m : joint.motions()) {
        double sign;
        const bool about = aligned(m.axis, sign) == axes.z;
        fits = fits && (m.rotation ? about : std::abs(m.axis[axes.z]) < kAligned);
      }
      if (link.ne() > 0)
        fits =
            fits && link.beam()->tip().plane == (axes.z == 2 ? flexarm::Plane::xy : flexarm::Plane::xz) && axes.x == 0;
    }
    if (fits) return axes;
  }
  return {};
}

/// A rigid body about its frame's origin.
struct Mass {
  double m = 0.0;
  Vector3d c = Vector3d::Zero();
  Matrix3d J = Matrix3d::Zero();

  void add(double mass, const Vector3d& at, const Matrix3d& inertia) {
    m += mass;
    c += mass * at;
    J += inertia + mass * second_moment_to_inertia(at * at.transpose());
  }
  void add(const RigidBody& body, const Vector3d& origin) { add(body.mass, origin + body.com, body.inertia); }
  /// In the axes, and about the origin, of a frame in which its own is at p, turned by R.
  Mass moved(const Matrix3d& R, const Vector3d& p) const {
    Mass out;
    const Vector3d com = m > 0.0 ? Vector3d(c / m) : Vector3d::Zero();
    const Matrix3d own = J - m * second_moment_to_inertia(com * com.transpose());
    out.add(m, p + R * com, R * own * R.transpose());
    return out;
  }
};

/// Sums over a beam's slices of products of functions of X: by the mass of slices.
struct Stations {
  VectorXd mass;          ///< of each slice
  Eigen::Matrix3Xd rest;  ///< e: where it is at rest
  MatrixXd linear;        ///< l of each directed coordinate, by slice
  MatrixXd basis;         ///< columns: orthonormal functions times the root of the mass

  /// Projections of f on the basis.
  VectorXd project(const VectorXd& f) const { return basis.transpose() * (mass.cwiseSqrt().asDiagonal() * f); }
  /// The integral of f g, less what their projections give.
  double rest_of(const VectorXd& f, const VectorXd& g) const {
    return mass.dot(f.cwiseProduct(g)) - project(f).dot(project(g));
  }
};

}  // namespace

struct KernelArm::Builder {
  const Arm& arm;
  Axes axes;
  KernelArm out;
  // what is carried to the next node: from the frame of the last node, or the end of its beam
  Vector3d offset = Vector3d::Zero();
  Matrix3d turn = Matrix3d::Identity();

  explicit Builder(const Arm& a) : arm(a), axes(find_plane(a)) {}

  void put(double x) { out.numbers_.push_back(x); }
  void put(const Vector3d& v) {
    put(v[axes.x]);
    put(v[axes.y]);
    if (!axes.planar) put(v[axes.z]);
  }
  void put(const Matrix3d& R) {  // a rotation
    if (axes.planar) {
      put(R(axes.x, axes.x));
      put(R(axes.y, axes.x));
    } else {
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) put(R(i, j));
    }
  }
  void put_symmetric(const Matrix3d& J) {
    if (axes.planar) {
      put(J(axes.z, axes.z));
    } else {
      for (int i = 0; i < 3; ++i) put(J(i, i));
      put(J(0, 1));
      put(J(0, 2));
      put(J(1, 2));
    }
  }
  void put(const Mass& b) {
    put(b.m);
    put(b.c);
    put_symmetric(b.J);
  }
  void put_lower(const MatrixXd& M) {
    for (Eigen::Index i = 0; i < M.rows(); ++i)
      for (Eigen::Index j = 0; j <= i; ++j) put(M(i, j));
  }

  /// Begins a node where the last one ends.
  Node& begin_node(const Matrix3d& R) {
    Node node;
    node.numbers = out.numbers_.size();
    node.turned = !is_identity(R);
    put(offset);
    if (node.turned) put(R);
    offset.setZero();
    out.nodes_.push_back(node);
    out.lists_.emplace_back();
    return out.nodes_.back();
  }

  void add_motion(const Link& link, std::size_t n, std::size_t i) {
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
    node.kind = motion.rotation ? Node::revolute : Node::prismatic;
    node.sign = sign;
    node.axis = axis;
    if (axes.planar) {
      node.axis = motion.rotation ? 2 : axis == axes.x ? 0 : 1;
      if (motion.rotation) node.sign *= axes.sign;
    }
    node.v = arm.first(n) + static_cast<int>(i);
    node.q = arm.first_q(n) + static_cast<int>(i);
    if (!joint.passive()) return;
    const JointForce& f = joint.forces()[i];
    node.stops = std::isfinite(f.lower) || std::isfinite(f.upper);
    node.passive = node.stops || f.stiffness != 0.0 || f.damping != 0.0 || f.reflected_inertia != 0.0;
    if (!node.passive) return;
    for (double x : {f.stiffness, f.rest, f.damping, f.reflected_inertia}) put(x);
    if (node.stops)
      for (double x : {f.lower, f.upper, f.limit_stiffness, f.limit_damping}) put(x);
  }

  bool add_link(std::size_t n) {
    const Link& link = arm.link(n);
    const Joint& joint = link.joint();
    if (joint.has_ball()) return false;
    offset += turn * joint.inboard().position;
    turn = turn * joint.inboard().rotation;
    for (std::size_t i = 0; i < joint.motions().size(); ++i) add_motion(link, n, i);
    offset += turn * joint.outboard().position;
    turn = turn * joint.outboard().rotation;
    const bool elastic = link.ne() > 0;
    if (joint.motions().empty() || (elastic && !(is_identity(turn) && offset.isZero(0.0)))) {
      begin_node(turn);
      turn.setIdentity();
    }
    return elastic ? add_beam(link, n) : add_body(link);
  }

  bool add_body(const Link& link) {
    Node& node = out.nodes_.back();
    Mass body;
    Vector3d end = link.hub().end;
    body.add(link.hub(), Vector3d::Zero());
    if (link.beam()) {
      for (const MassSlice& s : link.beam()->slices())
        body.add(s.mass, end + s.table.X * Vector3d::UnitX(), s.inertia.asDiagonal());
      end += link.beam()->length() * Vector3d::UnitX();
    }
    body.add(link.tip(), end);
    end += link.tip().end;
    node.body = Node::quadratic;
    put(body.moved(turn, offset));
    offset += turn * end;
    return true;
  }

  // --- beams ---

  bool add_beam(const Link& link, std::size_t n);
  bool add_sampled(const Link& link);
  void put_tip(const Link& link, Node& node);
  void put(const std::vector<double>& numbers) {
    out.numbers_.insert(out.numbers_.end(), numbers.begin(), numbers.end());
  }
  Stations stations(const Link& link, const Node& node) const;
  bool directions(const Beam& beam, Lists& lists) const;
  bool products(const Beam& beam, std::vector<Block>& blocks, int& of_position) const;
  void put_plane(const Link& link, const Stations& at);
  void put_space(const Link& link, const Node& node, const Stations& at);
  void put_end(const Link& link, const Node& node);
};

bool KernelArm::Builder::directions(const Beam& beam, Lists& lists) const {
  std::vector<const SliceTable*> tables{&beam.tip()};
  for (const MassSlice& s : beam.slices()) tables.push_back(&s.table);
  for (int k = 0; k < beam.ne(); ++k) {
    int row = -1;
    for (const SliceTable* t : tables) {
      if (t->linear(0, k) != 0.0) return false;
      for (int r = 1; r < 3; ++r)
        if (t->linear(r, k) != 0.0) {
          if (row >= 0 && row != r) return false;
          row = r;
        }
    }
    int axis = -1;
    for (const SliceTable* t : tables)
      for (int r = 0; r < 3; ++r)
        if (t->linear(3 + r, k) != 0.0) {
          if (axis >= 0 && axis != r) return false;
          axis = r;
        }
    lists.about.push_back(std::max(axis, 0));
    if (row < 0) continue;
    lists.which.push_back(k);
    lists.direction.push_back(row);
  }
  return true;
}

/// Blocks of the beam's products, those of position first; the same for every slice.
bool KernelArm::Builder::products(const Beam& beam, std::vector<Block>& blocks, int& of_position) const {
  const std::vector<Product>& products = beam.tip().products;
  for (const MassSlice& s : beam.slices()) {
    if (s.table.products.size() != products.size()) return false;
    for (std::size_t k = 0; k < products.size(); ++k) {
      const Product &a = products[k], &b = s.table.products[k];
      if (a.row != b.row || a.i != b.i || a.j != b.j || a.C.rows() != b.C.rows() || a.C.cols() != b.C.cols())
        return false;
    }
  }
  for (const bool position : {true, false}) {
    for (const Product& p : products)
      if ((p.row < 3) == position)
        blocks.push_back({p.row, p.i, static_cast<int>(p.C.rows()), p.j, static_cast<int>(p.C.cols())});
    if (position) of_position = static_cast<int>(blocks.size());
  }
  return true;
}

Stations KernelArm::Builder::stations(const Link& link, const Node& node) const {
  const std::vector<MassSlice>& slices = link.beam()->slices();
  const Eigen::Index n = static_cast<Eigen::Index>(slices.size());
  Stations at;
  at.mass.resize(n);
  at.rest.resize(3, n);
  at.linear.resize(n, node.directed);
  for (Eigen::Index g = 0; g < n; ++g) {
    const MassSlice& s = slices[static_cast<std::size_t>(g)];
    at.mass[g] = s.mass;
    at.rest.col(g) = link.hub().end + s.table.X * Vector3d::UnitX();
    for (int d = 0; d < node.directed; ++d) at.linear(g, d) = s.table.linear(node.direction[d], node.which[d]);
  }
  at.basis = basis_of(*link.beam());
  return at;
}

/// Constants of bend() in the plane.
void KernelArm::Builder::put_plane(const Link& link, const Stations& at) {
  const Beam& beam = *link.beam();
  const Eigen::Index ne = beam.ne();
  Mass body;
  body.add(link.hub(), Vector3d::Zero());
  MatrixXd T(static_cast<Eigen::Index>(beam.slices().size()), ne);
  VectorXd inertia(T.rows());
  MatrixXd l = MatrixXd::Zero(T.rows(), ne);
  for (Eigen::Index g = 0; g < T.rows(); ++g) {
    const MassSlice& s = beam.slices()[static_cast<std::size_t>(g)];
    body.add(s.mass, at.rest.col(g), s.inertia.asDiagonal());
    T.row(g) = axes.sign * s.table.linear.row(3 + axes.z);
    l.row(g) = s.table.linear.row(axes.y);
    inertia[g] = s.inertia[axes.z];
  }
  put(body);
  const MatrixXd Lambda = l.transpose() * at.mass.asDiagonal() * l;
  for (Eigen::Index k = 0; k < ne; ++k) {
    put(at.mass.dot(l.col(k)));
    put((at.rest.row(axes.x).transpose().cwiseProduct(at.mass)).dot(l.col(k)));
    put((at.rest.row(axes.y).transpose().cwiseProduct(at.mass)).dot(l.col(k)));
    put(inertia.dot(T.col(k)));
    for (Eigen::Index j = 0; j < ne; ++j) put(Lambda(k, j));
  }
  put_lower(Lambda + T.transpose() * inertia.asDiagonal() * T);
}

/// Constants of bend() in space: of what is linear in the coordinates, less what the points have of it.
void KernelArm::Builder::put_space(const Link& link, const Node& node, const Stations& at) {
  const Eigen::Index ne = node.ne;
  const VectorXd one = VectorXd::Ones(at.mass.size());
  Mass body;
  body.add(link.hub(), Vector3d::Zero());
  body.m += at.mass.sum();
  Matrix3d Q;
  for (int i = 0; i < 3; ++i) {
    body.c[i] += at.rest_of(one, at.rest.row(i));
    for (int j = 0; j < 3; ++j) Q(i, j) = at.rest_of(at.rest.row(i), at.rest.row(j));
  }
  body.J += second_moment_to_inertia(Q);
  put(body);
  MatrixXd Mee = MatrixXd::Zero(ne, ne);
  for (int d = 0; d < node.directed; ++d) {
    put(at.rest_of(one, at.linear.col(d)));
    for (int i = 0; i < 3; ++i) put(at.rest_of(at.rest.row(i), at.linear.col(d)));
    for (int g = 0; g < node.directed; ++g) {
      const double L = at.rest_of(at.linear.col(d), at.linear.col(g));
      put(L);
      if (node.direction[d] == node.direction[g]) Mee(node.which[d], node.which[g]) += L;
    }
  }
  put_lower(Mee);
}

void KernelArm::Builder::put_end(const Link& link, const Node& node) {
  const SliceTable& t = link.beam()->tip();
  const Vector3d rest = link.hub().end + link.beam()->length() * Vector3d::UnitX();
  put(rest);
  if (axes.planar) {
    for (int k = 0; k < node.ne; ++k) {
      put(t.linear(axes.y, k));
      put(axes.sign * t.linear(3 + axes.z, k));
    }
  } else {
    for (int d = 0; d < node.directed; ++d) put(t.linear(node.direction[d], node.which[d]));
    for (int k = 0; k < node.ne; ++k) put(t.linear(3 + node.about[k], k));
  }
  for_products(t.products, true, [&](double c) { put(c); });
  if (!axes.planar) for_products(t.products, false, [&](double c) { put(c); });
}

void KernelArm::Builder::put_tip(const Link& link, Node& node) {
  node.tip = link.tip().mass > 0.0 || !link.tip().inertia.isZero(0.0);
  node.tip_body = out.numbers_.size();
  if (!node.tip) return;
  Mass tip;
  tip.add(link.tip(), Vector3d::Zero());
  put(tip);
}

bool KernelArm::Builder::add_sampled(const Link& link) {
  const Beam& beam = *link.beam();
  Node& node = out.nodes_.back();
  Lists& lists = out.lists_.back();
  describe_sampled(beam, axes.planar, node, lists.about);
  lists.points = beam.series()->points;
  lists.table = integral_table(lists.points, 1);
  const SampledTables tables(link, {axes.planar, axes.y, axes.z, axes.sign}, node, lists.about);
  Mass body;  // of the hub, and what of the beam does not move in it
  body.add(link.hub(), Vector3d::Zero());
  body.m += beam.mass();
  if (axes.planar) body.J(axes.z, axes.z) += tables.rotary();
  put(body);
  if (axes.planar) {
    for (double x : tables.rotary_by()) put(x);
    put_lower(tables.rotary_of_pairs());
  }
  put_lower(beam.stiffness());
  if (node.damped) put_lower(beam.damping());
  put_tip(link, node);
  node.end = node.points = out.numbers_.size();  // the end is one of the points
  put(tables.points());
  offset = link.tip().end;
  turn.setIdentity();
  return true;
}

bool KernelArm::Builder::add_beam(const Link& link, std::size_t n) {
  const Beam& beam = *link.beam();
  Node& node = out.nodes_.back();
  if (beam.order() < 1 || beam.ne() > kMostElastic) return false;
  node.ve = arm.first(n) + link.nj();
  node.qe = arm.first_q(n) + link.joint().nq();
  if (beam.order() > 2) return add_sampled(link);
  Lists& lists = out.lists_.back();
  if (!directions(beam, lists) || !products(beam, lists.blocks, node.position_blocks)) return false;
  node.directed = static_cast<int>(lists.which.size());
  node.blocks = static_cast<int>(lists.blocks.size());
  out.point();
  if (axes.planar)
    for (int k = 0; k < node.position_blocks; ++k)
      if (node.block[k].row != 0) return false;
  node.body = Node::quadratic;
  node.ne = beam.ne();
  node.damped = beam.damped();

  const Stations at = stations(link, node);
  std::vector<std::vector<double>> points(static_cast<std::size_t>(at.basis.cols()));
  const auto to_points = [&](const VectorXd& f) {
    const VectorXd projected = at.project(f);
    for (std::size_t a = 0; a < points.size(); ++a) points[a].push_back(projected[static_cast<Eigen::Index>(a)]);
  };
  if (!points.empty()) {
    to_points(VectorXd::Ones(at.mass.size()));
    for (int i = 0; i < (axes.planar ? 2 : 3); ++i) to_points(at.rest.row(i == 0 ? axes.x : i == 1 ? axes.y : axes.z));
    if (axes.planar) {
      for (int k = 0, d = 0; k < node.ne; ++k)
        to_points(d < node.directed && node.which[d] == k ? VectorXd(at.linear.col(d++))
                                                          : VectorXd::Zero(at.mass.size()));
    } else {
      for (int d = 0; d < node.directed; ++d) to_points(at.linear.col(d));
    }
    std::vector<VectorXd> products;
    for (Eigen::Index g = 0; g < at.mass.size(); ++g) {
      std::size_t k = 0;
      for_products(beam.slices()[static_cast<std::size_t>(g)].table.products, true, [&](double c) {
        if (g == 0) products.push_back(VectorXd::Zero(at.mass.size()));
        products[k++][g] = c;
      });
    }
    for (const VectorXd& f : products) to_points(f);
  }
  std::vector<std::vector<double>> turning;
  if (axes.planar) {
    put_plane(link, at);
  } else {
    // all slices: fewer would do for small turns alone
    for (const MassSlice& s : beam.slices()) {
      const Vector3d I = s.inertia, root = I.cwiseSqrt();
      if (I.isZero(0.0)) continue;
      std::vector<double> p{root[0], root[1], root[2]};
      for (int i = 0; i < 3; ++i) p.push_back(root[i] > 0.0 ? (I[(i + 2) % 3] - I[(i + 1) % 3]) / root[i] : 0.0);
      for (int k = 0; k < node.ne; ++k) p.push_back(s.table.linear(3 + node.about[k], k));
      for_products(s.table.products, false, [&](double c) { p.push_back(c); });
      turning.push_back(std::move(p));
    }
    put_space(link, node, at);
  }
  put_lower(beam.stiffness());
  if (node.damped) put_lower(beam.damping());
  node.end = out.numbers_.size();
  put_end(link, node);
  put_tip(link, node);
  node.points = out.numbers_.size();
  node.passes = static_cast<int>(points.size());
  node.rotary = static_cast<int>(turning.size());
  node.point_numbers = points.empty() ? 0 : points[0].size();
  node.rotary_numbers = turning.empty() ? 0 : turning[0].size();
  for (const auto* group : {&points, &turning})
    for (const std::vector<double>& point : *group)
      for (double x : point) put(x);
  offset = link.tip().end;
  turn.setIdentity();
  return true;
}

std::optional<KernelArm> KernelArm::build(const Arm& arm) {
  Builder b(arm);
  b.put(Vector3d(-arm.gravity()));
  for (std::size_t n = 0; n < arm.size(); ++n)
    if (!b.add_link(n)) return std::nullopt;
  b.out.layout_.planar = b.axes.planar;
  b.out.layout_.nq = arm.nq();
  b.out.layout_.nv = arm.nv();
  b.out.point();
  return b.out;
}

}  // namespace lanes
}  // namespace flexarm
