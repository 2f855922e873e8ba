// The time loop of fixed-step methods: outputs, drives, failures.
#pragma once

#include <vector>

#include "flexarm/control.hpp"
#include "flexarm/drive.hpp"
#include "flexarm/event.hpp"
#include "flexarm/step.hpp"
#include "flexarm/trajectory.hpp"

namespace flexarm {

/// Integrates from t[0] to the last of t, which must increase, by any fixed-step method. Output times and the samples
/// of drives and loads are met exactly: what lies between two of them is divided into equal steps, as few as `step`
/// allows. A method that interpolates ends its steps at the samples of forces and loads alone, and halves those that
/// would miss some of a motion, or whose equations cannot be solved.
/// @param step   longest step (s)
/// @param tau    constant generalised forces, length nv, to which force drives are added
/// @param composite  accelerations at the output times by CI instead of AB
/// @param events  seen where their sign differs between the ends of a step, and located on cubic interpolants
/// @param tape  of the method's `stages`: what it did, for derivatives
/// @throws std::invalid_argument for bad arguments; what a drive, an event or `alive` throws goes through
Trajectory simulate_fixed(const Arm& arm, const std::vector<Drive>& drives, const Eigen::VectorXd& t,
                          const Eigen::VectorXd& q0, const Eigen::VectorXd& v0, const Eigen::VectorXd& tau,
                          Step& method, double step, bool composite = false, const Alive& alive = {},
                          const std::vector<LoadDrive>& loads = {}, const std::vector<Event>& events = {},
                          Control* control = nullptr, Tape* tape = nullptr);

}  // namespace flexarm
