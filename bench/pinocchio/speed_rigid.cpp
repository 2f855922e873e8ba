// Time of one evaluation: pinocchio's aba, crba and rnea and flexarm's counterparts on the same rigid chains, and
// flexarm on flexible arms. bench/speed_rigid.py builds and runs it, twice: portable, and for this processor.
// Prints CSV: a row for each round and function, in nanoseconds of CPU time; all functions in turn, so that ratios hold
// on a noisy machine. Every function runs over the same 16 states. Pinocchio's algorithms come in two conventions
// (world and local axes): both are here. A comment line says how far the two programs' answers differ.
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/config.hpp>
#include <pinocchio/multibody.hpp>

#include <cstdio>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <utility>

#include "common.hpp"
#include "flexarm/ci.hpp"

namespace pin = pinocchio;
using flexarm::Arm;
using flexarm::Workspace;

namespace {

constexpr int kStates = 16;
constexpr double kRound = 1500.0;  // us of one function in one round

/// The same rigid chain in both programs: hinges along z and y in turn, 0.3 m apart, random inertias.
struct Chain {
  pin::Model model;
  std::vector<flexarm::Link> links;
};

Chain rigid(int n) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> u(-1.0, 1.0);
  Chain chain;
  const Eigen::Vector3d end(0.3, 0.0, 0.0), gravity(0, 0, -9.81);
  chain.model.gravity.linear(gravity);
  for (int k = 0; k < n; ++k) {
    flexarm::RigidBody hub;
    hub.mass = 1.0 + 0.5 * u(random);
    hub.com = {0.15 + 0.05 * u(random), 0.05 * u(random), 0.05 * u(random)};
    const Eigen::Matrix3d a =
        Eigen::Matrix3d::NullaryExpr([&](Eigen::Index, Eigen::Index) { return 0.05 * u(random); });
    const Eigen::Matrix3d second = a * a.transpose() + 1e-3 * Eigen::Matrix3d::Identity();
    hub.inertia = second.trace() * Eigen::Matrix3d::Identity() - second;
    hub.end = end;
    const pin::SE3 seat(Eigen::Matrix3d::Identity(), k == 0 ? Eigen::Vector3d::Zero().eval() : end);
    const auto parent = static_cast<pin::JointIndex>(k);
    const std::string name = "joint" + std::to_string(k);
    const pin::JointIndex joint = k % 2 ? chain.model.addJoint(parent, pin::JointModelRY(), seat, name)
                                        : chain.model.addJoint(parent, pin::JointModelRZ(), seat, name);
    chain.model.appendBodyToJoint(joint, pin::Inertia(hub.mass, hub.com, hub.inertia), pin::SE3::Identity());
    const Eigen::Vector3d axis = k % 2 ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitZ();
    chain.links.emplace_back(flexarm::Joint::revolute(axis), hub, std::nullopt, std::nullopt);
  }
  return chain;
}

struct State {
  Eigen::VectorXd q, v, tau;
};

/// Some motion; elastic coordinates move by parts of a millimetre.
std::vector<State> states(const Arm& arm) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> u(-1.0, 1.0);
  std::vector<State> all(kStates);
  for (State& s : all) {
    s = {Eigen::VectorXd(arm.nv()), Eigen::VectorXd(arm.nv()), Eigen::VectorXd::Zero(arm.nv())};
    for (std::size_t n = 0; n < arm.size(); ++n)
      for (int i = 0; i < arm.link(n).nj() + arm.link(n).ne(); ++i) {
        const bool joint = i < arm.link(n).nj();
        const int at = arm.first(n) + i;
        s.q[at] = (joint ? 1.0 : 5e-4) * u(random);
        s.v[at] = (joint ? 1.0 : 5e-3) * u(random);
        if (joint) s.tau[at] = u(random);
      }
  }
  return all;
}

struct Job {
  std::string scene, function;
  std::function<void()> once;  ///< all states
  int repeat = 1;
};

double spread(const Eigen::VectorXd& a, const Eigen::VectorXd& b) { return (a - b).norm() / b.norm(); }

/// flexarm's functions on an arm.
void add_flexarm(std::vector<Job>& jobs, const std::string& scene, const Arm& arm, Workspace& ws,
                 const std::vector<State>& all) {
  jobs.push_back({scene, "flexarm forward dynamics", [&] {
                    for (const State& s : all) flexarm::must(flexarm::forward_dynamics(arm, ws, s.q, s.v, s.tau));
                  }});
  jobs.push_back({scene, "flexarm mass matrix", [&] {
                    for (const State& s : all) {
                      flexarm::move_arm(arm, ws, s.q, s.v);
                      flexarm::composite_mass_matrix(arm, ws);
                    }
                  }});
  jobs.push_back({scene, "flexarm inverse dynamics", [&] {
                    for (const State& s : all) flexarm::inverse_dynamics<double>(arm, ws, s.q, s.v, s.tau);
                  }});
}

