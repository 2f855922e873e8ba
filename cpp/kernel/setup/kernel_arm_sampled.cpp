#include <algorithm>
#include <cmath>

#include "setup/kernel_arm_builder.hpp"
#include "setup/sampled_tables.hpp"
#include "shape_tables.hpp"

namespace flexarm {
namespace lanes {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

bool at_point(const MassSlice& s) { return s.table.point >= 0; }
int dimensions(bool planar) { return planar ? 2 : 3; }
/// Numbers of a slice besides its place and weights.
int turns(const Node& node, bool planar) {
  return planar                  ? node.sampled.curved + node.ne
         : node.sampled.uniaxial ? node.sampled.curved + node.sampled.turning
                                 : 0;
}
/// Rows of the curvature at rest.
int rest_rows(const Node& node, bool planar) {
  return node.sampled.curved ? (planar || node.sampled.uniaxial ? 1 : 7) : 0;
}

void append(std::vector<double>& out, const VectorXd& x) { out.insert(out.end(), x.data(), x.data() + x.size()); }

}  // namespace

const StrainField& strain_of(const Beam& beam, int coordinate) {
  int s = kStrains - 1;
  while (beam.first(s) > coordinate || beam.options().modes[static_cast<std::size_t>(s)] == 0) --s;
  return kStrainFields[s];
}

void describe_sampled(const Beam& beam, bool planar, Node& node, std::vector<int>& about) {
  node.body = Node::sampled_beam;
  node.sampled.exact = beam.order() == kExact;
  for (int k = 0; k < node.ne; ++k) {
    const StrainField& f = strain_of(beam, k);
    if (f.is_curvature()) ++node.sampled.turning;  // these come first (Eq. 33)
    about.push_back(f.is_curvature() ? f.rotation : f.position);
  }
  node.sampled.curved = beam.curved();
  node.sampled.uniaxial = node.sampled.exact && std::all_of(about.begin(), about.begin() + node.sampled.turning,
                                                            [&](int axis) { return axis == about.front(); });
  if (node.sampled.curved)
    node.sampled.uniaxial = node.sampled.uniaxial && node.sampled.turning > 0 && beam.curved_about(about.front());
  node.sampled.half = (beam.points() + 1) / 2;
  node.passes = node.sampled.half + 1;  // with X = 0, or the end
  for (const MassSlice& s : beam.slices()) {
    if (!planar && !s.inertia.isZero(0.0)) node.rotary = std::max(node.rotary, 3);
    if (!s.com.isZero(0.0) || (!planar && !s.inertia.isDiagonal(0.0))) node.rotary = 9;
    if (!at_point(s)) ++node.sampled.further;
    node.sampled.points_have_mass = node.sampled.points_have_mass || at_point(s);
  }
  node.sampled.further_passes = node.sampled.further;
}

SampledTables::SampledTables(const Link& link, const Axes& axes, const Node& node, const std::vector<int>& about)
    : link_(link), beam_(*link.beam()), axes_(axes), node_(node), about_(about) {}

/// In the order of the points, of a function at X = 0, the points, and the end. The middle one of an odd number is
/// there twice, and the sums are shared.
VectorXd SampledTables::of_points(const VectorXd& f, bool shared) const {
  const Index half = node_.sampled.half;
  VectorXd out(2 * (half + 1));
  out << f.segment(1, half), f.head(1), f.reverse().segment(1, half), f.tail(1);
  if (shared && f.size() % 2 == 1) out[half - 1] = out[2 * half] = 0.5 * out[half - 1];
  return out;
}

/// About the one axis.
double SampledTables::turn_at_rest(const SliceAtRest& rest) const {
  return axes_.planar ? axes_.sign * rest.theta[axes_.z] : rest.theta[about_.front()];
}

/// The slices that carry the inertia; or at other points than the beam's the same, whose section is uniform.
std::vector<MassSlice> SampledTables::stations(const std::vector<SliceTable>& tables) const {
  const int n = PointTables::points(tables);
  if (n == beam_.points()) return beam_.slices();
  const VectorXd parts = GaussRule(n).weights;
  const MassSlice& one = beam_.slices().front();
  std::vector<MassSlice> out;
  for (int i = 0; i < n; ++i) {
    const double mass = parts[i] * beam_.mass();
    out.push_back({tables[static_cast<std::size_t>(i + 1)], mass, one.com,
                   one.inertia * (one.mass > 0.0 ? mass / one.mass : 0.0)});
    out.back().table.point = i;
  }
  return out;
}

std::vector<double> SampledTables::points(const std::vector<SliceTable>& tables) const {
  const std::vector<MassSlice> slices = stations(tables);
  const Index n = static_cast<Index>(tables.size());
  const double L = beam_.length();
  const Vector3d& origin = link_.hub().end;
  std::vector<double> out;
  in_axes(axes_, [&](auto to) { put_record(out, records::Span<decltype(to)>{L, to.lin(origin)}); });
  const auto rows = [&](const auto& value) {
    for (int k = 0; k < node_.ne; ++k) {
      VectorXd row(n);
      for (Index j = 0; j < n; ++j) row[j] = value(tables[static_cast<std::size_t>(j)], k);
      append(out, of_points(row, false));
    }
  };
  rows([&](const SliceTable& t, int k) {
    if (axes_.planar && k < node_.sampled.turning) return axes_.sign * t.linear(3 + axes_.z, k);
    return (axes_.planar ? 1.0 : L) * t.strains(strain_of(beam_, k).strain, k);
  });
  if (!axes_.planar)
    rows([&](const SliceTable& t, int k) {
      return k < node_.sampled.turning ? t.linear(3 + about_[static_cast<std::size_t>(k)], k) : 0.0;
    });
  for (int row = 0; row < rest_rows(node_, axes_.planar); ++row) {
    const bool one = axes_.planar || node_.sampled.uniaxial;
    VectorXd values(n);
    for (Index j = 0; j < n; ++j) {
      const SliceAtRest& rest = tables[static_cast<std::size_t>(j)].rest;
      values[j] = one ? turn_at_rest(rest) : row < 3 ? L * rest.K[row] : rest.p[row - 3] - (row == 3 ? 1.0 : 0.0);
    }
    append(out, of_points(values, false));
  }
  // masses, inertia and centres of mass: those of the points, then others
  const auto of_stations = [&](bool summed, const auto& value) {
    VectorXd at = VectorXd::Zero(n);  // nothing at the ends
    std::vector<double> others;
    for (const MassSlice& s : slices) {
      if (at_point(s))
        at[1 + s.table.point] = value(s);
      else
        others.push_back(value(s));
    }
    append(out, of_points(at, summed));
    out.insert(out.end(), others.begin(), others.end());
  };
  of_stations(true, [](const MassSlice& s) { return s.mass; });
  constexpr int entry[][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}};
  for (int c = 0; c < node_.rotary; ++c)
    of_stations(c < 6, [&](const MassSlice& s) { return c < 6 ? s.inertia(entry[c][0], entry[c][1]) : s.com[c - 6]; });
  for (const MassSlice& s : slices)
    if (!at_point(s)) {
      const std::vector<double> numbers = slice(s.table);
      out.insert(out.end(), numbers.begin(), numbers.end());
    }
  return out;
}

