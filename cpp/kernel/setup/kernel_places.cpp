// Places on an arm: of loads, sensors and frames, in the kernels' numbers.
#include <algorithm>
#include <cstdint>

#include "setup/beam_points.hpp"
#include "setup/kernel_arm.hpp"
#include "setup/sampled_tables.hpp"
#include "setup/written.hpp"

namespace flexarm {
namespace lanes {

using Eigen::Vector3d;

void put_slice(const Layout& layout, const Node& node, const Vector3d& rest, const SliceTable& table, Numbers& out) {
  in_axes(axes_of(layout), [&](auto to) { put_record(out, to.lin(rest)); });
  if (layout.planar) {
    for (int k = 0; k < node.ne; ++k) {
      put_record(out, records::PlaneSlope<double>{table.linear(layout.along[1], k),
                                                  layout.turning * table.linear(3 + layout.about, k)});
    }
  } else {
    for (int d = 0; d < node.quadratic.directed; ++d)
      out.push_back(table.linear(node.quadratic.direction[d], node.quadratic.which[d]));
    for (int k = 0; k < node.ne; ++k) out.push_back(table.linear(3 + node.about[k], k));
  }
  for (const bool position : {true, false})
    if (position || !layout.planar) for_products(table.products, position, [&](double c) { out.push_back(c); });
}

KernelArm::Spot KernelArm::fixed(int node, Place::On on, const Placement& at) const {
  Spot spot{{on, node}, {}};
  in_axes(axes_of(layout_), [&](auto to) {
    put_record(spot.numbers, records::Seat<decltype(to)>{to.lin(at.position), to.rot(at.rotation)});
  });
  return spot;
}

Placement KernelArm::at_rest(const Link& link, const Seat& seat, const SliceTable& table) const {
  const Placement& origin = seat.origin;
  return {origin.position + origin.rotation * (link.hub().end + table.rest.x), origin.rotation * table.rest.R};
}

KernelArm::Spot KernelArm::slice(const Arm& arm, std::size_t link, const SliceTable& table) const {
  const Seat& seat = seats_[link];
  const Node& node = nodes_[static_cast<std::size_t>(seat.node)];
  const Vector3d rest = arm.link(link).hub().end + table.rest.x;
  if (node.ne == 0) return fixed(seat.node, Place::frame, at_rest(arm.link(link), seat, table));
  Spot spot{{Place::slice, seat.node}, {}};
  if (node.body == Node::sampled_beam) {
    const Lists& lists = lists_[static_cast<std::size_t>(seat.node)];
    for (double x : SampledTables(arm.link(link), axes_of(layout_), node, lists.about).slice(table))
      spot.numbers.push_back(x);
  } else {
    put_slice(layout_, node, rest, table, spot.numbers);
  }
  return spot;
}

KernelArm::Spot KernelArm::seat(const Arm& arm, std::size_t link) const {
  const auto on = static_cast<std::size_t>(arm.parent(link));
  const std::optional<double>& at = arm.at(link);
  return at ? slice(arm, on, arm.link(on).slice_at(*at)) : end(on);
}

int KernelArm::fork_on(const Spot& spot) {
  for (std::size_t k = 0; k < forks_.size(); ++k) {
    const PlacedFork& f = forks_[k];
    const double* p = place_numbers_.data() + f.numbers;
    if (f.place.on == spot.place.on && f.place.node == spot.place.node &&
        std::equal(spot.numbers.begin(), spot.numbers.end(), p, p + f.size))
      return static_cast<int>(k);
  }
  const auto n = static_cast<int>(forks_.size());
  const auto node = static_cast<std::size_t>(spot.place.node);
  forks_.push_back({spot.place, place_numbers_.size(), spot.numbers.size()});
  place_numbers_.insert(place_numbers_.end(), spot.numbers.begin(), spot.numbers.end());
  if (spot.place.on == Place::slice) {
    lists_[node].slices.push_back(n);
    few_[node].sampled.half = 0;  // as in `loaded`
  } else {
    nodes_[node].fork = n;
  }
  return n;
}

double KernelArm::height(const Arm& arm, const flexarm::Strut::Point& point) const {
  const Axes axes = axes_of(layout_);
  if (!layout_.planar) return 0.0;
  if (point.link < 0) return point.offset[axes.z];
  const std::size_t link = static_cast<std::size_t>(point.link);
  const Seat& seat = seats_[link];
  const std::size_t node = static_cast<std::size_t>(seat.node);
  double sum = heights_[node] + point.offset[axes.z];
  const bool own = point.on == flexarm::Strut::Point::origin, end = point.on == flexarm::Strut::Point::end;
  if (own || (!end && nodes_[node].ne == 0)) sum += seat.origin.position[axes.z];
  if (end) sum += seat.end.position[axes.z];
  if ((end && nodes_[node].ne > 0) || point.on == flexarm::Strut::Point::slice) sum += arm.link(link).hub().end[axes.z];
  return sum;
}

void KernelArm::put_tied(std::size_t numbers, const Spot& spot) {
  tied_.push_back({spot.place, numbers});
  tied_sizes_.push_back(spot.numbers.size());
  tied_numbers_.insert(tied_numbers_.end(), spot.numbers.begin(), spot.numbers.end());
  structure_.push_back(spot.place.on);
  structure_.push_back(spot.place.node);
  if (spot.place.node >= 0) nodes_[static_cast<std::size_t>(spot.place.node)].tied = true;
}

void KernelArm::put_struts(const Arm& arm) {
  using Point = flexarm::Strut::Point;
  for (const flexarm::Strut& strut : arm.struts()) {
    struts_.push_back({static_cast<int>(strut.points.size()), strut.tension_only, tied_numbers_.size()});
    structure_.push_back(strut.tension_only);
    structure_.push_back(static_cast<int>(strut.points.size()));
    put_record(tied_numbers_, records::StrutLaw<double>{strut.stiffness, strut.length, strut.damping, strut.force});
    for (std::size_t i = 1; i < strut.points.size(); ++i) {
      const double across = height(arm, strut.points[i]) - height(arm, strut.points[i - 1]);
      tied_numbers_.push_back(across * across);
    }
    for (const Point& point : strut.points) {
      const std::size_t numbers = tied_numbers_.size();
      in_axes(axes_of(layout_), [&](auto to) { put_record(tied_numbers_, to.lin(point.offset)); });
      put_point(arm, point, numbers);
    }
    layout_.strut_points += static_cast<int>(strut.points.size());
  }
}

void KernelArm::put_point(const Arm& arm, const flexarm::Strut::Point& point, std::size_t numbers) {
  using Point = flexarm::Strut::Point;
  const std::size_t link = static_cast<std::size_t>(point.link);
  put_tied(numbers, point.link < 0              ? Spot{{Place::frame, -1}, {}}
                    : point.on == Point::origin ? origin(link)
                    : point.on == Point::end    ? end(link)
                                                : slice(arm, link, arm.link(link).slice_at(point.x)));
}

void KernelArm::put_contacts(const Arm& arm) {
  using Sp = ::Space<double>;
  const Written<Sp> to{Axes{}};
  const auto height_of = [&](flexarm::Strut::Point point) {
    point.offset.setZero();
    return height(arm, point);
  };
  for (const flexarm::Contact& c : arm.contacts()) {
    const Surface& on = c.against;
    const auto kind = static_cast<ContactPair::Kind>(on.kind);
    contacts_.push_back({kind, c.exponent != 1.0, c.coulomb > 0.0, tied_numbers_.size()});
    for (int x : {int(kind), int(contacts_.back().hertz), int(contacts_.back().rubs)}) structure_.push_back(x);
    put_record(tied_numbers_,
               records::ContactLaw<double>{c.stiffness, c.damping, c.coulomb, c.tangential_stiffness, c.radius});
    std::size_t numbers = tied_numbers_.size();
    tied_numbers_.push_back(height_of(c.point));
    put_record(tied_numbers_, records::ContactSphere<Sp>{to.lin(c.point.offset)});
    put_point(arm, c.point, numbers);
    numbers = tied_numbers_.size();
    tied_numbers_.push_back(height_of(on.at));
    put_record(tied_numbers_, records::ContactSurface<Sp>{to.lin(on.at.offset), to.rot(on.axes),
                                                          to.lin((on.kind == Surface::box ? 0.5 : 1.0) * on.size)});
    put_point(arm, on.at, numbers);
  }
}

void KernelArm::put_loops(const Arm& arm) {
  using Sp = ::Space<double>;
  const Written<Sp> to{Axes{}};
  const int z = layout_.about;
  const auto across = [&](const Loop::Side& side, int axis) {
    return layout_.planar && std::abs(side.axes(z, axis)) > 0.5;  // it is along z, or square to it
  };
  double size = 0.0;
  for (const Link& link : arm.links())
    size += (link.beam() ? link.beam()->length() : 0.0) + link.hub().end.norm() +
            link.joint().inboard().position.norm() + link.joint().outboard().position.norm();
  for (const Loop& loop : arm.loops()) size += loop.a.at.offset.norm() + loop.b.at.offset.norm();
  for (const Loop& loop : arm.loops()) {
    LoopJoint joint;
    for (const Loop::Row& row : loop.rows())
      if (!across(loop.a, row.i) && (!row.turns || !across(loop.b, row.j)))
        joint.row[joint.rows++] = {row.turns, row.i, row.j};
    joint.soft[0] = std::isfinite(loop.stiffness);
    joint.soft[1] = std::isfinite(loop.angular_stiffness);
    joint.numbers = tied_numbers_.size();
    layout_.loop_rows += joint.rows;
    for (int k = 0; k < joint.rows; ++k) layout_.rigid_rows += joint.rigid(joint.row[k]);
    structure_.insert(structure_.end(), {joint.rows, int(joint.soft[0]), int(joint.soft[1])});
    for (int k = 0; k < joint.rows; ++k)
      structure_.insert(structure_.end(), {int(joint.row[k].turns), joint.row[k].i, joint.row[k].j});
    loops_.push_back(joint);
    put_record(tied_numbers_, records::LoopLaw<double>{loop.stiffness, loop.damping, loop.angular_stiffness,
                                                       loop.angular_damping, size});
    for (const Loop::Side& side : {loop.a, loop.b}) {
      const std::size_t numbers = tied_numbers_.size();
      flexarm::Strut::Point place = side.at;
      place.offset.setZero();
      tied_numbers_.push_back(height(arm, place));
      put_record(tied_numbers_, records::Seat<Sp>{to.lin(side.at.offset), to.rot(side.axes)});
      put_point(arm, side.at, numbers);
    }
  }
}

void KernelArm::put_by_state(const Arm& arm, const Load& load, PlacedLoad& out) {
  using Point = flexarm::Strut::Point;
  const bool on_end = load.points.empty();
  out.by_state = {[](const void* law, double t, const double* x, double* wrench) {
                    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R(x + 3);
                    const Vec6<double> found = (*static_cast<const StateForce*>(law))(
                        t, Eigen::Map<const Vector3d>(x), R, Eigen::Map<const Vec6<double>>(x + 12));
                    std::copy_n(found.data(), 6, wrench);
                  },
                  load.by_state.get(), load.world_axes};
  laws_.push_back(load.by_state);
  structure_.push_back(load.world_axes);
  const auto id = reinterpret_cast<std::uintptr_t>(load.by_state.get());  // lanes share one law
  structure_.push_back(static_cast<int>(id & 0x7fffffff));
  structure_.push_back(static_cast<int>((id >> 31) & 0x7fffffff));
  const std::size_t numbers = tied_numbers_.size();
  tied_numbers_.push_back(
      height(arm, {static_cast<int>(load.link), on_end ? Point::end : Point::slice, 0.0, Eigen::Vector3d::Zero()}));
  put_tied(numbers, on_end ? end(load.link) : slice(arm, load.link, load.points.front().slice));
  ++layout_.state_loads;
}

PlacedLoad KernelArm::put_load(const Arm& arm, const Load& load) {
  if (load.strut >= 0 || load.by_state) {
    PlacedLoad tied;
    tied.strut = load.strut;
    if (load.by_state) put_by_state(arm, load, tied);
    return tied;
  }
  std::vector<Spot> spots;
  std::vector<double> weights;
  if (load.points.empty()) {
    spots.push_back(end(load.link));
    weights.push_back(1.0);
  }
  for (const Load::Point& point : load.points) {
    spots.push_back(slice(arm, load.link, point.slice));
    weights.push_back(point.weight);
  }
  PlacedLoad out;
  out.place = spots[0].place;
  out.world = load.world_axes;
  out.numbers = place_numbers_.size();
  out.size = 1 + spots[0].numbers.size();
  // A force that is the same on all slices depends on their positions alone, which are linear in the numbers: one mean
  // slice stands for all. The same is true of a moment where the turns add (about one axis), or where nothing bends.
  const bool stiff = out.place.on != Place::slice;
  out.mean = stiff || load.world_axes || spots.size() == 1;
  out.slices = out.mean && (stiff || layout_.planar || spots.size() == 1) ? 0 : static_cast<int>(spots.size());
  const auto put_one = [&](double weight, const Numbers& numbers) {
    place_numbers_.push_back(weight);
    for (double x : numbers) place_numbers_.push_back(x);
  };
  if (out.mean) {
    double weight = 0.0;
    Numbers mean(spots[0].numbers.size(), 0.0);
    for (double w : weights) weight += w;
    for (std::size_t k = 0; k < spots.size(); ++k)
      for (std::size_t i = 0; i < mean.size(); ++i) mean[i] += weights[k] / weight * spots[k].numbers[i];
    put_one(weight, mean);
  }
  for (int k = 0; k < out.slices; ++k)
    put_one(weights[static_cast<std::size_t>(k)], spots[static_cast<std::size_t>(k)].numbers);
  return out;
}

KernelArm KernelArm::loaded(const Arm& arm, const std::vector<Load>& loads) const {
  KernelArm out = *this;
  for (const Load& load : loads) {
    const PlacedLoad placed = out.put_load(arm, load);
    if (placed.strut < 0 && !placed.by_state.ask)
      out.lists_[static_cast<std::size_t>(placed.place.node)].loads.push_back(static_cast<int>(out.loads_.size()));
    // between fewer points, slices are not as right as sums over all of them
    if (placed.place.on == Place::slice) out.few_[static_cast<std::size_t>(placed.place.node)].sampled.half = 0;
    out.loads_.push_back(placed);
    for (int x :
         {int(placed.place.on), placed.place.node, int(placed.world), int(placed.mean), placed.slices, placed.strut})
      out.structure_.push_back(x);
    out.layout_.attitudes = out.layout_.attitudes || placed.world;
  }
  out.point();
  return out;
}

}  // namespace lanes
}  // namespace flexarm
