// Set-up of beams of order 1 and 2 (beam/quadratic.hpp).
#include <algorithm>
#include <stdexcept>

#include "setup/beam_points.hpp"
#include "setup/kernel_arm_builder.hpp"

namespace flexarm {
namespace lanes {

namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

/// Sums over a beam's slices of products of functions of X: by the mass of slices.
struct Stations {
  VectorXd mass;          ///< of each slice
  Eigen::Matrix3Xd rest;  ///< e: where it is at rest
  MatrixXd linear;        ///< l of each directed coordinate, by slice
  MatrixXd basis;         ///< columns: orthonormal functions times the root of the mass

  /// Projections of f on the basis.
  VectorXd project(const VectorXd& f) const { return basis.transpose() * (mass.cwiseSqrt().asDiagonal() * f); }
  /// The integral of f g, less that of their projections.
  double rest_of(const VectorXd& f, const VectorXd& g) const {
    return mass.dot(f.cwiseProduct(g)) - project(f).dot(project(g));
  }
};

/// Coordinates that displace slices, along x, y or z, and the axis about which each turns them. @return whether there
/// is but one
bool find_directions(const Beam& beam, std::vector<int>& which, std::vector<int>& direction, std::vector<int>& about) {
  std::vector<const SliceTable*> tables{&beam.tip()};
  for (const MassSlice& s : beam.slices()) tables.push_back(&s.table);
  for (int k = 0; k < beam.ne(); ++k) {
    int row = -1;
    for (const SliceTable* t : tables) {
      for (int r = 0; r < 3; ++r)
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
    about.push_back(std::max(axis, 0));
    if (row < 0) continue;
    which.push_back(k);
    direction.push_back(row);
  }
  return true;
}

/// Blocks of the beam's products, those of position first; the same for every slice.
bool find_products(const Beam& beam, std::vector<Block>& blocks, int& of_position) {
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

Stations stations(const Link& link, const Node& node) {
  const std::vector<MassSlice>& slices = link.beam()->slices();
  const Eigen::Index n = static_cast<Eigen::Index>(slices.size());
  Stations at;
  at.mass.resize(n);
  at.rest.resize(3, n);
  at.linear.resize(n, node.quadratic.directed);
  for (Eigen::Index g = 0; g < n; ++g) {
    const MassSlice& s = slices[static_cast<std::size_t>(g)];
    at.mass[g] = s.mass;
    at.rest.col(g) = link.hub().end + s.table.X * Vector3d::UnitX();
    for (int d = 0; d < node.quadratic.directed; ++d)
      at.linear(g, d) = s.table.linear(node.quadratic.direction[d], node.quadratic.which[d]);
  }
  at.basis = basis_of(*link.beam());
  return at;
}

/// Constants of bend() in the plane.
void put_plane(ArmBuilder& b, const Link& link, const Stations& at) {
  const Axes& axes = b.axes;
  const Beam& beam = *link.beam();
  const Eigen::Index ne = beam.ne();
  Mass body;
  body.add(link.hub(), Vector3d::Zero());
  MatrixXd T(static_cast<Eigen::Index>(beam.slices().size()), ne);
  VectorXd inertia(T.rows());
  MatrixXd l = MatrixXd::Zero(T.rows(), ne);
  for (Eigen::Index g = 0; g < T.rows(); ++g) {
    const MassSlice& s = beam.slices()[static_cast<std::size_t>(g)];
    body.add(s.mass, at.rest.col(g), s.inertia);
    T.row(g) = axes.sign * s.table.linear.row(3 + axes.z);
    l.row(g) = s.table.linear.row(axes.y);
    inertia[g] = s.inertia(axes.z, axes.z);
  }
  b.put(body);
  const MatrixXd Lambda = l.transpose() * at.mass.asDiagonal() * l;
  for (Eigen::Index k = 0; k < ne; ++k) {
    const auto with = [&](int axis) { return at.rest.row(axis).transpose().cwiseProduct(at.mass).dot(l.col(k)); };
    b.put(records::PlaneCoordinate<double>{at.mass.dot(l.col(k)), with(axes.x), with(axes.y), inertia.dot(T.col(k))});
    for (Eigen::Index j = 0; j < ne; ++j) b.put(Lambda(k, j));
  }
  b.put_lower(Lambda + T.transpose() * inertia.asDiagonal() * T);
}

/// Constants of bend() in space: of the parts linear in the coordinates, less the points' share.
void put_space(ArmBuilder& b, const Link& link, const Stations& at) {
  const Node& node = b.node();
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
  b.put(body);
  MatrixXd Mee = MatrixXd::Zero(ne, ne);
  for (int d = 0; d < node.quadratic.directed; ++d) {
    const auto with = [&](int axis) { return at.rest_of(at.rest.row(axis), at.linear.col(d)); };
    b.put(records::SpaceCoordinate<::Space<double>>{at.rest_of(one, at.linear.col(d)), {with(0), with(1), with(2)}});
    for (int g = 0; g < node.quadratic.directed; ++g) {
      const double L = at.rest_of(at.linear.col(d), at.linear.col(g));
      b.put(L);
      if (node.quadratic.direction[d] == node.quadratic.direction[g])
        Mee(node.quadratic.which[d], node.quadratic.which[g]) += L;
    }
  }
  b.put_lower(Mee);
}

/// Values of the functions at every point: the constant 1, the place at rest, the linear ones and the products.
using Points = std::vector<std::vector<double>>;

Points position_points(const Axes& axes, const Node& node, const Beam& beam, const Stations& at) {
  Points points(static_cast<std::size_t>(at.basis.cols()));
  if (points.empty()) return points;
  const auto project = [&](const VectorXd& f) {
    const VectorXd projected = at.project(f);
    for (std::size_t a = 0; a < points.size(); ++a) points[a].push_back(projected[static_cast<Eigen::Index>(a)]);
  };
  project(VectorXd::Ones(at.mass.size()));
  for (int i = 0; i < (axes.planar ? 2 : 3); ++i) project(at.rest.row(i == 0 ? axes.x : i == 1 ? axes.y : axes.z));
  if (axes.planar) {
    for (int k = 0, d = 0; k < node.ne; ++k)
      project(d < node.quadratic.directed && node.quadratic.which[d] == k ? VectorXd(at.linear.col(d++))
                                                                          : VectorXd::Zero(at.mass.size()));
  } else {
    for (int d = 0; d < node.quadratic.directed; ++d) project(at.linear.col(d));
  }
  std::vector<VectorXd> products;
  for (Eigen::Index g = 0; g < at.mass.size(); ++g) {
    std::size_t k = 0;
    for_products(beam.slices()[static_cast<std::size_t>(g)].table.products, true, [&](double c) {
      if (g == 0) products.push_back(VectorXd::Zero(at.mass.size()));
      products[k++][g] = c;
    });
  }
  for (const VectorXd& f : products) project(f);
  return points;
}

/// Takes all slices: a smaller number of points would be right for small turns only.
Points rotation_points(const Node& node, const Beam& beam) {
  Points points;
  for (const MassSlice& s : beam.slices()) {
    const Vector3d I = s.inertia.diagonal(), root = I.cwiseSqrt();
    if (I.isZero(0.0)) continue;
    std::vector<double> p{root[0], root[1], root[2]};
    for (int i = 0; i < 3; ++i) p.push_back(root[i] > 0.0 ? (I[(i + 2) % 3] - I[(i + 1) % 3]) / root[i] : 0.0);
    for (int k = 0; k < node.ne; ++k) p.push_back(s.table.linear(3 + node.about[k], k));
    for_products(s.table.products, false, [&](double c) { p.push_back(c); });
    points.push_back(std::move(p));
  }
  return points;
}

}  // namespace

void ArmBuilder::find_slices(const Beam& beam) {
  Node& n = node();
  KernelArm::Lists& own = lists();
  bool known = find_directions(beam, own.which, own.direction, own.about) &&
               find_products(beam, own.blocks, n.quadratic.position_blocks) && (beam.order() > 0 || own.blocks.empty());
  n.quadratic.directed = static_cast<int>(own.which.size());
  n.quadratic.blocks = static_cast<int>(own.blocks.size());
  out.point();
  for (const std::vector<int>* list : {&own.which, &own.direction, &own.about}) note(*list);
  for (const Block& b : own.blocks) note({b.row, b.i, b.ni, b.j, b.nj});
  if (axes.planar)
    for (int k = 0; known && k < n.quadratic.position_blocks; ++k)
      known = own.blocks[static_cast<std::size_t>(k)].row == 0;
  if (!known) throw std::logic_error("a beam whose strains move sections in another form than beam/elastic.hpp has");
}

void ArmBuilder::add_quadratic(const Link& link) {
  const Beam& beam = *link.beam();
  find_slices(beam);
  Node& n = node();
  set(n.body, Node::quadratic_beam);
  const Stations at = stations(link, n);
  const Points points = position_points(axes, n, beam, at);
  const Points turning = axes.planar ? Points{} : rotation_points(n, beam);
  if (axes.planar)
    put_plane(*this, link, at);
  else
    put_space(*this, link, at);
  put_stiffness(link);
  begin_end();
  put_end(link);
  put_tip(link);
  begin_points();
  set(n.passes, points.size());
  set(n.rotary, turning.size());
  n.quadratic.point_numbers = points.empty() ? 0 : points[0].size();
  n.quadratic.rotary_numbers = turning.empty() ? 0 : turning[0].size();
  for (const Points* group : {&points, &turning})
    for (const std::vector<double>& point : *group)
      for (double x : point) put(x);
}

}  // namespace lanes
}  // namespace flexarm
