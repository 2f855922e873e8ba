// What each thing costs: one forward dynamics on a ladder of arms, each a rung above another. bench/speed/counts.py
// runs it, once alone for the times, and once under callgrind, which counts the instructions of `flexarm_measured`.
//   cmake --preset release && cmake --build --preset release && build/release/bench_counts [times]
// Prints CSV: name of the rung, that of the one below, coordinates, Gauss points, evaluations that were counted, and
// with `times` nanoseconds. Arms have two links on hinges along z, beams of 3 planar modes at order 2 with rotary
// inertia, and no gravity, unless their name says otherwise.
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <string>

#include "common.hpp"
#include "flexarm/load.hpp"
#include "flexarm/patch.hpp"

// Callgrind collects inside this function alone, and writes what it found after each call.
extern "C" [[gnu::noinline]] void flexarm_measured(const flexarm::Arm& arm, flexarm::Workspace& ws,
                                                   const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                                   const Eigen::VectorXd& tau, int evaluations) {
  for (int k = 0; k < evaluations; ++k) flexarm::must(flexarm::forward_dynamics(arm, ws, q, v, tau));
}

namespace {

using namespace flexarm;

constexpr int kEvaluations = 4;

struct Rung {
  std::string name, below;
  StrainCounts modes{3, 0, 0, 0, 0};
  BeamOptions options{};
  std::vector<Patch> patches{};
  JointForce force{};
  Eigen::Vector3d second_axis = Eigen::Vector3d::UnitZ(), gravity = Eigen::Vector3d::Zero();
  double tip = 0.0;  ///< kg
  std::function<std::vector<Load>(const Arm&)> loads{};
};

Patch patch(bool mass) {
  PatchLayer layer;
  layer.width = 0.01;
  layer.thickness = 2.5e-4;
  layer.inner = 0.002;
  const PatchSection section = patch_section(Piezo(63e9, 0.3, 7650, -166e-12, -166e-12, 0, 1.5e-8), layer);
  return {0.05, 0.15, [section](double) { return section; }, {}, true, mass};
}

Arm arm_of(const Rung& r) {
  BeamOptions o = r.options;
  o.modes = r.modes;
  std::optional<Beam> beam;
  if (*std::max_element(r.modes.begin(), r.modes.end()) > 0)
    beam.emplace(0.5, Section::rectangle(0.004, 0.01), Material(7850, 209e9, 0.3), o, r.patches);
  std::vector<Link> links;
  for (int k = 0; k < 2; ++k) {
    RigidBody hub, tip;
    hub.mass = 0.3;
    hub.inertia = Eigen::Vector3d(1e-4, 2e-4, 2e-4).asDiagonal();
    hub.end = {0.075, 0, 0};
    tip.mass = r.tip;
    std::vector<JointForce> forces;
    if (r.force.stiffness > 0.0 || r.force.damping > 0.0) forces = {r.force};
    const Eigen::Vector3d axis = k ? r.second_axis : Eigen::Vector3d::UnitZ();
    links.emplace_back(Joint({{true, axis}}, false, {"angle"}, forces), hub, beam,
                       r.tip > 0.0 ? std::optional<RigidBody>(tip) : std::nullopt);
  }
  return Arm(std::move(links), r.gravity);
}

std::vector<Rung> ladder() {
  const StrainCounts none{}, spatial{3, 3, 0, 0, 0}, torsion{3, 3, 1, 0, 0};
  std::vector<Rung> all;
  const auto add = [&](std::string name, std::string below, const std::function<void(Rung&)>& change) {
    const auto found = std::find_if(all.begin(), all.end(), [&](const Rung& r) { return r.name == below; });
    Rung rung = found == all.end() ? Rung{} : *found;
    rung.name = std::move(name);
    rung.below = std::move(below);
    change(rung);
    all.push_back(rung);
  };
  const std::string planar = "planar, 3 modes", space = "in space, 3 + 3 modes", twist = "in space, 3 + 3 + 1 modes";
  add("rigid, planar", "", [&](Rung& r) { r.modes = none; });
  add("rigid, in space", "rigid, planar", [](Rung& r) { r.second_axis = Eigen::Vector3d::UnitY(); });
  add("planar, 1 mode", "rigid, planar", [](Rung& r) { r.modes = {1, 0, 0, 0, 0}; });
  add(planar, "planar, 1 mode", [](Rung& r) { r.modes = {3, 0, 0, 0, 0}; });
  for (int order : {0, 1, 3, kExact})
    add(planar + ", order " + (order == kExact ? "exact" : std::to_string(order)), planar,
        [&](Rung& r) { r.options.order = order; });
  add(planar + ", no rotary inertia", planar, [](Rung& r) { r.options.rotary_inertia = false; });
  add(planar + ", gravity in the plane", planar, [](Rung& r) { r.gravity = {0, -9.81, 0}; });
  add(planar + ", modal damping", planar, [](Rung& r) { r.options.damping_ratio = 0.01; });
  add(planar + ", patch without its mass", planar, [](Rung& r) { r.patches = {patch(false)}; });
  add(planar + ", patch", planar, [](Rung& r) { r.patches = {patch(true)}; });
  add(planar + ", tip mass", planar, [](Rung& r) { r.tip = 0.1; });
  add(planar + ", joint spring", planar, [](Rung& r) { r.force.stiffness = 10.0; });
  add(planar + ", load at the end", planar,
      [](Rung& r) { r.loads = [](const Arm& arm) { return std::vector<Load>{Load::at_end(arm, 1, true)}; }; });
  add(planar + ", load along the beam", planar,
      [](Rung& r) { r.loads = [](const Arm& arm) { return std::vector<Load>{Load::along(arm, 1, 0.1, 0.5, true)}; }; });
  add(planar + ", 1 shear mode", planar, [](Rung& r) { r.modes = {3, 0, 0, 1, 0}; });
  add("planar modes, second hinge along y", planar, [](Rung& r) { r.second_axis = Eigen::Vector3d::UnitY(); });
  add(space, planar, [&](Rung& r) { r.modes = spatial; });
  add(twist, space, [&](Rung& r) { r.modes = torsion; });
  add(twist + ", second hinge along y", twist, [](Rung& r) { r.second_axis = Eigen::Vector3d::UnitY(); });
  add("in space, 3 + 3 + 1 + 1 + 1 modes", twist, [](Rung& r) { r.modes = {3, 3, 1, 1, 1}; });
  for (int order : {0, 1, 3, kExact})
    add(twist + ", order " + (order == kExact ? "exact" : std::to_string(order)), twist,
        [&](Rung& r) { r.options.order = order; });
  return all;
}

void run(const Rung& rung, bool times) {
  const Arm arm = arm_of(rung);
  Workspace ws(arm, {}, rung.loads ? rung.loads(arm) : std::vector<Load>{});
  for (auto& load : ws.loads) load.wrench << 1.0, 2.0, 0.0, 0.0, 0.0, 0.1;
  Eigen::VectorXd q(arm.nv()), v(arm.nv());
  const Eigen::VectorXd tau = Eigen::VectorXd::Zero(arm.nv());
  for (int i = 0; i < arm.nv(); ++i) {
    q[i] = 0.002 * std::sin(1.7 * i + 1.0);
    v[i] = 0.02 * std::cos(2.3 * i);
  }
  must(forward_dynamics(arm, ws, q, v, tau));  // the first may bind library functions
  const std::size_t points = arm.link(0).beam() ? arm.link(0).beam()->slices().size() : 0;
  std::printf("\"%s\",\"%s\",%d,%zu,%d", rung.name.c_str(), rung.below.c_str(), arm.nv(), points, kEvaluations);
  if (times) {
    std::vector<double> rounds;
    for (int k = 0; k < 51; ++k)
      rounds.push_back(1e3 * microseconds([&] { must(forward_dynamics(arm, ws, q, v, tau)); }, 100));
    std::printf(",%.5g", *std::min_element(rounds.begin(), rounds.end()));
  } else {
    const auto volatile measured = &flexarm_measured;  // so that no compiler makes a version of it under another name
    measured(arm, ws, q, v, tau, kEvaluations);
  }
  std::printf("\n");
}

/// Nanoseconds of one addition or multiplication of doubles when the units for both are never idle: 14 chains, two
/// doubles in each register, as in code for any processor of this kind.
double operation() {
  constexpr int kChains = 14, kTurns = 200000;
  using Pair = Eigen::Array2d;
  const Pair by(0.999, 0.998), plus(0.1, 0.2);
  double best = std::numeric_limits<double>::infinity(), sum = 0.0;
  for (int round = 0; round < 20; ++round) {
    std::array<Pair, kChains> x;
    for (int k = 0; k < kChains; ++k) x[static_cast<std::size_t>(k)] = Pair::Constant(k);
    best = std::min(best, microseconds(
                              [&] {
                                for (int turn = 0; turn < kTurns; ++turn)
                                  for (Pair& c : x) c = c * by + plus;
                              },
                              1));
    for (const Pair& c : x) sum += c.sum();
  }
  if (!std::isfinite(sum)) throw std::runtime_error("the sum is not finite");  // so that nobody leaves the work out
  return 1e3 * best / (4.0 * kChains * kTurns);
}

}  // namespace

int main(int argc, char** argv) {
  const bool times = argc > 1 && std::string(argv[1]) == "times";
  std::printf("name,below,coordinates,points,evaluations%s\n", times ? ",ns" : "");
  for (const Rung& rung : ladder()) run(rung, times);
  if (times) std::printf("# %.4g\n", operation());
}
