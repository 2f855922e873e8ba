// An arm as the lane kernels know it: a tree of nodes, each a frame that moves against that of its parent by at most
// one freedom, with a rigid or an elastic body. A parent comes before its children in the list. Plain data: the kernels
// are compiled once for each instruction set and share no inline function with the rest of the library.
#pragma once

#include <cstddef>

namespace flexarm {
namespace lanes {

constexpr int kMostElastic = 240;  ///< elastic coordinates of a beam: kMostModes of each strain

/// One block q_i^T C q_j (or q_i^T C q_i / 2, C symmetric) of a row of a slice's motion; see slice.hpp.
struct Block {
  int row, i, ni, j, nj;
};

struct Node {
  // its place in the tree
  int parent = -1;             ///< the node that it sits on; -1: the world
  bool branch = false;         ///< it does not sit on the end of the node before it in the list,
  int seat = -1;               ///< but on this fork; -1: the world
  int fork = -1;               ///< the fork on its end, on that of its beam if it has one; -1: none
  int slices = 0;              ///< forks on slices of its beam: how many,
  const int* slice = nullptr;  ///< and which

  // the joint
  enum Kind { fixed, revolute, prismatic };
  Kind kind = fixed;
  int axis = 0;         ///< 0 x, 1 y, 2 z; in the plane 2 for a hinge
  double sign = 1.0;    ///< -1: the other way
  int q = -1, v = -1;   ///< its coordinate and its rate
  bool given = false;   ///< its motion is prescribed
  bool turned = false;  ///< it sits turned on the frame before
  /// Three nodes are a ball: the first is turned by a quaternion at q and takes all three rates; the frames of the
  /// others coincide with the first one's.
  bool ball = false, coincident = false;
  bool passive = false, stops = false;

  // the body: rigid, or a hub and a beam
  enum Body { none, rigid, cut, quadratic_beam, sampled_beam };
  Body body = none;
  bool tip = false;            ///< the tip body of a beam
  int ne = 0, qe = 0, ve = 0;  ///< elastic coordinates: how many, the first one, its rate
  int stretching = 0;          ///< coordinates that stretch the beam's axis, the last ones
  bool damped = false;         ///< the beam has damping
  const int* about = nullptr;  ///< the axis about which each coordinate turns slices at first order
  int passes = 0, rotary = 0;  ///< (groups of) points: of position, of rotation; of a sampled body, numbers of a
                               ///< section's inertia: see Rows
  struct {
    int directed = 0;                     ///< coordinates that displace slices at first order,
    const int* which = nullptr;           ///< their numbers,
    const int* direction = nullptr;       ///< and 0, 1 or 2 for along x, y or z
    int blocks = 0, position_blocks = 0;  ///< of rotation and position; those of position come first
    const Block* block = nullptr;
    std::size_t point_numbers = 0, rotary_numbers = 0;  ///< of one point
  } quadratic;
  struct {
    int half = 0;                         ///< of points that lie symmetrically about the middle, the first half,
    int further = 0, further_passes = 0;  ///< and then other stations
    int turning = 0;        ///< coordinates that are curvatures or twists, the first ones; the others shear or stretch
    bool exact = false;     ///< or else of order 3
    bool uniaxial = false;  ///< all sections turn about one axis
    bool curved = false;    ///< at rest
    bool points_have_mass = false;  ///< or else the other stations alone
    const double* table = nullptr;  ///< of integrals over the points (integral.hpp); the same numbers for all lanes
    /// The same with fewer points, or null. These are enough where the sizes of the coordinates, times so many numbers,
    /// sum up to less than 1.
    const Node* few = nullptr;
  } sampled;

