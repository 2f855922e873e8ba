// Times of one evaluation, for which docs/speed.md has aims; bench/speed/aims.py runs it.
//   cmake --preset release && cmake --build --preset release && build/release/bench_aims [rounds]
// Prints CSV: a work, its microseconds of CPU time, and operations (0 where they are not known), a row for each round;
// all in turn, so that ratios hold on a noisy machine.
#include <cstdio>
#include <functional>
#include <memory>
#include <string>
#include <tuple>

#include "common.hpp"

using namespace flexarm;

namespace {

constexpr double kRound = 2000.0;  // us of one work in one round

struct Work {
  std::string name;
  std::function<void()> once;
  long operations = 0;
  int repeat = 1;
};

/// An arm in motion, and what its evaluations need.
struct Scene {
  Arm arm;
  Workspace ws;
  ForwardDerivatives derivatives;
  InverseDerivatives inverse;
  Eigen::VectorXd q, v, tau;

  explicit Scene(Arm a, const std::vector<Load>& loads = {})
      : arm(std::move(a)), ws(arm, {}, loads), derivatives(arm), inverse(arm), tau(Eigen::VectorXd::Zero(arm.nv())) {
    std::tie(q, v) = some_motion(arm);
    for (auto& load : ws.loads) load.wrench << 1.0, 2.0, 0.0, 0.0, 0.0, 0.1;
  }
};

Work forward(std::string name, const std::shared_ptr<Scene>& s) {
  return {std::move(name), [s] { must(forward_dynamics(s->arm, s->ws, s->q, s->v, s->tau)); },
          operation_count(s->arm, s->q, s->v)};
}
Work derivatives(std::string name, const std::shared_ptr<Scene>& s) {
  return {std::move(name), [s] { must(s->derivatives(s->arm, s->q, s->v, s->tau)); }};
}
Work inverse_derivatives(std::string name, const std::shared_ptr<Scene>& s) {
  return {std::move(name), [s] { s->inverse(s->arm, s->q, s->v, s->derivatives.a); }};
}

std::vector<Work> works() {
  const flexarm::StrainCounts planar{3, 0, 0, 0, 0}, spatial{3, 3, 1, 0, 0};
  const auto scene = [](const Arm& arm, const std::vector<Load>& loads = {}) {
    return std::make_shared<Scene>(arm, loads);
  };
  std::vector<Work> all;
  for (int order : {2, kExact}) {
    const std::string name = order == 2 ? ", order 2" : ", exact";
    const Arm two = chain(2, planar, order, true);
    const auto seven = scene(chain(7, spatial, order));
    all.push_back(forward("planar link" + name, scene(chain(1, planar, order, true))));
    all.push_back(forward("7 x (3+3+1)" + name, seven));
    all.push_back(derivatives("derivatives of 7 x (3+3+1)" + name, seven));
    all.push_back(inverse_derivatives("inverse derivatives of 7 x (3+3+1)" + name, seven));
    all.push_back(forward("two planar links" + name, scene(two)));
    all.push_back(forward("load at the tip" + name, scene(two, {Load::at_end(two, 1, true)})));
    all.push_back(forward("load along the beam" + name, scene(two, {Load::along(two, 1, 0.1, 0.5, true)})));
  }
  return all;
}

}  // namespace

int main(int argc, char** argv) {
  const int rounds = argc > 1 ? std::stoi(argv[1]) : 9;
  std::vector<Work> all = works();
  for (Work& work : all) {
    work.once();
    work.repeat = std::max(1, static_cast<int>(kRound / microseconds(work.once, 10)));
  }
  std::printf("work,us,operations\n");
  for (int round = 0; round < rounds; ++round)
    for (const Work& work : all)
      std::printf("\"%s\",%.6g,%ld\n", work.name.c_str(), cpu_microseconds(work.once, work.repeat), work.operations);
}
