// Places on an arm: of loads, sensors and frames, in the kernels' numbers.
#include <algorithm>

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

PlacedLoad KernelArm::put_load(const Arm& arm, const Load& load) {
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
    out.lists_[static_cast<std::size_t>(placed.place.node)].loads.push_back(static_cast<int>(out.loads_.size()));
    // between fewer points, slices are not as right as sums over all of them
    if (placed.place.on == Place::slice) out.few_[static_cast<std::size_t>(placed.place.node)].sampled.half = 0;
    out.loads_.push_back(placed);
    for (int x : {int(placed.place.on), placed.place.node, int(placed.world), int(placed.mean), placed.slices})
      out.structure_.push_back(x);
    out.layout_.attitudes = out.layout_.attitudes || placed.world;
  }
  out.point();
  return out;
}

}  // namespace lanes
}  // namespace flexarm