std::vector<double> SampledTables::slice(const SliceTable& at) const {
  std::vector<double> out;
  in_axes(axes_, [&](auto to) { put_record(out, to.lin(link_.hub().end)); });
  VectorXd weights = VectorXd::Zero(at.weights.size() + 2);
  weights.segment(1, at.weights.size()) = at.weights.transpose() / beam_.length();
  append(out, of_points(weights, true));
  const bool planar = axes_.planar;
  if (node_.sampled.curved && (planar || node_.sampled.uniaxial)) out.push_back(turn_at_rest(at.rest));
  for (int k = 0; k < turns(node_, planar) - node_.sampled.curved; ++k)
    out.push_back(planar ? axes_.sign * at.linear(3 + axes_.z, k) : at.linear(3 + about_.front(), k));
  return out;
}

double SampledTables::rotary() const {
  double sum = 0.0;
  for (const MassSlice& s : beam_.slices()) sum += s.inertia(axes_.z, axes_.z);
  return sum;
}
VectorXd SampledTables::rotary_by() const {
  VectorXd sum = VectorXd::Zero(node_.ne);
  for (const MassSlice& s : beam_.slices())
    sum += axes_.sign * s.inertia(axes_.z, axes_.z) * s.table.linear.row(3 + axes_.z).transpose();
  return sum;
}
MatrixXd SampledTables::rotary_of_pairs() const {
  MatrixXd sum = MatrixXd::Zero(node_.ne, node_.ne);
  for (const MassSlice& s : beam_.slices()) {
    const VectorXd turn = s.table.linear.row(3 + axes_.z);
    sum += s.inertia(axes_.z, axes_.z) * turn * turn.transpose();
  }
  return sum;
}

