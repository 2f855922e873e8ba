// From an arm to what the lane kernels run on: the nodes and their numbers.
#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "flexarm/arm.hpp"
#include "lanes/layout.hpp"

namespace flexarm {
namespace lanes {

/// Of a beam, whatever link it is in.
struct BeamPoints {
  std::once_flag has_basis, has_turning;
  Eigen::MatrixXd basis;           ///< functions that span what is quadratic, times the root of the slices' masses
  std::vector<MassSlice> turning;  ///< slices for the inertia of rotation
  Eigen::MatrixXd rest;            ///< what they miss of it at rest: J, Mae and Mee in one matrix of 3 + ne
};

class Plan {
 public:
  /// @return none for what the kernels do not know: balls, beams of order 0, 3 and exact
  /// @param every_slice  sum the inertia of rotation over all slices, instead of over the fewest that do to 1e-13
  static std::optional<Plan> of(const Arm& arm, bool every_slice = false);
  /// For kernels that take `width` points of a beam at once, with the motion of some rates prescribed.
  Plan grouped(int width, const std::vector<bool>& given) const;
  /// Whether the arms are of one structure.
  bool like(const Plan& other) const;
  /// Plans of arms of one structure, an arm in each lane: number i of arm k at i width + k. Lanes beyond the last arm
  /// repeat it.
  static Plan side_by_side(const std::vector<const Plan*>& plans, int width, const std::vector<bool>& given);

  Plan(const Plan& other) : Plan() { *this = other; }
  Plan& operator=(const Plan& other);

  const Layout& layout() const { return layout_; }
  const std::vector<double>& numbers() const { return numbers_; }

 private:
  Plan() = default;
  struct Builder;
  /// Lists of a node.
  struct Lists {
    std::vector<int> which, direction, about;
    std::vector<Block> blocks;
  };
  void point();
  void prescribe(const std::vector<bool>& given);

  Layout layout_;
  std::vector<Node> nodes_;
  std::vector<Lists> lists_;  ///< one for each node
  std::vector<double> numbers_;
};

}  // namespace lanes
}  // namespace flexarm
