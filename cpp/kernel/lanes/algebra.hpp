// Motions, forces and inertias in space and in the plane, under the same names: the algorithm is written once for both.
// An inertia M = [A B; B^T D] takes [linear; angular] acceleration to [force; moment].
#pragma once

#include "lanes/plane.hpp"
#include "lanes/space.hpp"
