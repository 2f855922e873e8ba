// Derivatives of a run through the switches of dry friction.
#pragma once

#include "tangents.hpp"

namespace flexarm {

/// A freedom with friction, and what it does now.
struct Contact {
  int coordinate;
  double coulomb, stiction;
  bool given;  // its motion is prescribed
  int sense;   // of sliding: 1, -1; 0: it sticks
};

/// A drive that holds a contact where it is.
Drive held(const Arm& arm, const Contact& contact, const Eigen::VectorXd& q);
/// The friction of a contact that slides.
Drive sliding_force(const Contact& contact, double coulomb);

/// The neighbours of a run's parameters from one switch to the next, with the same freedoms held as in the run, and
/// what becomes of their tangents at a switch. There the acceleration leaps from a- to a+; since the time T of the
/// switch depends on a parameter p, too, the rates' tangents leap by (a- - a+) dT/dp (saltation; Aizerman & Gantmakher
/// 1958).
class SlidingTangents {
 public:
  /// Force that holds contact number `n` at t, q and v.
  using Holding = std::function<double(std::size_t n, double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v)>;

  /// @param free  the system with nothing held. `parameters` must outlive this
  /// @throws std::invalid_argument as StateTangents does
  SlidingTangents(const std::vector<Parameter>& parameters, System& free, std::size_t contacts);

  /// The neighbours of the part of the run that comes.
  const std::vector<Parameter>& parameters() const { return near_; }
  /// Prepares them at q and v, where the contacts are what they are from now on.
  void prepare(const Arm& arm, const std::vector<Contact>& contacts, const Eigen::VectorXd& q,
               const Eigen::VectorXd& v);
  /// dT/dp of the switch of contact n, which has ended a part of the run at q and v with the accelerations a.
  Eigen::RowVectorXd lead(const Trajectory& part, std::size_t n, const Contact& contact, const Eigen::VectorXd& q,
                          const Eigen::VectorXd& v, const Eigen::VectorXd& a, double span,
                          const Holding& holding) const;
  /// Takes over the tangents of that end.
  void end(const Trajectory& part);
  /// Adds the leap of the rates' tangents.
  void leap(const Eigen::VectorXd& a_before, const Eigen::VectorXd& a_behind, const Eigen::RowVectorXd& lead);
  /// Takes the friction of contact n, which slides in this sense, out of a row of tau's tangents.
  void separate(Trajectory& out, Eigen::Index row, std::size_t n, const Contact& contact, double sense) const;

 private:
  const std::vector<Parameter>& parameters_;
  std::vector<Parameter> near_;
  Eigen::MatrixXd by_q_, by_v_;               // tangents where the part begins
  Eigen::MatrixXd coulomb_by_, stiction_by_;  // of each contact by the parameters
};

}  // namespace flexarm
