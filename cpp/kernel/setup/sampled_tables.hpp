// The numbers of a sampled body (sampled.hpp), made at set-up: first with a point at a time, then in packs of points.
#pragma once

#include <memory>
#include <vector>

#include "flexarm/link.hpp"
#include "setup/numbers.hpp"
#include "setup/written.hpp"

namespace flexarm {
namespace lanes {

/// Fills a node's fields of a sampled body, and the axes of its coordinates (Node::about).
void describe_sampled(const Beam& beam, bool planar, Node& node, std::vector<int>& about);

/// The strain that a coordinate is one of.
const StrainField& strain_of(const Beam& beam, int coordinate);

/// Slices at X = 0, the points of a beam, and the end.
struct PointTables {
  std::vector<SliceTable> all, few;  ///< the few are enough for small coordinates; none, where they save too little
  /// Numbers by which the sizes of coordinates are multiplied and summed: below 1, the few integrate as all do.
  Eigen::VectorXd bounds;
  static int points(const std::vector<SliceTable>& tables) { return static_cast<int>(tables.size()) - 2; }
  /// Kept with the beam.
  static const PointTables& of(const Beam& beam);
};

/// The numbers of one body, a point at a time. `node` and `about` are as described.
class SampledTables {
 public:
  SampledTables(const Link& link, const Axes& axes, const Node& node, const std::vector<int>& about);
  /// Of the points (sampled.hpp's Rows), by their tables.
  std::vector<double> points(const std::vector<SliceTable>& tables) const;
  /// Of a slice: where the beam begins, weights of the integral from 0 to X, and how it turns.
  std::vector<double> slice(const SliceTable& at) const;
  /// In the plane, where sections turn by a linear angle: their moment of inertia, and its sums with the coordinates'
  /// turns, and with pairs of these.
  double rotary() const;
  Eigen::VectorXd rotary_by() const;
  Eigen::MatrixXd rotary_of_pairs() const;

 private:
  Eigen::VectorXd of_points(const Eigen::VectorXd& at_points, bool shared) const;
  double turn_at_rest(const SliceAtRest& rest) const;
  std::vector<MassSlice> stations(const std::vector<SliceTable>& tables) const;

  const Link& link_;
  const Beam& beam_;
  Axes axes_;
  const Node& node_;
  const std::vector<int>& about_;
};

/// The matrices of integrals over as many points, for packs of so many (integral.hpp).
std::shared_ptr<const Numbers> integral_table(int points, int width);

/// Packs of points: moves p on behind the numbers read; `to` is described for the width, `from` for 1.
void group_points(const Node& from, const Node& to, bool planar, int width, const double*& p, Numbers& out);
void group_slice(const Node& from, const Node& to, bool planar, int width, const double*& p, Numbers& out);

}  // namespace lanes
}  // namespace flexarm
