// Steps of a scene file in C++, for matrix.py:
//   bench_matrix SCENE.toml METHOD STEP COUNT < numbers
// reads q (nq) and v (nv) from stdin, takes COUNT steps without forces, and prints q behind each. Exit codes: 0; 2 with
// one line that says what is wrong.
#include <cstdio>
#include <cstdlib>
#include <flexarm/scene.hpp>
#include <flexarm/step.hpp>
#include <iostream>
#include <stdexcept>
#include <string>

namespace {

flexarm::Arm load(const char* path) {
#ifdef FLEXARM_SCENES
  return flexarm::load_arm(path);
#else
  throw std::invalid_argument(std::string(path) + ": this flexarm was built without toml++, and reads no scenes");
#endif
}

void run(char** argv) {
  const flexarm::Arm arm = load(argv[1]);
  Eigen::VectorXd q(arm.nq()), v(arm.nv());
  const Eigen::VectorXd tau = Eigen::VectorXd::Zero(arm.nv());
  for (double& x : q) std::cin >> x;
  for (double& x : v) std::cin >> x;
  if (!std::cin) throw std::invalid_argument("stdin: must be nq and nv numbers");
  flexarm::Workspace ws(arm);
  flexarm::OneStep step(argv[2], arm, std::atof(argv[3]));
  for (long k = std::atol(argv[4]); k > 0; --k) {
    if (step(ws, q, v, tau) != flexarm::Status::ok) throw std::runtime_error("a step could not be taken");
    for (const double x : q) std::printf("%.17g ", x);
    std::printf("\n");
  }
}

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc != 5) throw std::invalid_argument("usage: bench_matrix SCENE.toml METHOD STEP COUNT < q v");
    run(argv);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 2;
  }
}
