// Compiled scenes: a whole problem and its integrator in one file of resolved numbers (JSON). Python's `flexarm
// compile` and `Scene.compile` write it from a scene file, `scene_text` from a problem made in C++.
#pragma once

#include <string>

#include "flexarm/ida.hpp"
#include "flexarm/problem.hpp"
#include "flexarm/simulation.hpp"

namespace flexarm {

struct Scene {
  Problem problem;
  Eigen::VectorXd t = {};  ///< output times (s)
  Method method = {};      ///< or "ida" by name, with the options `ida`
  double step = 0.0;       ///< longest step (s), of a fixed-step method
  IdaOptions ida = {};
};

#ifdef FLEXARM_SCENES

/// For set-up: it allocates and throws. All numbers are those that were saved, to the last bit.
/// @throws std::invalid_argument naming the file, the key by its path in it, the value and the right values: for
/// missing, unknown or duplicate keys, and for wrong types, sizes, values and versions
Scene load_scene(const std::string& path);
/// The same from the text of such a file.
Scene parse_scene(const std::string& json);
/// The problem alone.
inline Problem load_problem(const std::string& path) { return load_scene(path).problem; }
/// The text of such a file. Laws must be numbers: of drives, loads and references piecewise polynomials
/// (PiecewisePolynomial, PolynomialValue, PolynomialValues), of samplers LinearLaw or TorqueLaw.
/// @throws std::invalid_argument naming the function, or the value that is not finite
std::string scene_text(const Scene& scene);

#else  // this flexarm was built without nlohmann/json (on Debian: nlohmann-json3-dev)

Scene load_scene(const std::string& path) = delete;      // this flexarm was built without nlohmann/json
Scene parse_scene(const std::string& json) = delete;     // this flexarm was built without nlohmann/json
Problem load_problem(const std::string& path) = delete;  // this flexarm was built without nlohmann/json
std::string scene_text(const Scene& scene) = delete;     // this flexarm was built without nlohmann/json

#endif

}  // namespace flexarm
