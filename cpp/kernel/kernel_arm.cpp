#include "lanes/kernel_arm.hpp"

#include <algorithm>

#include "lanes/sampled_tables.hpp"

namespace flexarm {
namespace lanes {

const KernelArm* KernelArm::of(const Arm& arm) {
  const auto& made = arm.kept().get<std::optional<KernelArm>>([&] { return build(arm); });
  return made ? &*made : nullptr;
}

void KernelArm::point() {
  layout_.nodes = static_cast<int>(nodes_.size());
  layout_.node = nodes_.data();
  for (std::size_t k = 0; k < nodes_.size(); ++k) {
    nodes_[k].which = lists_[k].which.data();
    nodes_[k].direction = lists_[k].direction.data();
    nodes_[k].about = lists_[k].about.data();
    nodes_[k].block = lists_[k].blocks.data();
    if (lists_[k].table) nodes_[k].table = lists_[k].table->data();
  }
}

void KernelArm::prescribe(const std::vector<bool>& given) {
  for (Node& node : nodes_)
    node.given =
        node.v >= 0 && static_cast<std::size_t>(node.v) < given.size() && given[static_cast<std::size_t>(node.v)];
}

KernelArm& KernelArm::operator=(const KernelArm& other) {
  layout_ = other.layout_;
  nodes_ = other.nodes_;
  lists_ = other.lists_;
  numbers_ = other.numbers_;
  point();
  return *this;
}

KernelArm KernelArm::grouped(int width, const std::vector<bool>& given) const {
  KernelArm out = *this;
  out.prescribe(given);
  out.numbers_.clear();
  const std::size_t w = static_cast<std::size_t>(width);
  for (std::size_t k = 0, from = 0; k < nodes_.size(); ++k) {  // what goes before a node's points is moved alone
    const Node& node = nodes_[k];
    Node& moved = out.nodes_[k];
    const std::size_t shift = out.numbers_.size() - from;  // modulo 2^64
    for (std::size_t Node::* place : {&Node::numbers, &Node::end, &Node::tip_body}) moved.*place += shift;
    if (node.ne == 0 && k + 1 < nodes_.size()) continue;  // its numbers are copied with the next ones
    const std::size_t end = node.ne == 0 ? numbers_.size() : node.points;
    out.numbers_.insert(out.numbers_.end(), numbers_.begin() + static_cast<std::ptrdiff_t>(from),
                        numbers_.begin() + static_cast<std::ptrdiff_t>(end));
    if (node.ne == 0) break;
    while (out.numbers_.size() % w != 0) out.numbers_.push_back(0.0);
    moved.points = out.numbers_.size();
    from = k + 1 < nodes_.size() ? nodes_[k + 1].numbers : numbers_.size();
    const double* p = numbers_.data() + node.points;
    if (node.body == Node::sampled) {
      moved.passes = node.half / width + 1;
      moved.further_passes = (node.further + width - 1) / width;
      group_points(node, moved, layout_.planar, width, p, out.numbers_);
      out.lists_[k].table = integral_table(lists_[k].points, width);
      continue;
    }
    const std::size_t counts[] = {static_cast<std::size_t>(node.passes), static_cast<std::size_t>(node.rotary)};
    const std::size_t sizes[] = {node.point_numbers, node.rotary_numbers};
    for (int group = 0; group < 2; ++group) {
      for (std::size_t a = 0; a < counts[group]; a += w)
        for (std::size_t i = 0; i < sizes[group]; ++i)
          for (std::size_t l = a; l < a + w; ++l)
            out.numbers_.push_back(l < counts[group] ? p[l * sizes[group] + i] : 0.0);
      p += counts[group] * sizes[group];
    }
    moved.passes = (node.passes + width - 1) / width;
    moved.rotary = (node.rotary + width - 1) / width;
  }
  out.point();
  return out;
}

bool KernelArm::like(const KernelArm& o) const {
  if (layout_.planar != o.layout_.planar || nodes_.size() != o.nodes_.size() || numbers_.size() != o.numbers_.size() ||
      layout_.nq != o.layout_.nq || layout_.nv != o.layout_.nv)
    return false;
  for (std::size_t k = 0; k < nodes_.size(); ++k) {
    const Node &a = nodes_[k], &b = o.nodes_[k];
    const bool joints = a.kind == b.kind && a.axis == b.axis && a.sign == b.sign && a.q == b.q && a.v == b.v &&
                        a.turned == b.turned && a.body == b.body && a.tip == b.tip && a.passive == b.passive &&
                        a.stops == b.stops;
    const bool beams = a.ne == b.ne && a.damped == b.damped && a.directed == b.directed && a.blocks == b.blocks &&
                       a.passes == b.passes && a.rotary == b.rotary && a.numbers == b.numbers && a.points == b.points &&
                       a.exact == b.exact && a.turning == b.turning && a.further == b.further &&
                       a.points_have_mass == b.points_have_mass && lists_[k].points == o.lists_[k].points;
    if (!joints || !beams || lists_[k].which != o.lists_[k].which || lists_[k].direction != o.lists_[k].direction ||
        lists_[k].about != o.lists_[k].about)
      return false;
    for (std::size_t i = 0; i < lists_[k].blocks.size(); ++i) {
      const Block &x = lists_[k].blocks[i], &y = o.lists_[k].blocks[i];
      if (x.row != y.row || x.i != y.i || x.ni != y.ni || x.j != y.j || x.nj != y.nj) return false;
    }
  }
  return true;
}

KernelArm KernelArm::side_by_side(const std::vector<const KernelArm*>& arms, int width,
                                  const std::vector<bool>& given) {
  KernelArm out = *arms[0];
  out.prescribe(given);
  const std::size_t w = static_cast<std::size_t>(width), n = out.numbers_.size();
  out.numbers_.resize(n * w);
  for (std::size_t l = 0; l < w; ++l) {
    const Numbers& from = arms[std::min(l, arms.size() - 1)]->numbers_;
    for (std::size_t i = 0; i < n; ++i) out.numbers_[i * w + l] = from[i];
  }
  for (Node& node : out.nodes_)
    for (std::size_t Node::* place : {&Node::numbers, &Node::end, &Node::points, &Node::tip_body}) node.*place *= w;
  return out;
}

}  // namespace lanes
}  // namespace flexarm
