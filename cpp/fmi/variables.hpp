// The variables of a unit, as its file resources/variables.json lists them: the names of the exporter, by value
// reference.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "flexarm/kinematics.hpp"
#include "flexarm/scene.hpp"

namespace flexarm {

/// A reading is by_q . q + by_v . v + offset + along . the place `at`, as that of a KalmanSensor.
struct Reading {
  Eigen::VectorXd by_q, by_v;
  double offset = 0.0;
  std::optional<PlacedSlice> at;
  Eigen::Vector3d along = Eigen::Vector3d::Zero();
};

struct Variable {
  /// In the order of kKinds (variables.cpp). Indices i, j: of coordinates, rates, links, drives, ..
  enum Kind {
    time,
    q,              ///< coordinate i
    v,              ///< rate i
    a,              ///< its derivative
    dq,             ///< derivative of coordinate i
    tau,            ///< applied force, or the reaction of a prescribed motion, of rate i
    friction,       ///< dry friction of rate i
    place,          ///< of the end of link i, component j
    rotation,       ///< of the end of link i, row by row, entry j
    reading,        ///< of a sensor
    indicator,      ///< event indicator of the dry friction of rate i
    add_tau,        ///< input: force of rate i
    add_drive,      ///< input: of drive i
    add_load,       ///< input: of load i, component j
    add_reference,  ///< input: of continuous law i; times the gain of coordinate j, if that is not -1
    add_sampled,    ///< input: of sampled law i, component j
    stiffness,      ///< parameters of rate i's joint force
    damping,
    coulomb,
    payload,         ///< point mass at the end of link i
    gravity,         ///< component i
    beam_stiffness,  ///< factor, of link i's beam
    beam_damping,
    law_gain,      ///< factor, of continuous law i
    law_kp,        ///< of continuous law i by coordinate j, reference included
    law_kv,        ///< of continuous law i by rate j
    sampled_gain,  ///< factor, of the linear sampled law i
    sampled_kp,    ///< of the axis j of the computed torque i
    sampled_kv,
    step  ///< longest step of co-simulation
  };
  Kind kind;
  int i = 0, j = 0;
  std::string name;
  double start = 0.0;  ///< of inputs and parameters
  Reading of;          ///< of `reading`

  bool input() const { return kind >= add_tau && kind <= add_sampled; }
  bool parameter() const { return kind >= stiffness; }
};

/// Additions to the forces, loads and references of a scene.
struct Inputs {
  Eigen::VectorXd tau;
  std::vector<double> drive, reference;
  std::vector<Vec6<double>> load;
  std::vector<Eigen::VectorXd> sampled;
};

/// The content of a unit's resources.
struct Resources {
  std::string token;
  Scene scene;
  std::vector<Variable> variables;

  /// @param folder  of scene.json and variables.json
  /// @throws std::invalid_argument naming file, key and value
  static Resources load(const std::string& folder);

  Inputs inputs() const;  ///< zero
  /// The scene with its parameters at `values` (one for each variable), and `in`, which must outlive it, added to the
  /// actions. Where no parameter differs from its start, and no input from zero, every number is that of the scene.
  /// @throws std::invalid_argument naming the variable and the value
  Scene with(const std::vector<double>& values, const Inputs& in) const;
};

}  // namespace flexarm
