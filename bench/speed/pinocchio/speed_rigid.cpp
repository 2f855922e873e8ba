// Time of one evaluation: pinocchio's aba, crba, rnea and computeABADerivatives and flexarm's counterparts on the same
// rigid chains, and flexarm on flexible arms. bench/speed/speed_rigid.py builds and runs it, twice: portable, and for
// this processor. Prints CSV: a row for each round and function, in nanoseconds of CPU time; all functions in turn, so
// that ratios hold on a noisy machine. Every function runs over the same 16 states. Pinocchio's algorithms come in two
// conventions (world and local axes): both are here. A comment line says how far the two programs' answers differ.
#include <cstdio>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <utility>

#include "common.hpp"
#include "peer.hpp"

using flexarm::Arm;
using flexarm::Workspace;

namespace {

constexpr int kStates = 16;
constexpr double kRound = 1500.0;  // us of one function in one round

const Eigen::Vector3d kEnd(0.3, 0.0, 0.0), kGravity(0.0, 0.0, -9.81);

/// Rigid bodies with random inertias.
std::vector<PeerBody> bodies(int n) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> u(-1.0, 1.0);
  std::vector<PeerBody> all;
  for (int k = 0; k < n; ++k) {
    const double mass = 1.0 + 0.5 * u(random), x = u(random), y = u(random), z = u(random);
    const Eigen::Matrix3d a =
        Eigen::Matrix3d::NullaryExpr([&](Eigen::Index, Eigen::Index) { return 0.05 * u(random); });
    const Eigen::Matrix3d second = a * a.transpose() + 1e-3 * Eigen::Matrix3d::Identity();
    all.push_back({mass, {0.15 + 0.05 * x, 0.05 * y, 0.05 * z}, second.trace() * Eigen::Matrix3d::Identity() - second});
  }
  return all;
}