  // where its numbers begin: joint and body, the beam's end, its points, the tip body, the bounds of few points
  std::size_t numbers = 0, end = 0, points = 0, tip_body = 0, bounds = 0;
  bool tied = false;          ///< a force by state acts on it, or on its beam
  int loads = 0;              ///< that act on it,
  const int* load = nullptr;  ///< and which
};

/// A place on an arm: fixed to a node's frame or to the end of its beam (its numbers: where it sits there, and how it
/// is turned), or a slice of the beam (its numbers: those of `slice_at`).
struct Place {
  enum On { frame, end, slice };
  On on = frame;
  int node = 0;
};

/// Where branches sit on a node: on its end, or on a slice of its beam, of which it has the numbers.
struct PlacedFork {
  Place place;
  std::size_t numbers = 0, size = 0;  ///< where they begin; how many
};

/// A force and moment that follow from time, and from the pose (place and axes, by rows) and the velocity of a place.
struct StateLaw {
  void (*ask)(const void* law, double t, const double* state, double* wrench) = nullptr;
  const void* law = nullptr;
  bool world = true;  ///< the answer is in axes of the world, or else of the place
};

/// A load [f; m] on one or more slices. Of each: its weight, and its numbers as a place. Where there is a mean slice,
/// it comes before these, and stands for all of them where the load has no moment; where there are no others, always.
/// Or, without a place here: the first number of a load in a strut is a force, of a load by its state the time.
struct PlacedLoad {
  Place place;
  bool world = false;                 ///< axes of the world; else those of each slice
  bool mean = false;                  ///< whether there is a mean slice
  int slices = 0;                     ///< besides it; of one arm on packs, groups of them
  std::size_t numbers = 0, size = 0;  ///< where they begin; of one slice
  int strut = -1;
  StateLaw by_state;
};

/// A place that is tied to others by a force (node -1: of the world): a point of a strut, whose first numbers are where
/// it is in the axes of the place; or the place of a load by state, whose first number is its height across the plane;
/// or one side of a contact or a loop: its height, and then those of its record. Behind these come the numbers of the
/// place.
struct TiedPoint {
  Place place;
  std::size_t numbers = 0;
};
struct StrutLine {
  int points = 0;
  bool tension_only = false;
  std::size_t numbers = 0;  ///< where its own begin (records::StrutLaw)
};

/// A sphere on the arm against a surface, as tied points one behind the other.
struct ContactPair {
  enum Kind { plane, sphere, box };
  Kind kind = plane;
  bool hertz = false;       ///< exponent 3/2, else 1
  bool rubs = false;        ///< whether it has friction
  std::size_t numbers = 0;  ///< where its own begin (records::ContactLaw)
};
constexpr int kRemembered = 18;  ///< numbers that a run remembers of a contact, see ContactMemory

/// An equation of a joint that closes a loop: its frame on b is not displaced along axis i of that on a; or, where it
/// is one of turns, axis i on a is square to axis j on b.
struct LoopRow {
  bool turns = false;
  int i = 0, j = 0;
};
/// Two sides as tied points one behind the other.
struct LoopJoint {
  int rows = 0;
  LoopRow row[6];
  bool soft[2] = {false, false};  ///< compliant: in its displacements, in its turns
  bool rigid(const LoopRow& r) const { return !soft[r.turns]; }
  std::size_t numbers = 0;  ///< where its own begin (records::LoopLaw)
};

struct Layout {
  bool planar = false;
  bool attitudes = false;  ///< whether a body or a load asks how it stands in the world
  int nodes = 0, nq = 0, nv = 0;
  bool branched = false;  ///< whether any node is a branch
  const Node* node = nullptr;
  int along[2] = {0, 1}, about = 2;  ///< of a planar arm: axes of the world (and of each link) that it moves in,
  double turning = 1.0;              ///< and the sign of a turn about the third
  int forks = 0;
  const PlacedFork* fork = nullptr;
  /// Whether a node sits on a slice of its parent's beam, not on its end.
  bool on_slice(const Node& n) const { return n.seat >= 0 && fork[n.seat].place.on == Place::slice; }
  int loads = 0;
  const PlacedLoad* load = nullptr;
  const double* place_numbers = nullptr;  ///< of forks and loads
  int struts = 0, strut_points = 0, state_loads = 0;
  const StrutLine* strut = nullptr;
  int contacts = 0;
  const ContactPair* contact = nullptr;
  int loops = 0, loop_rows = 0, rigid_rows = 0;
  const LoopJoint* loop = nullptr;
  /// The points of all struts, the sides of all contacts, those of all loops, places of loads by state.
  const TiedPoint* tied = nullptr;
  const double* tied_numbers = nullptr;
  /// Whether there are forces by state (arm/by_state.hpp).
  bool by_state() const { return struts > 0 || contacts > 0 || loops > 0 || state_loads > 0; }
};

/// Whether kernels of one arm take the slices of loads on a node as many at a time as a pack has lanes.
inline bool slices_in_groups(const Node& node) { return node.ne > 0 && node.body == Node::quadratic_beam; }

/// Time, in the kernels' terms.
struct Shift {
  double damping = 0.0, stiffness = 0.0;
};

}  // namespace lanes
}  // namespace flexarm
