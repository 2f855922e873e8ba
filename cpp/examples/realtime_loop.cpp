// A 1 kHz loop that controls a flexible arm by its model, and measures its own times:
//   realtime_loop [--seconds S] [--links N | --scene FILE] [--strain GAIN] [--free]
//
// Every millisecond it steps the plant, an arm with a heavier payload than in its controller's model (with hardware,
// this is where encoders and strain gauges would be read), and computes the torques of the next one:
//   1. reference: a smooth motion of the joints. The tip must follow the tip of a rigid arm: a correction, slower than
//      the first mode, moves the joints by the damped inverse of the Jacobian.
//   2. joints: computed torque. PD gives the desired accelerations; with those prescribed, forward dynamics gives the
//      beams' accelerations, and the inward sweep of inverse dynamics the torques: all couplings, exactly, O(N).
//   3. strain feedback: the rate of curvature at each beam's root (a strain gauge there) adds to its joint's
//      acceleration. It damps bending, which stiff PD control of the joints does not.
// Halfway a force acts on the tip. --strain multiplies the gain of 3; 0 shows the vibration without it. --free runs
// without sleeping, to measure the computation alone. Latencies and the error of the tip are printed at the end.
// Exit codes: 0; 1 when the arm ran away; 2 bad arguments.
#include <sched.h>
#include <sys/mman.h>
#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <flexarm/ab.hpp>
#include <flexarm/scene.hpp>
#include <flexarm/step.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "allocations.hpp"

using Eigen::Vector3d, Eigen::VectorXd;

namespace {

constexpr double kPeriod = 1e-3;  // s
constexpr double kKnock = 0.01;   // s, of a knock at the tip, halfway

struct Arguments {
  double seconds = 5.0, strain = 1.0;
  std::string scene;
  int links = 7;
  bool free = false;
};

/// Links of thinning aluminium tubes, turning about z and y by turns, with motors in their hubs.
flexarm::Arm chain(int links, double payload) {
  using namespace flexarm;
  std::vector<Link> parts;
  const double radius = 0.004 + 0.0023 * links;  // m: of the flexible tube
  for (int k = 0; k < links; ++k) {
    const double size = 1.0 - 0.7 * k / std::max(links, 2);
    RigidBody motor;
    motor.mass = 2.0 * size * size;
    motor.inertia = 1e-3 * motor.mass * Eigen::Matrix3d::Identity();
    motor.end = {0.05, 0.0, 0.0};
    BeamOptions options;
    options.modes = {3, 3, 1, 0, 0};
    options.damping_ratio = 0.003;
    const Section tube = Section::circle(radius * size, 0.9 * radius * size);
    std::optional<RigidBody> tip;
    if (k + 1 == links) {
      tip.emplace();
      tip->mass = payload;
    }
    JointForce drive;
    drive.damping = 0.5 * size * size;            // N m s/rad
    drive.reflected_inertia = 0.5 * size * size;  // kg m^2: a rotor of 5e-5 behind a gear of 100
    const Vector3d axis = k % 2 == 0 ? Vector3d::UnitZ() : Vector3d::UnitY();
    parts.emplace_back(Joint({{true, axis}}, false, {"revolute"}, {drive}), motor,
                       Beam(0.3, tube, Material(2700.0, 70e9, 0.33), options), tip);
  }
  return Arm(std::move(parts), {0.0, 0.0, -9.81});
}

flexarm::Arm plant_of(const Arguments& a) {
#ifdef FLEXARM_SCENES
  if (!a.scene.empty()) return *flexarm::load_problem(a.scene).arm;
#else
  if (!a.scene.empty()) throw std::invalid_argument("--scene: this flexarm was built without nlohmann/json");
#endif
  return chain(a.links, 0.25);
}

/// Joints with one freedom, their coordinates, and the initial state.
std::vector<int> joints_of(const flexarm::Arm& arm) {
  std::vector<int> joints;
  for (std::size_t n = 0; n < arm.size(); ++n)
    for (int k = 0; k < arm.link(n).nj(); ++k) {
      joints.push_back(arm.first(n) + k);
      if (arm.coordinate_of(joints.back()) < 0) throw std::invalid_argument("--scene: balls have no reference here");
    }
  if (joints.empty()) throw std::invalid_argument("--scene: the arm has no joint that moves");
  return joints;
}

std::vector<bool> flags(const flexarm::Arm& arm, const std::vector<int>& joints) {
  std::vector<bool> out(static_cast<std::size_t>(arm.nv()), false);
  for (const int i : joints) out[static_cast<std::size_t>(i)] = true;
  return out;
}

/// All memory is taken by the constructor; `torques` allocates nothing.
class Controller {
 public:
  Controller(flexarm::Arm model, double strain)
      : arm_(std::move(model)),
        joints_(joints_of(arm_)),
        ws_(arm_, flags(arm_, joints_)),
        stiff_(arm_),
        strain_(strain),
        q_stiff_(arm_.zero()),
        zero_(VectorXd::Zero(arm_.nv())),
        tau_(zero_),
        shift_(VectorXd::Zero(static_cast<Eigen::Index>(joints_.size()))),
        shift_rate_(shift_),
        J_(6, arm_.nv()) {
    for (const flexarm::Link& link : arm_.links())
      for (int s = 0; s < flexarm::kStrains; ++s)
        gauges_.push_back(link.beam() ? link.beam()->shapes(s).at(0.0).strain : VectorXd());
  }

