// Checks of the sensors and parameters that a filter is made of. Each throws std::invalid_argument naming the field and
// the value.
#pragma once

#include "flexarm/kalman.hpp"

namespace flexarm {

/// Such as "sensors[1].noise".
std::string entry(const char* name, std::size_t k, const char* field);
/// The force of a joint, by the index of its rate.
JointForce checked_joint(const Arm& arm, const std::string& field, int rate);
void check(const Arm& arm, std::size_t k, const KalmanSensor& s);
void check(const Arm& arm, const std::vector<KalmanParameter>& parameters);

}  // namespace flexarm
