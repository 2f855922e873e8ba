// Which joints of an arm have dry friction, and who knows what to do with it. Its law is that of JointForce.
#pragma once

#include <vector>

#include "flexarm/arm.hpp"

namespace flexarm {

/// What a method without dry friction in its equations does with an arm that has some: it refuses the arm, or the
/// caller cares for the friction, by simulate_with_friction.
enum class DryFriction { refused, left_to_caller };

/// Dry friction of one rate of an arm's joints.
struct Rub {
  int rate;
  double coulomb, stiction;
};
std::vector<Rub> rubs(const Arm& arm);
/// @throws std::invalid_argument where the arm has dry friction, naming the joint and the value
void refuse_friction(const Arm& arm, const char* method);

}  // namespace flexarm
