// An arm as the lane kernels know it: its nodes (layout.hpp) and their numbers.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "flexarm/arm.hpp"
#include "lanes/layout.hpp"
#include "lanes/numbers.hpp"

namespace flexarm {
namespace lanes {

class KernelArm {
 public:
  /// Made at the first asking, and kept with the arm.
  /// @return null for what the kernels do not know: beams of more than kMostElastic coordinates
  static const KernelArm* of(const Arm& arm);
  /// For kernels that take `width` points of a beam at once, with the motion of some rates prescribed.
  KernelArm grouped(int width, const std::vector<bool>& given) const;
  /// Whether the arms are of one structure.
  bool like(const KernelArm& other) const { return structure_ == other.structure_; }
  /// Arms of one structure, an arm in each lane: number i of arm k at i width + k. Lanes beyond the last arm
  /// repeat it.
  static KernelArm side_by_side(const std::vector<const KernelArm*>& arms, int width, const std::vector<bool>& given);

  KernelArm(const KernelArm& other) : KernelArm() { *this = other; }
  KernelArm& operator=(const KernelArm& other);

  const Layout& layout() const { return layout_; }
  const Numbers& numbers() const { return numbers_; }

 private:
  friend struct ArmBuilder;
  /// Lists of a node.
  struct Lists {
    std::vector<int> which, direction, about;
    std::vector<Block> blocks;
    int points = 0;                        ///< of a sampled body,
    std::shared_ptr<const Numbers> table;  ///< and integrals over them
  };
  KernelArm() = default;
  static std::optional<KernelArm> build(const Arm& arm);
  void point();
  void prescribe(const std::vector<bool>& given);

  Layout layout_;
  std::vector<Node> nodes_;
  std::vector<Lists> lists_;    ///< one for each node
  std::vector<int> structure_;  ///< what arms share that lie side by side: of every node, as it was made
  Numbers numbers_;
};

}  // namespace lanes
}  // namespace flexarm
