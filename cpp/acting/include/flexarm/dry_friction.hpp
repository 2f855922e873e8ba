// Dry friction of an arm's joints, and its treatment by methods without it. Its law is that of JointForce.
#pragma once

#include <string>
#include <vector>

#include "flexarm/arm.hpp"

namespace flexarm {

/// The treatment of dry friction by a method that lacks it: it refuses the arm, or the caller handles the friction, as
/// simulate_with_friction does.
enum class DryFriction { refused, left_to_caller };

/// Dry friction of one rate of an arm's joints.
struct Rub {
  int rate;
  double coulomb, stiction;
};
std::vector<Rub> rubs(const Arm& arm);
/// @throws std::invalid_argument where the arm has dry friction, naming the joint and the value
void refuse_friction(const Arm& arm, const char* method);

/// @throws std::invalid_argument for contacts with friction, whose past `what` does not know
void refuse_contact_friction(const Arm& arm, const std::string& what);
/// @throws std::invalid_argument where the arm has loops, which `what` does not support
void refuse_loops(const Arm& arm, const std::string& what);

}  // namespace flexarm
