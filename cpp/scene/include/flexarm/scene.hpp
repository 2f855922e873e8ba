// Scene files: TOML in, Arm out. The same tables as Python's `flexarm.load` reads: gravity and [[link]], which hold all
// that an Arm is; those of a run (drive, load, control, sensor, simulation) are passed over.
#pragma once

#include <string>

#include "flexarm/arm.hpp"

namespace flexarm {

#ifdef FLEXARM_SCENES

/// The arm of a scene file, for set-up: it allocates and throws.
/// @param path  of a TOML file; the scenes that come with the Python package are found there by their paths, not by
///              bare names
/// @throws std::invalid_argument naming the file, the key, its value and what would be right, and of an unknown key the
///         nearest known one; also where the file cannot be read or is not TOML. What Python reads and this does not,
///         shapes of modes given as samples, is such an error too
Arm load_arm(const std::string& path);

/// The same from the text of such a file.
Arm parse_arm(const std::string& toml);

#else  // this flexarm was built without toml++ (on Debian: libtomlplusplus-dev)

Arm load_arm(const std::string& path) = delete;   // this flexarm was built without toml++
Arm parse_arm(const std::string& toml) = delete;  // this flexarm was built without toml++

#endif

}  // namespace flexarm