  /// Generalised forces (nv) for the state measured at time t (s).
  const VectorXd* torques(double t, const VectorXd& q, const VectorXd& v) {
    // where the tip of a stiff arm would be, and where this one's is
    for (std::size_t k = 0; k < joints_.size(); ++k)
      q_stiff_[arm_.coordinate_of(joints_[k])] = reference(t, static_cast<int>(k)).q;
    flexarm::move_arm(arm_, stiff_, q_stiff_, zero_);
    wanted_ = tip_of(stiff_);
    flexarm::move_arm(arm_, ws_, q, v);
    error_ = wanted_ - tip_of(ws_);
    correct();
    for (std::size_t k = 0; k < joints_.size(); ++k) {
      const int i = joints_[k], c = arm_.coordinate_of(i);
      const Motion r = reference(t, static_cast<int>(k));
      const auto j = static_cast<Eigen::Index>(k);
      ws_.a[i] = r.a + kStiffness * (r.q + shift_[j] - q[c]) + kDamping * (r.v + shift_rate_[j] - v[i]);
    }
    add_strain_feedback(v);
    if (flexarm::forward_dynamics(arm_, ws_, q, v, zero_) != flexarm::Status::ok) return nullptr;
    flexarm::joint_forces(arm_, ws_, ws_.a);
    for (const int i : joints_) tau_[i] = ws_.tau[i];
    return tau_.allFinite() ? &tau_ : nullptr;
  }

  double tip_error() const { return error_.norm(); }  ///< m, at the last call
  std::size_t joints() const { return joints_.size(); }

 private:
  static constexpr double kStiffness = 64.0, kDamping = 16.0;  // 1/s^2, 1/s: 8 rad/s, critically damped
  static constexpr double kTip = 2.0;                          // 1/s, of the correction at the tip
  static constexpr double kStrain = 0.8;                       // m rad/s: joint's acceleration per rate of curvature
  static constexpr double kSingular = 0.05;  // m, below which the Jacobian's directions are left alone

  struct Motion {
    double q, v, a;
  };
  /// Sines of all joints, faded in and out over two seconds.
  static Motion reference(double t, int joint) {
    const double w = 1.2, size = 0.25, phase = 0.9 * joint, T = 2.0, x = std::min(t / T, 1.0);
    const double f = x * x * x * (10.0 - 15.0 * x + 6.0 * x * x), df = 30.0 * x * x * (1.0 - x) * (1.0 - x) / T;
    const double ddf = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / (T * T);
    const double s = std::sin(w * t + phase), ds = w * std::cos(w * t + phase), dds = -w * w * s;
    return {size * f * s, size * (df * s + f * ds), size * (ddf * s + 2.0 * df * ds + f * dds)};
  }

  Vector3d tip_of(const flexarm::Workspace& ws) const {
    const std::size_t last = arm_.size() - 1;
    return flexarm::slice_pose(ws, last).p;
  }

  /// Moves the joints' references against the error of the tip, by damped least squares.
  void correct() {
    const std::size_t last = arm_.size() - 1;
    flexarm::slice_jacobian(arm_, ws_, last, J_);
    Eigen::Matrix3d JJ = kSingular * kSingular * Eigen::Matrix3d::Identity();
    for (const int i : joints_) JJ.noalias() += J_.col(i).head<3>() * J_.col(i).head<3>().transpose();
    const Vector3d y = JJ.ldlt().solve(kTip * error_);
    for (std::size_t k = 0; k < joints_.size(); ++k) {
      const auto j = static_cast<Eigen::Index>(k);
      shift_rate_[j] = J_.col(joints_[k]).head<3>().dot(y);
      shift_[j] += kPeriod * shift_rate_[j];
    }
  }

