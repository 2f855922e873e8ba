#include "lanes/kernel_arm.hpp"

#include <algorithm>

namespace flexarm {
namespace lanes {

namespace {

/// What is kept with an arm.
struct Made {
  std::optional<KernelArm> best;
  MadeOnce in_space;
};

}  // namespace

const KernelArm* KernelArm::of(const Arm& arm) {
  const Made& made = arm.kept().get<Made>([&] { return Made{build(arm, false), {}}; });
  return made.best ? &*made.best : nullptr;
}

const KernelArm* KernelArm::in_space(const Arm& arm) {
  const KernelArm* best = of(arm);
  if (!best || !best->layout_.planar) return best;
  const Made& made = arm.kept().get<Made>([] { return Made{}; });
  const auto& spatial = made.in_space.get<std::optional<KernelArm>>([&] { return build(arm, true); });
  return spatial ? &*spatial : nullptr;
}

void KernelArm::point() {
  layout_.nodes = static_cast<int>(nodes_.size());
  layout_.node = nodes_.data();
  for (std::size_t k = 0; k < nodes_.size(); ++k) {
    nodes_[k].which = lists_[k].which.data();
    nodes_[k].direction = lists_[k].direction.data();
    nodes_[k].about = lists_[k].about.data();
    nodes_[k].block = lists_[k].blocks.data();
    nodes_[k].load = lists_[k].loads.data();
    nodes_[k].loads = static_cast<int>(lists_[k].loads.size());
  }
  layout_.loads = static_cast<int>(loads_.size());
  layout_.load = loads_.data();
  layout_.load_numbers = load_numbers_.data();
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
  seats_ = other.seats_;
  loads_ = other.loads_;
  load_numbers_ = other.load_numbers_;
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
    const std::size_t next = k + 1 < nodes_.size() ? nodes_[k + 1].numbers : numbers_.size();
    from = next;
    const std::size_t counts[] = {static_cast<std::size_t>(node.passes), static_cast<std::size_t>(node.rotary)};
    const std::size_t sizes[] = {node.point_numbers, node.rotary_numbers};
    const double* p = numbers_.data() + node.points;
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
  out.load_numbers_.clear();
  for (PlacedLoad& load : out.loads_) {
    const double* p = load_numbers_.data() + load.numbers;
    load.numbers = out.load_numbers_.size();
    if (load.mean) {
      out.load_numbers_.insert(out.load_numbers_.end(), p, p + load.size);
      p += load.size;
    }
    const std::size_t slices = static_cast<std::size_t>(load.slices);
    if (!slices_in_groups(nodes_[static_cast<std::size_t>(load.place.node)])) {
      out.load_numbers_.insert(out.load_numbers_.end(), p, p + slices * load.size);
      continue;
    }
    for (std::size_t a = 0; a < slices; a += w)
      for (std::size_t i = 0; i < load.size; ++i)
        for (std::size_t l = a; l < a + w; ++l)  // what is too much repeats the last, without weight
          out.load_numbers_.push_back(l < slices ? p[l * load.size + i]
                                      : i == 0   ? 0.0
                                                 : p[(slices - 1) * load.size + i]);
    load.slices = (load.slices + width - 1) / width;
  }
  out.point();
  return out;
}

bool KernelArm::like(const KernelArm& o) const {
  if (layout_.planar != o.layout_.planar || nodes_.size() != o.nodes_.size() || numbers_.size() != o.numbers_.size() ||
      layout_.nq != o.layout_.nq || layout_.nv != o.layout_.nv || loads_.size() != o.loads_.size())
    return false;
  for (std::size_t k = 0; k < loads_.size(); ++k) {
    const PlacedLoad &a = loads_[k], &b = o.loads_[k];
    if (a.place.on != b.place.on || a.place.node != b.place.node || a.world != b.world || a.mean != b.mean ||
        a.slices != b.slices || a.size != b.size)
      return false;
  }
  for (std::size_t k = 0; k < nodes_.size(); ++k) {
    const Node &a = nodes_[k], &b = o.nodes_[k];
    const bool joints = a.kind == b.kind && a.axis == b.axis && a.sign == b.sign && a.q == b.q && a.v == b.v &&
                        a.turned == b.turned && a.body == b.body && a.tip == b.tip && a.passive == b.passive &&
                        a.stops == b.stops;
    const bool beams = a.ne == b.ne && a.damped == b.damped && a.directed == b.directed && a.blocks == b.blocks &&
                       a.passes == b.passes && a.rotary == b.rotary && a.numbers == b.numbers && a.points == b.points;
    if (!joints || !beams || lists_[k].which != o.lists_[k].which || lists_[k].direction != o.lists_[k].direction)
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
  const std::size_t w = static_cast<std::size_t>(width);
  for (std::vector<double> KernelArm::* all : {&KernelArm::numbers_, &KernelArm::load_numbers_}) {
    const std::size_t n = (out.*all).size();
    (out.*all).resize(n * w);
    for (std::size_t l = 0; l < w; ++l) {
      const std::vector<double>& from = arms[std::min(l, arms.size() - 1)]->*all;
      for (std::size_t i = 0; i < n; ++i) (out.*all)[i * w + l] = from[i];
    }
  }
  out.point();
  for (Node& node : out.nodes_)
    for (std::size_t Node::* place : {&Node::numbers, &Node::end, &Node::points, &Node::tip_body}) node.*place *= w;
  return out;
}

}  // namespace lanes
}  // namespace flexarm
