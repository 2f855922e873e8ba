// An arm from a scene's tables. Internal.
#pragma once

#include "flexarm/arm.hpp"
#include "scene_value.hpp"

namespace flexarm {

Arm read_arm(const Value& scene);

}  // namespace flexarm