  void add_strain_feedback(const VectorXd& v) {
    for (std::size_t n = 0; n < arm_.size(); ++n) {
      const flexarm::Link& link = arm_.link(n);
      if (!link.beam()) continue;
      Vector3d rate = Vector3d::Zero();  // of K1, K2, K3 at the root
      for (int s = 0; s < flexarm::kStrains; ++s) {
        const flexarm::StrainField& field = flexarm::kStrainFields[s];
        const VectorXd& gauge = gauges_[n * flexarm::kStrains + static_cast<std::size_t>(s)];
        const int first = arm_.first(n) + link.nj() + link.beam()->first(s);
        if (field.bending) rate[field.strain] += field.sign * gauge.dot(v.segment(first, gauge.size()));
      }
      const Vector3d in_world = flexarm::link_pose(ws_, n).R * rate;
      for (int i = arm_.first(n); i < arm_.first(n) + link.nj(); ++i)  // a joint turns the tip about its own axis
        ws_.a[i] += strain_ * kStrain * J_.col(i).tail<3>().dot(in_world);
    }
  }

  flexarm::Arm arm_;
  std::vector<int> joints_;
  flexarm::Workspace ws_, stiff_;  // at the state measured, its joints prescribed; of the stiff arm
  double strain_;
  std::vector<VectorXd> gauges_;  // per link and strain: strain at the root per coordinate
  VectorXd q_stiff_, zero_, tau_;
  VectorXd shift_, shift_rate_;
  flexarm::Mat6X<double> J_;
  Vector3d wanted_ = Vector3d::Zero(), error_ = Vector3d::Zero();
};

double now() {
  timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// Sleeps until a millisecond after the last due time.
void sleep_a_period(timespec& due) {
  due.tv_nsec += 1000000;
  if (due.tv_nsec >= 1000000000) {
    due.tv_nsec -= 1000000000;
    ++due.tv_sec;
  }
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, nullptr);
}

/// Requests real-time settings from the system and prints which it grants.
void ask_for_real_time(bool free) {
  const auto granted = [](bool yes) { return yes ? "yes" : std::strerror(errno); };
  std::printf("mlockall: %s\n", granted(mlockall(MCL_CURRENT | MCL_FUTURE) == 0));
  if (free) {
    std::printf("SCHED_FIFO: not asked for, since it never sleeps\n");
    return;
  }
  sched_param priority{};
  priority.sched_priority = 80;
  std::printf("SCHED_FIFO 80: %s\n", granted(sched_setscheduler(0, SCHED_FIFO, &priority) == 0));
  volatile char stack[256 * 1024];  // touched now to avoid later page faults
  for (std::size_t k = 0; k < sizeof stack; k += 1024) stack[k] = 0;
}

void report(const char* what, std::vector<double>& s) {
  std::sort(s.begin(), s.end());
  const auto at = [&](double p) { return 1e6 * s[static_cast<std::size_t>(p * static_cast<double>(s.size() - 1))]; };
  std::printf("%s (us): median %.1f  p99.9 %.1f  max %.1f\n", what, at(0.5), at(0.999), at(1.0));
  for (double low = 1.0; low < at(1.0); low *= std::sqrt(2.0)) {  // us
    const auto below = [&](double x) { return std::lower_bound(s.begin(), s.end(), 1e-6 * x) - s.begin(); };
    const long n = below(low * std::sqrt(2.0)) - below(low);
    if (n == 0) continue;
    const int bar = static_cast<int>(std::ceil(50.0 * static_cast<double>(n) / static_cast<double>(s.size())));
    std::printf("%9.0f .. %-7.0f %8ld %.*s\n", low, low * std::sqrt(2.0), n, bar,
                "##################################################");
  }
}

int run(const Arguments& a) {
  const flexarm::Arm plant = plant_of(a);
  Controller controller(a.scene.empty() ? chain(a.links, 0.2) : plant, a.strain);
  flexarm::Workspace ws(plant, {}, {flexarm::Load::at_end(plant, plant.size() - 1, true)});
  double mass = 0.0;
  for (const flexarm::Link& link : plant.links()) mass += link.mass();
  flexarm::ImplicitOptions options;
  options.spectral_radius = 0.9;  // the plant's modes too fast for a millisecond die out
  flexarm::ImplicitStep step(plant, kPeriod, options);
  const auto cycles = static_cast<std::size_t>(std::lround(a.seconds / kPeriod));
  std::vector<double> computation(cycles), late(cycles);
  VectorXd q = plant.zero(), v = VectorXd::Zero(plant.nv());
  flexarm::Status status = flexarm::Status::ok;
  double square = 0.0, worst = 0.0;
  long overruns = 0;
  int most = 0;
  std::size_t settled = 0, done = 0;
  ask_for_real_time(a.free);

  timespec next;
  clock_gettime(CLOCK_MONOTONIC, &next);
  counting_allocations = true;
  for (; done < cycles && status == flexarm::Status::ok; ++done) {
    if (!a.free) sleep_a_period(next);
    const double begin = now(), due = static_cast<double>(next.tv_sec) + 1e-9 * static_cast<double>(next.tv_nsec);
    const double t = kPeriod * static_cast<double>(done);
    const bool knocked = t >= 0.5 * a.seconds && t < 0.5 * a.seconds + kKnock;
    ws.loads[0].wrench[1] = knocked ? 0.05 * mass / kKnock : 0.0;  // N: 5 cm/s for the whole arm
    const VectorXd* tau = controller.torques(t, q, v);
    status = tau ? step.jump(ws, q, v, *tau) : flexarm::Status::not_finite;  // torques jump at each sample
    if (status == flexarm::Status::ok) status = step(ws, q, v, *tau);
    most = std::max(most, step.iterations());
    if (t >= 0.6 * a.seconds) {
      square += controller.tip_error() * controller.tip_error();
      worst = std::max(worst, controller.tip_error());
      ++settled;
    }
    computation[done] = now() - begin;
    late[done] = begin - due;
    overruns += computation[done] + (a.free ? 0.0 : late[done]) > kPeriod;
  }
  counting_allocations = false;

  if (status != flexarm::Status::ok) {
    std::fprintf(stderr, "the arm ran away after %zu ms\n", done);
    return 1;
  }
  std::printf("%zu cycles of 1 ms, %zu links, %zu joints, %d coordinates\n", cycles, plant.size(), controller.joints(),
              plant.nv());
  report("computation", computation);
  if (!a.free) report("woken late", late);
  std::printf("cycles over 1 ms: %ld; iterations of a step: %d at most\n", overruns, most);
  if (counts_allocations)
    std::printf("allocations in the loop: %ld\n", allocations);
  else
    std::printf("allocations in the loop: not counted in this build\n");
  std::printf("tip error from 0.1 of the time behind the knock on (mm): rms %.3f  max %.3f\n",
              1e3 * std::sqrt(square / static_cast<double>(std::max<std::size_t>(settled, 1))), 1e3 * worst);
  return 0;
}

Arguments read(int argc, char** argv) {
  Arguments a;
  for (int k = 1; k < argc; ++k) {
    const std::string name = argv[k];
    if (name == "--free") {
      a.free = true;
      continue;
    }
    if (k + 1 == argc) throw std::invalid_argument(name + ": needs a value, or is unknown");
    const std::string value = argv[++k];
    if (name == "--scene") {
      a.scene = value;
      continue;
    }
    char* end = nullptr;
    const double number = std::strtod(value.c_str(), &end);
    if (end == value.c_str() || *end != '\0' || !std::isfinite(number))
      throw std::invalid_argument(name + " = " + value + ": must be a number");
    if (name == "--seconds" && number >= 0.01 && number <= 3600.0)
      a.seconds = number;
    else if (name == "--links" && number >= 1 && number <= 8 && number == std::floor(number))
      a.links = static_cast<int>(number);
    else if (name == "--strain" && number >= 0.0)
      a.strain = number;
    else
      throw std::invalid_argument(name + " = " + value +
                                  ": known are --seconds 0.01 to 3600, --links 1 to 8, --scene FILE, --strain 0 or "
                                  "more, --free");
  }
  return a;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(read(argc, argv));
  } catch (const std::exception& e) {
    std::fprintf(stderr, "realtime_loop: %s\n", e.what());
    return 2;
  }
}
