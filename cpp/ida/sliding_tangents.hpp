// Derivatives of a run through the switches of dry friction.
#pragma once

#include "flexarm/saltation.hpp"
#include "tangents.hpp"

namespace flexarm {

/// A freedom with friction, and its state now.
struct RubbingJoint {
  int coordinate;
  double coulomb, stiction;
  bool given;  // its motion is prescribed
  int sense;   // of sliding: 1, -1; 0: it sticks
};

/// A drive that holds a joint where it is.
Drive held(const Arm& arm, const RubbingJoint& joint, const Eigen::VectorXd& q);
/// The friction of a joint that slides.
Drive sliding_force(const RubbingJoint& joint, double coulomb);

/// The neighbours of a run's parameters from one switch to the next, with the same freedoms held as in the run, and
/// their tangents at a switch (Saltation).
class SlidingTangents {
 public:
  /// @param free  the system with nothing held. `parameters` must outlive this
  /// @throws std::invalid_argument as StateTangents does
  SlidingTangents(const std::vector<Parameter>& parameters, System& free, std::size_t joints);

  /// The neighbours of the part of the run that comes.
  const std::vector<Parameter>& parameters() const { return near_; }
  /// Prepares them at q and v, with the joints from now on.
  void prepare(const Arm& arm, const std::vector<RubbingJoint>& joints, const Eigen::VectorXd& q,
               const Eigen::VectorXd& v);
  /// Takes over the tangents of the end of a part of the run, which joint n has ended, and lets them leap.
  void leap(const Trajectory& part, std::size_t n, const Saltation& switched);
  /// Takes the friction of joint n, which slides in this sense, out of a row of tau's tangents.
  void separate(Trajectory& out, Eigen::Index row, std::size_t n, const RubbingJoint& joint, double sense) const;

 private:
  const std::vector<Parameter>& parameters_;
  std::vector<Parameter> near_;
  Eigen::MatrixXd by_q_, by_v_;               // tangents where the part begins
  Eigen::MatrixXd coulomb_by_, stiction_by_;  // of each joint by the parameters
};

}  // namespace flexarm
