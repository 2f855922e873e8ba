// Forward dynamics of a robot with closed loops, by flexarm and by pinocchio in turn, in one process.
// bench/run/loops_pinocchio.py writes the robot, builds this and runs it:  speed_loops ROBOT.json ROBOT.txt ROUNDS
// Prints CSV: a row for each round and function, in nanoseconds of CPU time, as speed_rigid.cpp does.
#include <cstdio>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include "common.hpp"
#include "flexarm/scene.hpp"
#include "loops_peer.hpp"

using Eigen::VectorXd;

namespace {

constexpr double kRound = 3000.0;  // us of one function in one round

struct State {
  VectorXd q, v, tau;
};

VectorXd read(std::istream& file, int size) {
  VectorXd x(size);
  for (double& number : x) file >> number;
  if (!file) throw std::invalid_argument("the robot's file ends too early");
  return x;
}

State state(std::istream& file, int nq, int nv) {
  VectorXd q = read(file, nq), v = read(file, nv), tau = read(file, nv);
  return {std::move(q), std::move(v), std::move(tau)};
}

flexarm::Arm without_loops(const flexarm::Arm& arm) { return flexarm::Arm(arm.links(), arm.gravity(), arm.seats()); }

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) throw std::invalid_argument("speed_loops ROBOT.json ROBOT.txt ROUNDS");
  const flexarm::Problem problem = flexarm::load_problem(argv[1]);
  const flexarm::Arm& arm = *problem.arm;
  std::ifstream file(argv[2]);
  LoopPeer peer(file);
  const VectorXd rates = read(file, static_cast<int>(read(file, 1)[0]));  // of pinocchio's, their numbers here
  const int count = static_cast<int>(read(file, 1)[0]), nq = static_cast<int>(read(file, 1)[0]);
  std::vector<State> own, others;
  for (int k = 0; k < count; ++k) {
    own.push_back(state(file, nq, arm.nv()));
    others.push_back(state(file, nq, arm.nv()));
  }
  flexarm::Workspace ws(arm);
  const flexarm::Arm tree = without_loops(arm);
  flexarm::Workspace of_tree(tree);

  double constrained = 0.0, articulated = 0.0, free = 0.0;
  const auto off = [&](const VectorXd& a, const VectorXd& b) {
    VectorXd here(a.size());
    for (Eigen::Index i = 0; i < b.size(); ++i) here[static_cast<Eigen::Index>(rates[i])] = b[i];
    return (here - a).cwiseAbs().maxCoeff() / a.cwiseAbs().maxCoeff();
  };
  for (std::size_t k = 0; k < own.size(); ++k) {
    const State &x = own[k], &y = others[k];
    flexarm::must(flexarm::forward_dynamics(arm, ws, x.q, x.v, x.tau));
    flexarm::must(flexarm::forward_dynamics(tree, of_tree, x.q, x.v, x.tau));
    constrained = std::max(constrained, off(ws.a, peer.constrained(y.q, y.v, y.tau)));
    articulated = std::max(articulated, off(ws.a, peer.articulated(y.q, y.v, y.tau)));
    free = std::max(free, off(of_tree.a, peer.tree(y.q, y.v, y.tau)));
  }
  std::printf("# accelerations are apart by at most, relative: constraintDynamics %.0e, lcaba %.0e, aba %.0e\n",
              constrained, articulated, free);
  std::printf("# pinocchio %s, GCC %s\nround,function,ns\n", LoopPeer::version(), __VERSION__);

  struct Job {
    std::string function;
    std::function<void()> once;  ///< all states
    int repeat = 1;
  };
  std::vector<Job> jobs;
  const auto add = [&](const std::string& name, const std::vector<State>& states, const auto& one) {
    jobs.push_back({name, [&states, one] {
                      for (const State& x : states) one(x);
                    }});
  };
  add("flexarm", own, [&](const State& x) { flexarm::must(flexarm::forward_dynamics(arm, ws, x.q, x.v, x.tau)); });
  add("constraintDynamics", others, [&](const State& x) { peer.constrained(x.q, x.v, x.tau); });
  add("lcaba", others, [&](const State& x) { peer.articulated(x.q, x.v, x.tau); });
  add("flexarm, tree", own,
      [&](const State& x) { flexarm::must(flexarm::forward_dynamics(tree, of_tree, x.q, x.v, x.tau)); });
  add("aba", others, [&](const State& x) { peer.tree(x.q, x.v, x.tau); });
  for (Job& job : jobs)
    job.repeat = std::max(1, static_cast<int>(kRound / flexarm::cpu_microseconds(job.once, 20)));  // and warms up
  for (int round = 0; round < std::stoi(argv[3]); ++round)
    for (const Job& job : jobs)
      std::printf("%d,\"%s\",%.6g\n", round, job.function.c_str(),
                  1e3 * flexarm::cpu_microseconds(job.once, job.repeat) / static_cast<double>(own.size()));
}
