// Coulomb friction of joints, with stiction, for IDA (Coulomb 1785; as a hybrid system: Karnopp 1985, Pfeiffer &
// Glocker 1996). Each freedom sticks or slides. Sliding, it is opposed by the constant coulomb force; sticking, it is
// held exactly still, by a force up to the stiction. Between two switches the motion is smooth; their times are
// found as events. Fixed steps have it in Stepper, and the implicit method in its equations.
#pragma once

#include <functional>

#include "flexarm/parameter.hpp"
#include "flexarm/trajectory.hpp"

namespace flexarm {

/// Integrates a part of a run from t[0] to t[end], or to the first terminal event.
using SmoothPart =
    std::function<Trajectory(const Problem& part, const Eigen::VectorXd& t, const std::vector<Parameter>& parameters)>;

/// `integrate` from one switch of a joint's friction to the next, over all times of t. In the trajectory `tau` is the
/// applied force, and `friction` that of dry friction.
/// @param parameters  of Trajectory::tangents, which `integrate` must then give; at a switch they jump, because the
///                    time of the switch depends on the parameters, too (saltation: Aizerman & Gantmakher 1958).
///                    Between the switches a joint that sticks is held. There must be no sampled controllers then
Trajectory simulate_with_friction(const Problem& problem, const Eigen::VectorXd& t, const SmoothPart& integrate,
                                  Control& control, const std::vector<Parameter>& parameters);

}  // namespace flexarm
