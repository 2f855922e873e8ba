// Model predictive control of a flexible arm, in a 1 kHz loop that measures its own times:
//   mpc [--links N] [--horizon S] [--stages N] [--blocks N] [--modes N] [--cycles N] [--filter 0|1]
//
// Links of steel strip move in the horizontal plane from rest to a pose, under limited torques and strains. Each cycle
// steps the plant (with hardware, this is where sensors would be read), then a Kalman filter estimates its state from
// encoders and strain gauges (with --filter 0 the plant's own state is taken), and Mpc answers. Printed at the end: how
// near the tip came, and the times of a cycle: `feedback`, between a measurement and its torques, and the whole, with
// `prepare`, which can run after them.
// Exit codes: 0; 1 when a step failed; 2 bad arguments.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <flexarm/ci.hpp>
#include <flexarm/kalman.hpp>
#include <flexarm/mpc.hpp>
#include <flexarm/step.hpp>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "allocations.hpp"
#include "times.hpp"

using Eigen::Vector3d, Eigen::VectorXd;
using namespace flexarm;

namespace {

constexpr double kPeriod = 1e-3;                      // s
constexpr double kCount = 6.283185307179586 / 65536;  // rad, of encoders
constexpr double kGauge = 2e-6;                       // strain, standard deviation

using Options = std::map<std::string, double>;

Arm strips(int links, int modes) {
  std::vector<Link> out;
  for (int k = 0; k < links; ++k) {
    RigidBody drive;
    drive.mass = 0.3;
    drive.inertia = 0.03 / (1 + k) * Eigen::Matrix3d::Identity();
    drive.end = {0.05, 0.0, 0.0};
    BeamOptions options;
    options.modes = {modes, 0, 0, 0, 0};
    options.basis = Basis::legendre;
    options.damping_ratio = 0.01;
    RigidBody tip;
    tip.mass = k + 1 < links ? 0.2 : 0.05;
    tip.inertia = 1e-4 * Eigen::Matrix3d::Identity();
    out.emplace_back(Joint::revolute(Vector3d::UnitZ()), drive,
                     Beam(0.4, Section::rectangle(0.004, 0.02), Material(7850.0, 209e9, 0.3), options), tip);
  }
  return Arm(std::move(out));
}

int failed(const char* what, int cycle) {
  std::fprintf(stderr, "mpc: the %s could not go on in cycle %d\n", what, cycle);
  return 1;
}

int run(const Options& given) {
  const int links = static_cast<int>(given.at("--links")), cycles = static_cast<int>(given.at("--cycles"));
  const bool filtered = given.at("--filter") != 0.0;
  const Arm arm = strips(links, static_cast<int>(given.at("--modes")));
  const VectorXd zero = VectorXd::Zero(arm.nv());
  std::vector<int> joints;
  std::vector<KalmanSensor> sensors;
  std::vector<MpcOutput> outputs;
  MpcOptions options;
  options.period = kPeriod;
  options.horizon = given.at("--horizon");
  options.stages = static_cast<int>(given.at("--stages"));
  options.blocks = static_cast<int>(given.at("--blocks"));
  options.columns = Eigen::MatrixXd::Zero(arm.nv(), links);
  options.upper = VectorXd::Zero(links);
  VectorXd force_noise = VectorXd::Constant(arm.nv(), 1e-4), goal = VectorXd::Zero(2 * links);
  for (int k = 0; k < links; ++k) {
    const auto n = static_cast<std::size_t>(k);
    joints.push_back(arm.first(n));
    options.columns(joints[n], k) = 1.0;
    options.upper[k] = 6.0 / (1 << k);  // N m
    force_noise[joints[n]] = 0.02;
    sensors.push_back(KalmanSensor::encoder(arm, joints[n], kCount / std::sqrt(12.0)));
    sensors.push_back(KalmanSensor::gauge(arm, n, 0.01, 0.002, 0.0, kGauge));
    outputs.push_back(MpcOutput::joint(arm, joints[n]));
    outputs.back().weight = 10.0;
    outputs.back().rate_weight = 0.1;
    outputs.push_back(MpcOutput());  // the strain at its root, of which only the size matters
    outputs.back().by_q = sensors.back().by_q;
    outputs.back().upper = 4e-4;
    outputs.back().lower = -4e-4;
    goal[2 * k] = 0.8 / (1 + k);  // rad
  }
  options.lower = -options.upper;
  options.rate_limit = 2000.0 * VectorXd::Ones(links);  // N m/s
  options.effort = 1e-3 * VectorXd::Ones(links);
  options.rate_effort = 1e-6 * VectorXd::Ones(links);
  Mpc mpc(Problem(arm), outputs, options, [&goal](double, VectorXd& value, VectorXd& rate) {
    value = goal;
    rate.setZero();
  });
  KalmanFilter filter(Problem(arm), kPeriod, sensors, {}, force_noise);
  filter.start(zero, zero, VectorXd::Constant(arm.nv(), 1e-3), VectorXd::Constant(arm.nv(), 1e-3));

  Workspace ws(arm);
  ImplicitStep plant(arm, kPeriod);
  VectorXd q = zero, v = zero, y(static_cast<Eigen::Index>(sensors.size()));
  std::vector<double> answered, whole;
  double most_torque = 0.0, most_strain = 0.0;
  long asked = 0, fallbacks = 0;
  int most_iterations = 0;
  for (int k = 0; k < cycles; ++k) {
    if (plant(ws, q, v, mpc.forces()) != Status::ok) return failed("plant", k);
    for (std::size_t i = 0; i < sensors.size(); ++i) {
      const double exact = sensors[i].by_q.dot(q);
      y[static_cast<Eigen::Index>(i)] = i % 2 == 0 ? kCount * std::round(exact / kCount) : exact;
      if (i % 2 == 1) most_strain = std::max(most_strain, std::abs(exact));
    }
    if (filtered && (filter.predict(mpc.forces()) != Status::ok || filter.update(y) != Status::ok))
      return failed("filter", k);
    const long before = allocations;
    counting_allocations = true;
    const double start = microseconds();
    fallbacks += mpc.feedback(k * kPeriod, filtered ? filter.q() : q, filtered ? filter.v() : v) != Status::ok;
    const double middle = microseconds();
    mpc.prepare();
    const double end = microseconds();
    counting_allocations = false;
    asked += allocations - before;
    answered.push_back(middle - start);
    whole.push_back(end - start);
    most_torque = std::max(most_torque, (mpc.u().cwiseAbs().array() / options.upper.array()).maxCoeff());
    most_iterations = std::max(most_iterations, mpc.qp_iterations());
  }
  double off = 0.0;
  for (int k = 0; k < links; ++k) off = std::max(off, std::abs(q[joints[static_cast<std::size_t>(k)]] - goal[2 * k]));
  std::printf("%d links, %d coordinates; %d stages, %d inputs over %g s\n", links, arm.nv(), options.stages,
              options.blocks * links, options.horizon);
  std::printf("at %g s    joints within %.2g rad of the goal; torque %.3f, strain %.3f of their limits\n",
              cycles * kPeriod, off, most_torque, most_strain / 4e-4);
  std::printf("fallbacks  %ld; active set: at most %d iterations\n", fallbacks, most_iterations);
  print_times("feedback", answered);
  print_times("cycle", whole);
  if (counts_allocations) std::printf("allocated  %ld times by Mpc\n", asked);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  Options given = {{"--links", 3}, {"--horizon", 0.5}, {"--stages", 25}, {"--blocks", 12},
                   {"--modes", 2}, {"--cycles", 2000}, {"--filter", 1}};
  try {
    for (int k = 1; k < argc; ++k) {
      const std::string name = argv[k];
      if (given.count(name) == 0) throw std::invalid_argument(name + ": there is no such option");
      if (k + 1 == argc) throw std::invalid_argument(name + ": lacks its value");
      given[name] = std::stod(argv[++k]);
    }
    for (const char* name : {"--links", "--modes", "--cycles"})
      if (!(given[name] >= 1.0 && given[name] < 1e7)) throw std::invalid_argument(std::string(name) + ": at least 1");
    return run(given);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "mpc: %s\n", e.what());
    return 2;
  }
}
