// The mass matrix and the forward dynamics of a scene's arm:
//   dynamics SCENE.toml < numbers
// reads q (nq), v (nv) and tau (nv) from stdin and prints nq and nv, M (nv rows), and the accelerations (nv).
// Exit codes: 0; 2 with one line that says what is wrong with the scene or the numbers.
#include <cstdio>
#include <flexarm/ab.hpp>
#include <flexarm/ci.hpp>
#include <flexarm/scene.hpp>
#include <iostream>
#include <stdexcept>

namespace {

Eigen::VectorXd read(int n, const char* name) {
  Eigen::VectorXd x(n);
  for (double& value : x)
    if (!(std::cin >> value))
      throw std::invalid_argument(std::string(name) + ": must be " + std::to_string(n) + " numbers");
  return x;
}

void print_row(const Eigen::VectorXd& x) {
  for (const double value : x) std::printf("%.17g ", value);
  std::printf("\n");
}

flexarm::Arm load(const char* path) {
#ifdef FLEXARM_SCENES
  return flexarm::load_arm(path);
#else
  throw std::invalid_argument(std::string(path) + ": this flexarm was built without toml++, and reads no scenes");
#endif
}

void run(const char* path) {
  const flexarm::Arm arm = load(path);
  flexarm::Workspace ws(arm);
  flexarm::take_composite(arm, ws);
  const Eigen::VectorXd q = read(arm.nq(), "q"), v = read(arm.nv(), "v"), tau = read(arm.nv(), "tau");
  flexarm::move_arm(arm, ws, q, v);
  flexarm::composite_mass_matrix(arm, ws);
  std::printf("%d %d\n", arm.nq(), arm.nv());
  for (int i = 0; i < arm.nv(); ++i) print_row(ws.M.row(i));
  if (flexarm::forward_dynamics(arm, ws, q, v, tau) != flexarm::Status::ok)
    throw std::invalid_argument("the mass matrix is singular at q");
  print_row(ws.a);
}

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc != 2) throw std::invalid_argument("usage: dynamics SCENE.toml < q v tau");
    run(argv[1]);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 2;
  }
}