namespace {

Numbers make_integral_table(int points, int width) {
  const GaussRule rule(points);
  MatrixXd C(points, points);  // row i: weights of the integral from 0 to X_i
  for (Index i = 0; i < points; ++i) C.row(i) = integral_weights(rule, 1.0, rule.points[i]);
  const int half = (points + 1) / 2, rows = (half + width) / width * width;
  Numbers out;
  for (Index j = 0; j < half; ++j) {
    const Index mirror = points - 1 - j;
    const double share = j == mirror ? 0.5 : 1.0;  // the middle one is there twice
    const auto column = [&](const auto& value, double beyond) {
      for (Index i = 0; i < rows; ++i)
        out.push_back(i < half ? share * value(i, points - 1 - i) : i == half ? share * beyond : 0.0);
    };
    column([&](Index i, Index m) { return 0.25 * ((C(m, j) + C(m, mirror)) - (C(i, j) + C(i, mirror))); },
           0.5 * rule.weights[j]);
    column([&](Index i, Index m) { return 0.25 * ((C(i, j) - C(i, mirror)) + (C(m, j) - C(m, mirror))); }, 0.0);
  }
  return out;
}

}  // namespace

std::shared_ptr<const Numbers> integral_table(int points, int width) {
  static auto& kept = *new Kept<Numbers>(std::size_t(8) << 20);  // never destroyed: a thread may be at it at the end
  return kept.get(
      std::to_string(points) + "," + std::to_string(width),
      [&] { return std::make_shared<const Numbers>(make_integral_table(points, width)); },
      [](const Numbers& x) { return 8 * x.size(); });
}

namespace {

/// Numbers that all points share, in each lane.
void repeat(int count, int width, const double*& p, Numbers& out) {
  for (; count > 0; --count, ++p) out.insert(out.end(), static_cast<std::size_t>(width), *p);
}
/// So many numbers, filled up with zeros to so many.
void fill_up(int count, int all, const double*& p, Numbers& out) {
  out.insert(out.end(), p, p + count);
  out.insert(out.end(), static_cast<std::size_t>(all - count), 0.0);
  p += count;
}

}  // namespace

void group_points(const Node& from, const Node& to, bool planar, int width, const double*& p, Numbers& out) {
  repeat(1 + dimensions(planar), width, p, out);
  const auto points = [&] {
    for (int k = 0; k < 2; ++k) fill_up(from.passes, to.passes * width, p, out);
  };
  for (int k = 0; k < (planar ? 1 : 2) * from.ne + rest_rows(from, planar); ++k) points();
  for (int k = 0; k < 1 + from.rotary; ++k) {
    points();
    fill_up(from.sampled.further, to.sampled.further_passes * width, p, out);
  }
  for (int k = 0; k < from.sampled.further; ++k) group_slice(from, to, planar, width, p, out);
}

void group_slice(const Node& from, const Node& to, bool planar, int width, const double*& p, Numbers& out) {
  fill_up(dimensions(planar), dimensions(planar), p, out);
  for (int k = 0; k < 2; ++k) fill_up(from.passes, to.passes * width, p, out);
  fill_up(turns(from, planar), turns(from, planar), p, out);
}

void ArmBuilder::add_sampled(const Link& link) {
  const Beam& beam = *link.beam();
  KernelArm::Lists& list = lists();
  describe_sampled(beam, axes.planar, node(), list.about);
  list.points = beam.points();
  list.table = integral_table(list.points, 1);
  const Node& n = node();
  note(list.about);
  note({n.body, n.sampled.exact, n.sampled.turning, n.sampled.further, n.sampled.points_have_mass, n.sampled.curved,
        n.sampled.uniaxial, n.rotary, list.points});
  const SampledTables tables(link, axes, n, list.about);
  Mass body;  // of the hub, and of the beam's part that does not move in it
  body.add(link.hub(), Vector3d::Zero());
  body.m += beam.mass();
  if (axes.planar) body.J(axes.z, axes.z) += tables.rotary();
  put(body);
  if (axes.planar) {
    for (double x : tables.rotary_by()) put(x);
    put_lower(tables.rotary_of_pairs());
  }
  put_stiffness(link);
  put_tip(link);
  const PointTables& at = PointTables::of(beam);
  begin_part(node().bounds);
  for (double x : at.bounds) put(x);
  begin_points();  // of which the end is one
  put(tables.points(at.all));
  set(list.few_points, at.few.empty() ? 0 : PointTables::points(at.few));
  if (list.few_points == 0) return;
  list.few_table = integral_table(list.few_points, 1);
  few() = node();
  few().sampled.half = list.few_points / 2;
  few().passes = few().sampled.half + 1;
  begin_part(few().points);
  put(SampledTables(link, axes, few(), list.about).points(at.few));
}

}  // namespace lanes
}  // namespace flexarm
