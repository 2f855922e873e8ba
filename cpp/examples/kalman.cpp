// The payload of a flexible arm from encoders and strain gauges, in a 1 kHz loop that measures its own times:
//   kalman [--scene FILE] [--cycles N] [--payload KG]
//
// Each cycle steps the plant, an arm with a payload (with hardware, this is where sensors would be read), and then the
// filter, whose arm has none: `predict` under the torques of the last cycle, `update` with the sensors' readings. The
// torques follow from the filter's estimates. Printed at the end: the payload found, and the times of a cycle of the
// filter and of a plain implicit step.
// Exit codes: 0; 1 when the plant or the filter failed; 2 bad arguments.
#include <cmath>
#include <cstdio>
#include <cstring>
#include <flexarm/ci.hpp>
#include <flexarm/kalman.hpp>
#include <flexarm/scene.hpp>
#include <flexarm/step.hpp>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "allocations.hpp"
#include "times.hpp"

using Eigen::Vector3d, Eigen::VectorXd;
using namespace flexarm;

namespace {

constexpr double kPeriod = 1e-3;                      // s
constexpr double kCount = 6.283185307179586 / 16384;  // rad, of encoders
constexpr double kGauge = 2e-6;                       // strain, standard deviation

/// Two links of steel strip in the horizontal plane.
std::vector<Link> strips() {
  std::vector<Link> links;
  for (int k = 0; k < 2; ++k) {
    RigidBody drive;
    drive.mass = 0.3;
    drive.inertia = (k == 0 ? 0.03 : 0.01) * Eigen::Matrix3d::Identity();
    drive.end = {0.05, 0.0, 0.0};
    BeamOptions options;
    options.modes = {2, 0, 0, 0, 0};
    options.basis = Basis::legendre;
    options.damping_ratio = 0.01;
    RigidBody tip;
    tip.mass = k == 0 ? 0.3 : 0.05;
    tip.inertia = 1e-4 * Eigen::Matrix3d::Identity();
    links.emplace_back(Joint::revolute(Vector3d::UnitZ()), drive,
                       Beam(0.4, Section::rectangle(0.004, 0.02), Material(7850.0, 209e9, 0.3), options), tip);
  }
  return links;
}

/// Without gravity.
Arm arm_of(const std::string& scene) {
  if (scene.empty()) return Arm(strips());
#ifdef FLEXARM_SCENES
  const Problem problem = load_problem(scene);
  return Arm(problem.arm->links(), Vector3d::Zero(), problem.arm->seats(), problem.arm->struts(),
             problem.arm->contacts(), problem.arm->loops());
#else
  throw std::invalid_argument("--scene: this flexarm was built without nlohmann/json");
#endif
}

/// The same arm with a point mass at the end of its last link.
Arm loaded(const Arm& arm, double payload) {
  std::vector<Link> links = arm.links();
  std::vector<Arm::Seat> seats = arm.seats();
  RigidBody point;
  point.mass = payload;
  seats.emplace_back(static_cast<int>(links.size()) - 1);
  links.emplace_back(Joint::fixed(), point, std::nullopt, std::nullopt);
  return Arm(std::move(links), arm.gravity(), std::move(seats), arm.struts(), arm.contacts(), arm.loops());
}

int failed(const char* what, int cycle) {
  std::fprintf(stderr, "kalman: the %s could not go on in cycle %d\n", what, cycle);
  return 1;
}

int run(const std::string& scene, int cycles, double payload) {
  const Arm arm = arm_of(scene), plant = loaded(arm, payload);
  std::vector<int> joints;
  std::vector<KalmanSensor> sensors;
  for (std::size_t n = 0; n < arm.size(); ++n) {
    for (int k = 0; k < arm.link(n).nj(); ++k) {
      joints.push_back(arm.first(n) + k);
      sensors.push_back(KalmanSensor::encoder(arm, joints.back(), kCount / std::sqrt(12.0)));
    }
    if (arm.link(n).beam()) sensors.push_back(KalmanSensor::gauge(arm, n, 0.01, 0.002, 0.0, kGauge));
  }
  VectorXd force_noise = VectorXd::Constant(arm.nv(), 1e-4), zero = VectorXd::Zero(arm.nv());
  for (const int i : joints) force_noise[i] = 0.02;
  KalmanFilter filter(Problem(arm), kPeriod, sensors, {{KalmanParameter::payload, 0, payload / 3.0, 2.0 * payload}},
                      force_noise);
  filter.start(zero, zero, VectorXd::Constant(arm.nv(), 0.01), VectorXd::Constant(arm.nv(), 0.01));
  Workspace ws(plant);
  ImplicitStep step(plant, kPeriod);
  composite_mass_matrix(plant, ws, zero);
  const VectorXd inertia = ws.M.diagonal();
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  VectorXd q = zero, v = zero, tau = zero, y(static_cast<Eigen::Index>(sensors.size()));
  std::vector<double> filtered, stepped;
  long asked = 0;
  for (int k = 0; k < cycles; ++k) {
    const double t = k * kPeriod;
    for (std::size_t j = 0; j < joints.size(); ++j) {  // soft PD on the estimates
      const double w = 4.0 + 2.0 * static_cast<double>(j), reference = 0.5 * (1.0 - std::cos(w * t));
      tau[joints[j]] = inertia[joints[j]] * (16.0 * (reference - filter.q()[joints[j]]) - 5.0 * filter.v()[joints[j]]);
    }
    const double start = microseconds();
    if (step(ws, q, v, tau) != Status::ok) return failed("plant", k);
    const double middle = microseconds();
    for (std::size_t i = 0; i < sensors.size(); ++i) {
      const double exact = sensors[i].by_q.dot(q);
      const bool counts = sensors[i].by_q.cwiseAbs().sum() == 1.0;
      y[static_cast<Eigen::Index>(i)] = counts ? kCount * std::round(exact / kCount) : exact + kGauge * normal(random);
    }
    const double again = microseconds(), before = static_cast<double>(allocations);
    counting_allocations = true;
    const bool good = filter.predict(tau) == Status::ok && filter.update(y) == Status::ok;
    counting_allocations = false;
    if (!good) return failed("filter", k);
    asked += allocations - static_cast<long>(before);
    stepped.push_back(middle - start);
    filtered.push_back(microseconds() - again);
  }
  std::printf("%d coordinates, %zu readings a cycle\n", arm.nv(), sensors.size());
  std::printf("payload    %.4f kg, found %.4f +- %.4f kg\n", payload, filter.parameters()[0],
              filter.deviation(2 * arm.nv()));
  const double cycle = print_times("filter", filtered), plain = print_times("step", stepped);
  std::printf("ratio      %.1f\n", cycle / plain);
  if (counts_allocations) std::printf("allocated  %ld times by the filter\n", asked);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  std::string scene;
  int cycles = 2000;
  double payload = 0.3;
  try {
    for (int k = 1; k < argc; ++k) {
      const std::string name = argv[k];
      if (k + 1 == argc) throw std::invalid_argument(name + ": lacks its value");
      const std::string value = argv[++k];
      if (name == "--scene")
        scene = value;
      else if (name == "--cycles")
        cycles = std::stoi(value);
      else if (name == "--payload")
        payload = std::stod(value);
      else
        throw std::invalid_argument(name + ": there is no such option");
    }
    if (cycles < 1) throw std::invalid_argument("--cycles: must be at least 1");
    if (!(payload > 0.0)) throw std::invalid_argument("--payload: must be positive (kg)");
    return run(scene, cycles, payload);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "kalman: %s\n", e.what());
    return 2;
  }
}
