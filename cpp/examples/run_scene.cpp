// Runs a compiled scene and prints the time and the coordinates at its output times:
//   run_scene SCENE.json
// Exit codes: 0; 1 when the run failed; 2 with one line on the error in the file.
#include <cstdio>
#include <flexarm/scene.hpp>
#include <flexarm/simulate.hpp>
#include <stdexcept>

namespace {

#ifdef FLEXARM_SCENES
flexarm::Trajectory run(const flexarm::Scene& scene) {
#ifdef WITH_IDA
  if (scene.method.name == "ida") return flexarm::simulate_ida(scene.problem, scene.t, scene.ida);
#endif
  const auto method = scene.method.on(*scene.problem.arm, scene.step);
  return flexarm::simulate_fixed(scene.problem, scene.t, *method, scene.step);
}

int print(const char* path) {
  const flexarm::Scene scene = flexarm::load_scene(path);
  const flexarm::Trajectory r = run(scene);
  for (Eigen::Index k = 0; k < r.done; ++k) {
    std::printf("%.17g", scene.t[k]);
    for (const double x : r.q.row(k)) std::printf(" %.17g", x);
    std::printf("\n");
  }
  if (r.failure.empty()) return 0;
  std::fprintf(stderr, "stopped at t = %g s: %s\n", r.reached, r.failure.c_str());
  return 1;
}
#else
int print(const char*) {
  throw std::invalid_argument("this flexarm was built without nlohmann/json: it reads no scenes");
}
#endif

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc != 2) throw std::invalid_argument("usage: run_scene SCENE.json");
    return print(argv[1]);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 2;
  }
}