/// The same chain as Peer's.
Arm rigid(const std::vector<PeerBody>& all) {
  std::vector<flexarm::Link> links;
  for (const PeerBody& body : all) {
    flexarm::RigidBody hub;
    hub.mass = body.mass;
    hub.com = body.com;
    hub.inertia = body.inertia;
    hub.end = kEnd;
    const Eigen::Vector3d axis = links.size() % 2 ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitZ();
    links.emplace_back(flexarm::Joint::revolute(axis), hub, std::nullopt, std::nullopt);
  }
  return Arm(std::move(links), kGravity);
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

template <class M>
double spread(const M& a, const M& b) {
  return (a - b).norm() / b.norm();
}

/// Everything about one scene, which must outlive its jobs.
struct Scene {
  Arm arm;
  Workspace ws;
  flexarm::ForwardDerivatives derivatives;
  std::vector<State> all;
  std::optional<Peer> peer;

  explicit Scene(Arm a) : arm(std::move(a)), ws(arm), derivatives(arm), all(states(arm)) {
    flexarm::take_composite(arm, ws);
  }
};

/// flexarm's functions on an arm.
void add_flexarm(std::vector<Job>& jobs, const std::string& scene, Scene& x) {
  const auto add = [&](const std::string& function, const auto& one) {
    jobs.push_back({scene, "flexarm " + function, [&x, one] {
                      for (const State& s : x.all) one(x, s);
                    }});
  };
  add("forward dynamics",
      [](Scene& y, const State& s) { flexarm::must(flexarm::forward_dynamics(y.arm, y.ws, s.q, s.v, s.tau)); });
  add("mass matrix", [](Scene& y, const State& s) { flexarm::composite_mass_matrix(y.arm, y.ws, s.q); });
  add("inverse dynamics", [](Scene& y, const State& s) { flexarm::inverse_dynamics(y.arm, y.ws, s.q, s.v, s.tau); });
  add("derivatives", [](Scene& y, const State& s) { flexarm::must(y.derivatives(y.arm, s.q, s.v, s.tau)); });
}

template <class F>
void add_peer(std::vector<Job>& jobs, Scene& s, const std::string& scene, const std::string& function, const F& one) {
  jobs.push_back({scene, "pinocchio " + function, [&s, one] {
                    for (const State& x : s.all) one(*s.peer, x);
                  }});
}

void add_rigid(std::vector<Job>& jobs, std::vector<std::unique_ptr<Scene>>& scenes, int n) {
  const std::vector<PeerBody> all = bodies(n);
  scenes.push_back(std::make_unique<Scene>(rigid(all)));
  Scene& s = *scenes.back();
  s.peer.emplace(all, kEnd, kGravity);
  const State& x = s.all[0];
  flexarm::must(flexarm::forward_dynamics(s.arm, s.ws, x.q, x.v, x.tau));
  const double forward = spread<Eigen::VectorXd>(s.ws.a, s.peer->aba(x.q, x.v, x.tau, false));
  flexarm::inverse_dynamics(s.arm, s.ws, x.q, x.v, x.tau);
  const double inverse = spread<Eigen::VectorXd>(s.ws.tau, s.peer->rnea(x.q, x.v, x.tau));
  flexarm::must(s.derivatives(s.arm, x.q, x.v, x.tau));
  s.peer->aba_derivatives(x.q, x.v, x.tau);
  Eigen::MatrixXd own(n, 2 * n);
  own << s.derivatives.dq, s.derivatives.dv;
  std::printf("# rigid %d: relative difference of accelerations %.1e, of torques %.1e, of derivatives %.1e\n", n,
              forward, inverse, spread(own, s.peer->last_derivatives()));
  const std::string scene = "rigid " + std::to_string(n);
  for (bool local : {false, true}) {
    const std::string in = local ? " (local)" : " (world)";
    add_peer(jobs, s, scene, "aba" + in, [local](Peer& p, const State& y) { p.aba(y.q, y.v, y.tau, local); });
    add_peer(jobs, s, scene, "crba" + in, [local](Peer& p, const State& y) { p.crba(y.q, local); });
  }
  add_peer(jobs, s, scene, "rnea", [](Peer& p, const State& y) { p.rnea(y.q, y.v, y.tau); });
  add_peer(jobs, s, scene, "computeABADerivatives",
           [](Peer& p, const State& y) { p.aba_derivatives(y.q, y.v, y.tau); });
  add_flexarm(jobs, scene, s);
}

void add_flexible(std::vector<Job>& jobs, std::vector<std::unique_ptr<Scene>>& scenes, const std::string& name,
                  Arm arm) {
  scenes.push_back(std::make_unique<Scene>(std::move(arm)));
  Scene& s = *scenes.back();
  add_flexarm(jobs, name, s);
}

}  // namespace

int main(int argc, char** argv) {
  const int rounds = argc > 1 ? std::stoi(argv[1]) : 9;
  std::vector<Job> jobs;
  std::vector<std::unique_ptr<Scene>> scenes;
  for (int n : {7, 20, 100}) add_rigid(jobs, scenes, n);
  add_flexible(jobs, scenes, "flexible 7 x (3+3+1)", flexarm::chain(7, {3, 3, 1, 0, 0}, 2));
  add_flexible(jobs, scenes, "planar 2 x 3", flexarm::chain(2, {3, 0, 0, 0, 0}, 2, true));
  for (Job& job : jobs)
    job.repeat = std::max(1, static_cast<int>(kRound / flexarm::microseconds(job.once, 3)));  // and warms up
  std::printf("# pinocchio %s, %s\nround,scene,function,ns\n", Peer::version(), __VERSION__);
  for (int round = 0; round < rounds; ++round)
    for (const Job& job : jobs)
      std::printf("%d,%s,%s,%.6g\n", round, job.scene.c_str(), job.function.c_str(),
                  1e3 * flexarm::cpu_microseconds(job.once, job.repeat) / kStates);
}
