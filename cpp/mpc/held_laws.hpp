// Sampled linear laws over a horizon: their memory is a part of the predicted state.
#pragma once

#include <limits>
#include <vector>

#include "flexarm/control.hpp"

namespace flexarm {

/// Of each law its x, the u that acts, and those that are on their way. As in a run (Control), each looks at its times,
/// and its force acts a delay later. It allocates.
class HeldLaws {
 public:
  /// @throws std::invalid_argument for a law that is not a LinearLaw, or reads sensors
  HeldLaws(const std::vector<Sampler>& samplers, int nv);
  /// How many numbers are remembered; at the start they are zero.
  Eigen::Index size() const { return size_; }
  /// Generalised forces per unit of acting outputs (nv, acting), and the places of these among the numbers.
  const Eigen::MatrixXd& columns() const { return columns_; }
  const std::vector<Eigen::Index>& acting() const { return acting_; }
  /// The first time after t at which something happens (s).
  double next(double t) const { return times_.next(t + one_time_); }
  /// Takes samples, and lets delayed forces begin to act, at time t.
  /// @param z       the numbers
  /// @param slopes  of [q; v; z] as rates (2 nv + size), by whatever their columns are
  /// @param E       of the rates of coordinates (nq, nv); empty without balls
  void pass(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v, Eigen::VectorXd& z,
            const std::vector<Eigen::MatrixXd*>& slopes, const Eigen::MatrixXd& E);

 private:
  struct Line {
    LinearLaw law;
    double first, period, delay;
    Eigen::Index x, u, coming;  ///< where its numbers are; those on their way follow one another
    long slots;                 ///< how many of these there are; 0 without delay
  };
  std::vector<Line> lines_;
  Control times_;
  double one_time_ = std::numeric_limits<double>::infinity();  ///< by how much two times may differ that are one (s)
  Eigen::MatrixXd columns_;
  std::vector<Eigen::Index> acting_;
  Eigen::Index size_ = 0;
};

}  // namespace flexarm
