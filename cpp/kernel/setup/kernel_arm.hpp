// An arm as the lane kernels know it: its nodes (layout.hpp) and their numbers.
#pragma once

#include <memory>
#include <vector>

#include "door/layout.hpp"
#include "flexarm/load.hpp"
#include "setup/numbers.hpp"

namespace flexarm {
namespace lanes {

class KernelArm {
 public:
  /// Made at the first asking, and kept with the arm.
  static const KernelArm& of(const Arm& arm);
  /// The same arm in space, though it may move in a plane alone.
  static const KernelArm& in_space(const Arm& arm);
  /// With loads on it; the arm that this one was made of.
  KernelArm loaded(const Arm& arm, const std::vector<Load>& loads) const;
  /// For kernels that take `width` points of a beam at once, with the motion of some rates prescribed.
  KernelArm grouped(int width, const std::vector<bool>& given) const;
  /// Whether the arms are of one structure.
  bool like(const KernelArm& other) const { return structure_ == other.structure_; }
  /// Whether the elastic bodies of a node are equal, whatever the joints are.
  bool same_body(int node, const KernelArm& other) const;
  /// Arms of one structure, an arm in each lane: number i of arm k at i width + k. Lanes beyond the last arm
  /// repeat it.
  static KernelArm side_by_side(const std::vector<const KernelArm*>& arms, int width, const std::vector<bool>& given);

  KernelArm(const KernelArm& other) : KernelArm() { *this = other; }
  KernelArm& operator=(const KernelArm& other);

  const Layout& layout() const { return layout_; }
  const Numbers& numbers() const { return numbers_; }

  /// A place and its numbers.
  struct Spot {
    Place place;
    Numbers numbers;
  };
  const Spot& origin(std::size_t link) const { return seats_[link].origin_spot; }  ///< of the link's own frame
  const Spot& end(std::size_t link) const { return seats_[link].end_spot; }        ///< where the next joint sits
  Spot slice(const Arm& arm, std::size_t link, const SliceTable& table) const;
  Spot seat(const Arm& arm, std::size_t link) const;  ///< on its parent, where the link's joint sits

 private:
  friend struct ArmBuilder;
  /// Lists of a node.
  struct Lists {
    std::vector<int> which, direction, about, loads, slices;
    std::vector<Block> blocks;
    int points = 0, few_points = 0;                       ///< of a sampled body, and fewer of them,
    std::shared_ptr<const Numbers> table, few_table;      ///< and integrals over them
    std::size_t body[2] = {0, 0}, structure[2] = {0, 0};  ///< where an elastic body's numbers, and its part of the
                                                          ///< structure, begin and end
  };
  /// Where a link sits in its last node's frame, and its end in that frame or the beam's end.
  struct Seat {
    int node = 0;
    Placement origin, end;
    Spot origin_spot, end_spot;
  };
  KernelArm() = default;
  static KernelArm build(const Arm& arm, bool in_space);
  Spot fixed(int node, Place::On on, const Placement& at) const;
  /// A slice of a link's beam that does not bend, from the link's last node.
  Placement at_rest(const Link& link, const Seat& seat, const SliceTable& table) const;
  PlacedLoad put_load(const Arm& arm, const Load& load);
  /// Numbers of a load of `alone`, for packs of points.
  void group_load(PlacedLoad& load, const KernelArm& alone, int width);
  void put_struts(const Arm& arm);
  void put_contacts(const Arm& arm);
  void put_loops(const Arm& arm);
  void put_point(const Arm& arm, const flexarm::Strut::Point& point, std::size_t numbers);
  void put_by_state(const Arm& arm, const Load& load, PlacedLoad& out);
  /// Behind the numbers that a tied point has of its own.
  void put_tied(std::size_t numbers, const Spot& spot);
  void group_tied(const KernelArm& alone, int width);
  /// How far it is across the plane that the arm moves in.
  double height(const Arm& arm, const flexarm::Strut::Point& point) const;
  /// The numbers of a place of `alone` go from p into `out`, for packs of points; p moves on.
  void group_place(const Place& place, std::size_t size, const KernelArm& alone, int width, const double*& p,
                   Numbers& out) const;
  void point();
  /// The fork on a place: that which is there, or a new one.
  int fork_on(const Spot& spot);
  /// Which nodes are branches; of nodes with their parents, and with their seats where these are slices.
  void find_branches();
  void prescribe(const std::vector<bool>& given);

  Layout layout_;
  std::vector<Node> nodes_;
  std::vector<Lists> lists_;    ///< one for each node
  std::vector<Node> few_;       ///< for each node the same with few points: without any, where it has no such
  std::vector<int> structure_;  ///< equal in arms that lie side by side: of every node, from the builder
  Numbers numbers_;
  std::vector<Seat> seats_;  ///< one for each link
  std::vector<PlacedFork> forks_;
  std::vector<PlacedLoad> loads_;
  Numbers place_numbers_;        ///< of forks and loads
  std::vector<double> heights_;  ///< of each node across the plane
  std::vector<StrutLine> struts_;
  std::vector<ContactPair> contacts_;
  std::vector<LoopJoint> loops_;
  std::vector<TiedPoint> tied_;          ///< see Layout
  std::vector<std::size_t> tied_sizes_;  ///< how many numbers the place of each has
  Numbers tied_numbers_;
  std::vector<std::shared_ptr<const StateForce>> laws_;  ///< of loads by state
};

/// The numbers of `slice_at` for a slice of a node's beam, of which the link's origin sees the place at rest.
void put_slice(const Layout& layout, const Node& node, const Eigen::Vector3d& rest, const SliceTable& table,
               Numbers& out);

}  // namespace lanes
}  // namespace flexarm