/// Everything about one scene, which must outlive its jobs.
struct Scene {
  Arm arm;
  Workspace ws;
  std::vector<State> all;
  std::optional<pin::Model> model;
  std::optional<pin::Data> data;

  explicit Scene(Arm a) : arm(std::move(a)), ws(arm), all(states(arm)) { flexarm::take_composite(arm, ws); }
};

template <class F>
void add_pinocchio(std::vector<Job>& jobs, Scene& s, const std::string& scene, const std::string& function,
                   const F& one) {
  jobs.push_back({scene, function, [&s, one] {
                    for (const State& x : s.all) one(*s.model, *s.data, x);
                  }});
}

void add_rigid(std::vector<Job>& jobs, std::vector<std::unique_ptr<Scene>>& scenes, int n) {
  Chain chain = rigid(n);
  scenes.push_back(std::make_unique<Scene>(Arm(std::move(chain.links), {0, 0, -9.81})));
  Scene& s = *scenes.back();
  s.model = chain.model;
  s.data.emplace(*s.model);
  const State& x = s.all[0];
  flexarm::must(flexarm::forward_dynamics(s.arm, s.ws, x.q, x.v, x.tau));
  const double forward = spread(s.ws.a, pin::aba(*s.model, *s.data, x.q, x.v, x.tau));
  flexarm::inverse_dynamics<double>(s.arm, s.ws, x.q, x.v, x.tau);
  const double inverse = spread(s.ws.tau, pin::rnea(*s.model, *s.data, x.q, x.v, x.tau));
  std::printf("# rigid %d: relative difference of accelerations %.1e, of torques %.1e\n", n, forward, inverse);
  const std::string scene = "rigid " + std::to_string(n);
  for (const auto& [name, convention] : {std::pair<const char*, pin::Convention>{"world", pin::Convention::WORLD},
                                         std::pair<const char*, pin::Convention>{"local", pin::Convention::LOCAL}}) {
    const std::string in = std::string(" (") + name + ")";
    const pin::Convention c = convention;
    add_pinocchio(jobs, s, scene, "pinocchio aba" + in,
                  [c](auto& m, auto& d, const State& y) { pin::aba(m, d, y.q, y.v, y.tau, c); });
    add_pinocchio(jobs, s, scene, "pinocchio crba" + in,
                  [c](auto& m, auto& d, const State& y) { pin::crba(m, d, y.q, c); });
  }
  add_pinocchio(jobs, s, scene, "pinocchio rnea",
                [](auto& m, auto& d, const State& y) { pin::rnea(m, d, y.q, y.v, y.tau); });
  add_flexarm(jobs, scene, s.arm, s.ws, s.all);
}

/// Links on hinges along z, that bend in one plane.
Arm planar(int n, int modes) {
  flexarm::BeamOptions o;
  o.modes = {modes, 0, 0, 0, 0};
  const flexarm::Beam beam(0.5, flexarm::Section::rectangle(0.004, 0.01), flexarm::Material(7850, 209e9, 0.3), o);
  flexarm::RigidBody hub;
  hub.mass = 0.3;
  hub.inertia = Eigen::Vector3d(1e-4, 2e-4, 2e-4).asDiagonal();
  hub.end = {0.075, 0, 0};
  std::vector<flexarm::Link> links;
  for (int k = 0; k < n; ++k)
    links.emplace_back(flexarm::Joint::revolute(Eigen::Vector3d::UnitZ()), hub, beam, std::nullopt);
  return Arm(std::move(links));
}

void add_flexible(std::vector<Job>& jobs, std::vector<std::unique_ptr<Scene>>& scenes, const std::string& name,
                  Arm arm) {
  scenes.push_back(std::make_unique<Scene>(std::move(arm)));
  Scene& s = *scenes.back();
  add_flexarm(jobs, name, s.arm, s.ws, s.all);
}

}  // namespace

int main(int argc, char** argv) {
  const int rounds = argc > 1 ? std::stoi(argv[1]) : 9;
  std::vector<Job> jobs;
  std::vector<std::unique_ptr<Scene>> scenes;
  for (int n : {7, 20, 100}) add_rigid(jobs, scenes, n);
  add_flexible(jobs, scenes, "flexible 7 x (3+3+1)", flexarm::chain(7, {3, 3, 1, 0, 0}, 2));
  add_flexible(jobs, scenes, "planar 2 x 3", planar(2, 3));
  for (Job& job : jobs)
    job.repeat = std::max(1, static_cast<int>(kRound / flexarm::microseconds(job.once, 3)));  // and warms up
  std::printf("# pinocchio %s, %s\nround,scene,function,ns\n", PINOCCHIO_VERSION, __VERSION__);
  for (int round = 0; round < rounds; ++round)
    for (const Job& job : jobs)
      std::printf("%d,%s,%s,%.6g\n", round, job.scene.c_str(), job.function.c_str(),
                  1e3 * flexarm::cpu_microseconds(job.once, job.repeat) / kStates);
}
