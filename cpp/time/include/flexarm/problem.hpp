// A problem: an arm, everything that acts on it, and where it starts. Every integrator takes it.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "flexarm/arm.hpp"
#include "flexarm/control.hpp"
#include "flexarm/drive.hpp"
#include "flexarm/event.hpp"
#include "flexarm/load.hpp"

namespace flexarm {

/// Dry friction, stops and limits of motors are the arm's (JointForce). Controllers with memory are made anew for each
/// run, so that one problem serves many runs, also at once.
struct Problem {
  std::shared_ptr<const Arm> arm;
  Eigen::VectorXd q0, v0;               ///< start (nq), (nv); prescribed ones start with their motion
  Eigen::VectorXd tau;                  ///< constant generalised forces (nv), to which those of drives are added
  std::vector<Drive> drives = {};       ///< motions, forces, and voltages of patches
  std::vector<LoadDrive> loads = {};    ///< external forces and moments
  std::vector<Feedback> feedback = {};  ///< continuous controllers
  std::vector<Sampler> samplers = {};   ///< sampled ones
  std::vector<Event> events = {};

  /// At rest in the arm's zero, with nothing acting on it.
  explicit Problem(std::shared_ptr<const Arm> of)
      : arm(std::move(of)), q0(arm->zero()), v0(Eigen::VectorXd::Zero(arm->nv())), tau(v0) {}
  /// Of a copy of the arm.
  explicit Problem(const Arm& of) : Problem(std::make_shared<const Arm>(of)) {}

  /// @throws std::invalid_argument naming the field and the value
  void check() const;
  /// Whether a drive, a load or a reference of control is a function without samples.
  bool asks_functions() const;
  /// Its controllers at the beginning of a run.
  Control control() const { return Control(feedback, samplers, arm->nv()); }
};

/// @throws std::invalid_argument where t is not a list of two times or more that increase
void check_times(const Eigen::VectorXd& t);

}  // namespace flexarm
