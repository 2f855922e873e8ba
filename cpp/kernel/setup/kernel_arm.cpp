#include "setup/kernel_arm.hpp"

#include <algorithm>

#include "door/records.hpp"
#include "setup/sampled_tables.hpp"
#include "space/space.hpp"

namespace flexarm {
namespace lanes {

namespace {

/// Data that is kept with an arm.
struct Made {
  KernelArm best;
  MadeOnce in_space;
};

}  // namespace

const KernelArm& KernelArm::of(const Arm& arm) {
  return arm.kept().get<Made>([&] { return Made{build(arm, false), {}}; }).best;
}

const KernelArm& KernelArm::in_space(const Arm& arm) {
  const KernelArm& best = of(arm);
  if (!best.layout_.planar) return best;
  const Made& made = arm.kept().get<Made>([&] { return Made{best, {}}; });  // `of` has made it
  return made.in_space.get<KernelArm>([&] { return build(arm, true); });
}

void KernelArm::point() {
  layout_.nodes = static_cast<int>(nodes_.size());
  layout_.node = nodes_.data();
  for (std::size_t k = 0; k < nodes_.size(); ++k) {
    nodes_[k].quadratic.which = lists_[k].which.data();
    nodes_[k].quadratic.direction = lists_[k].direction.data();
    nodes_[k].about = lists_[k].about.data();
    nodes_[k].quadratic.block = lists_[k].blocks.data();
    if (lists_[k].table) nodes_[k].sampled.table = lists_[k].table->data();
    nodes_[k].load = lists_[k].loads.data();
    nodes_[k].loads = static_cast<int>(lists_[k].loads.size());
    nodes_[k].slice = lists_[k].slices.data();
    nodes_[k].slices = static_cast<int>(lists_[k].slices.size());
    if (few_[k].sampled.half == 0) {
      nodes_[k].sampled.few = nullptr;
      continue;
    }
    Node few = nodes_[k];
    few.sampled.half = few_[k].sampled.half;
    few.passes = few_[k].passes;
    few.points = few_[k].points;
    few.sampled.table = lists_[k].few_table->data();
    few_[k] = few;
    nodes_[k].sampled.few = &few_[k];
  }
  layout_.forks = static_cast<int>(forks_.size());
  layout_.fork = forks_.data();
  layout_.loads = static_cast<int>(loads_.size());
  layout_.load = loads_.data();
  layout_.place_numbers = place_numbers_.data();
  layout_.struts = static_cast<int>(struts_.size());
  layout_.strut = struts_.data();
  layout_.contacts = static_cast<int>(contacts_.size());
  layout_.contact = contacts_.data();
  layout_.loops = static_cast<int>(loops_.size());
  layout_.loop = loops_.data();
  layout_.tied = tied_.data();
  layout_.tied_numbers = tied_numbers_.data();
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
  few_ = other.few_;
  structure_ = other.structure_;
  numbers_ = other.numbers_;
  seats_ = other.seats_;
  forks_ = other.forks_;
  loads_ = other.loads_;
  place_numbers_ = other.place_numbers_;
  heights_ = other.heights_;
  struts_ = other.struts_;
  contacts_ = other.contacts_;
  loops_ = other.loops_;
  tied_ = other.tied_;
  tied_sizes_ = other.tied_sizes_;
  tied_numbers_ = other.tied_numbers_;
  laws_ = other.laws_;
  point();
  return *this;
}

bool KernelArm::same_body(int node, const KernelArm& other) const {
  const auto k = static_cast<std::size_t>(node);
  if (k >= other.lists_.size()) return false;
  const Lists &mine = lists_[k], &its = other.lists_[k];
  const auto same = [](const auto& x, const std::size_t* a, const auto& y, const std::size_t* b) {
    const auto at = [](const auto& list, std::size_t i) { return list.begin() + static_cast<std::ptrdiff_t>(i); };
    return std::equal(at(x, a[0]), at(x, a[1]), at(y, b[0]), at(y, b[1]));
  };
  return same(numbers_, mine.body, other.numbers_, its.body) &&
         same(structure_, mine.structure, other.structure_, its.structure);
}

KernelArm KernelArm::grouped(int width, const std::vector<bool>& given) const {
  KernelArm out = *this;
  out.prescribe(given);
  out.numbers_.clear();
  const std::size_t w = static_cast<std::size_t>(width);
  for (std::size_t k = 0, from = 0; k < nodes_.size(); ++k) {  // numbers before a node's points are moved alone
    const Node& node = nodes_[k];
    Node& moved = out.nodes_[k];
    const std::size_t shift = out.numbers_.size() - from;  // modulo 2^64
    for (std::size_t Node::* place : {&Node::numbers, &Node::end, &Node::tip_body, &Node::bounds})
      moved.*place += shift;
    if (node.ne == 0 && k + 1 < nodes_.size()) continue;  // its numbers are copied with the next ones
    const std::size_t end = node.ne == 0 ? numbers_.size() : node.points;
    out.numbers_.insert(out.numbers_.end(), numbers_.begin() + static_cast<std::ptrdiff_t>(from),
                        numbers_.begin() + static_cast<std::ptrdiff_t>(end));
    if (node.ne == 0) break;
    while (out.numbers_.size() % w != 0) out.numbers_.push_back(0.0);
    moved.points = out.numbers_.size();
    from = k + 1 < nodes_.size() ? nodes_[k + 1].numbers : numbers_.size();
    const double* p = numbers_.data() + node.points;
    if (node.body == Node::sampled_beam) {
      moved.passes = node.sampled.half / width + 1;
      moved.sampled.further_passes = (node.sampled.further + width - 1) / width;
      group_points(node, moved, layout_.planar, width, p, out.numbers_);
      out.lists_[k].table = integral_table(lists_[k].points, width);
      if (!node.sampled.few) continue;
      Node& few = out.few_[k];
      few.points = out.numbers_.size();
      few.passes = few.sampled.half / width + 1;
      group_points(*node.sampled.few, few, layout_.planar, width, p, out.numbers_);
      out.lists_[k].few_table = integral_table(lists_[k].few_points, width);
      continue;
    }
    const std::size_t counts[] = {static_cast<std::size_t>(node.passes), static_cast<std::size_t>(node.rotary)};
    const std::size_t sizes[] = {node.quadratic.point_numbers, node.quadratic.rotary_numbers};
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
  out.place_numbers_.clear();
  for (PlacedFork& fork : out.forks_) {
    const double* p = place_numbers_.data() + fork.numbers;
    fork.numbers = out.place_numbers_.size();
    out.group_place(fork.place, fork.size, *this, width, p, out.place_numbers_);
  }
  for (PlacedLoad& load : out.loads_) out.group_load(load, *this, width);
  out.group_tied(*this, width);
  out.point();
  return out;
}

void KernelArm::group_place(const Place& place, std::size_t size, const KernelArm& alone, int width, const double*& p,
                            Numbers& out) const {
  const std::size_t node = static_cast<std::size_t>(place.node);
  if (place.on == Place::slice && nodes_[node].body == Node::sampled_beam)
    return group_slice(alone.nodes_[node], nodes_[node], layout_.planar, width, p, out);
  out.insert(out.end(), p, p + size);
  p += size;
}

void KernelArm::group_tied(const KernelArm& alone, int width) {
  using Sp = ::Space<double>;
  const double* p = alone.tied_numbers_.data();
  std::size_t at = 0;
  tied_numbers_.clear();
  const auto move = [&](std::size_t count) {
    tied_numbers_.insert(tied_numbers_.end(), p, p + count);
    p += count;
  };
  const auto move_tied = [&](std::size_t own) {
    tied_[at].numbers = tied_numbers_.size();
    move(own);
    if (tied_sizes_[at] > 0) group_place(tied_[at].place, tied_sizes_[at], alone, width, p, tied_numbers_);
    ++at;
  };
  for (StrutLine& line : struts_) {
    line.numbers = tied_numbers_.size();
    move(static_cast<std::size_t>(records::kStrutLaw + line.points - 1));
    for (int i = 0; i < line.points; ++i) move_tied(layout_.planar ? 2 : 3);
  }
  for (ContactPair& pair : contacts_) {
    pair.numbers = tied_numbers_.size();
    move(sizeof(records::ContactLaw<double>) / sizeof(double));
    move_tied(1 + sizeof(records::ContactSphere<Sp>) / sizeof(double));
    move_tied(1 + sizeof(records::ContactSurface<Sp>) / sizeof(double));
  }
  for (LoopJoint& joint : loops_) {
    joint.numbers = tied_numbers_.size();
    move(sizeof(records::LoopLaw<double>) / sizeof(double));
    for (int side = 0; side < 2; ++side) move_tied(1 + sizeof(records::Seat<Sp>) / sizeof(double));
  }
  while (at < tied_.size()) move_tied(1);
}

void KernelArm::group_load(PlacedLoad& load, const KernelArm& alone, int width) {
  const std::size_t node = static_cast<std::size_t>(load.place.node), size = load.size;
  const double* p = alone.place_numbers_.data() + load.numbers;
  load.numbers = place_numbers_.size();
  const auto move_one = [&] {
    const std::size_t begin = place_numbers_.size();
    place_numbers_.push_back(*p++);  // its weight
    group_place(load.place, size - 1, alone, width, p, place_numbers_);
    load.size = place_numbers_.size() - begin;
  };
  if (load.mean) move_one();
  const std::size_t slices = static_cast<std::size_t>(load.slices), w = static_cast<std::size_t>(width);
  if (!slices_in_groups(nodes_[node])) {
    for (std::size_t k = 0; k < slices; ++k) move_one();
    return;
  }
  for (std::size_t a = 0; a < slices; a += w)
    for (std::size_t i = 0; i < size; ++i)
      for (std::size_t l = a; l < a + w; ++l)  // surplus lanes repeat the last, without weight
        place_numbers_.push_back(l < slices ? p[l * size + i] : i == 0 ? 0.0 : p[(slices - 1) * size + i]);
  load.slices = (load.slices + width - 1) / width;
}

KernelArm KernelArm::side_by_side(const std::vector<const KernelArm*>& arms, int width,
                                  const std::vector<bool>& given) {
  KernelArm out = *arms[0];
  out.prescribe(given);
  const std::size_t w = static_cast<std::size_t>(width);
  for (Numbers KernelArm::* all : {&KernelArm::numbers_, &KernelArm::place_numbers_, &KernelArm::tied_numbers_}) {
    const std::size_t n = (out.*all).size();
    (out.*all).resize(n * w);
    for (std::size_t l = 0; l < w; ++l) {
      const Numbers& from = arms[std::min(l, arms.size() - 1)]->*all;
      for (std::size_t i = 0; i < n; ++i) (out.*all)[i * w + l] = from[i];
    }
  }
  for (Node& node : out.nodes_)
    for (std::size_t Node::* place : {&Node::numbers, &Node::end, &Node::points, &Node::tip_body, &Node::bounds})
      node.*place *= w;
  for (Node& few : out.few_) few.points *= w;
  out.point();
  return out;
}

}  // namespace lanes
}  // namespace flexarm
