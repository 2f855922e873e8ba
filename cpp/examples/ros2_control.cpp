// The calls of a system of ros2_control: an arm of flexarm in the place of its hardware, over the C interface alone.
//
//   ros2_control SCENE.json JOINT RATE [SECONDS]     a loop of 1 kHz that holds JOINT at 0.1 rad by a PD law
//
// ArmSystem has the names and the order of calls of hardware_interface::SystemInterface, but not its types, so that it
// compiles without ROS 2: it was never run in a controller manager. A plug-in derives from that class, keeps an
// ArmSystem, and hands each call on.
#include <flexarm/flexarm.h>

#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

/// One joint of the URDF's <ros2_control>, with its state interfaces and its command interface.
struct Joint {
  std::string name;
  int rate;                                             // its <param>: its place in q, v and tau
  double position = 0.0, velocity = 0.0, effort = 0.0;  // rad, rad/s, N m; or m, m/s, N
  double command = 0.0;                                 // effort
};

class ArmSystem {
 public:
  std::vector<Joint> joints;

  /// on_init: the compiled scene, a <param> of <hardware>; and the joints, with their names and rates.
  bool on_init(const std::string& scene, const std::vector<Joint>& given) {
    scene_.reset(flexarm_load(scene.c_str()));
    if (!scene_) return fail(flexarm_error());
    if (flexarm_nq(scene_.get()) != flexarm_nv(scene_.get())) return fail("an arm with balls has no joint positions");
    for (const Joint& joint : given)
      if (!flexarm_rate_name(scene_.get(), joint.rate)) return fail(joint.name + ": " + flexarm_error());
    joints = given;
    return true;
  }

  /// on_activate: the arm at its start, with the controllers' commands zero.
  bool on_activate() {
    arm_.reset(flexarm_start(scene_.get(), 0.0));
    if (!arm_) return fail(flexarm_error());
    tau_.assign(static_cast<std::size_t>(flexarm_nv(scene_.get())), 0.0);
    for (Joint& joint : joints) joint.command = 0.0;
    return write(0.0) && read(0.0);
  }

  /// read: the arm moves on over the period, under the commands written last; then the states are taken.
  bool read(double period) {
    if (flexarm_advance(arm_.get(), flexarm_time(arm_.get()) + period) != FLEXARM_OK) return fail(flexarm_error());
    const double *q = flexarm_q(arm_.get()), *v = flexarm_v(arm_.get());
    for (Joint& joint : joints) {
      joint.position = q[joint.rate];
      joint.velocity = v[joint.rate];
      joint.effort = tau_[static_cast<std::size_t>(joint.rate)];
    }
    return true;
  }

  /// write: the controllers' efforts act from now on, beside all that acts in the scene itself.
  bool write(double /*period*/) {
    for (const Joint& joint : joints) tau_[static_cast<std::size_t>(joint.rate)] = joint.command;
    return flexarm_set_tau(arm_.get(), tau_.data()) == FLEXARM_OK || fail(flexarm_error());
  }

 private:
  struct Free {
    void operator()(flexarm_scene* scene) const { flexarm_free_scene(scene); }
    void operator()(flexarm_simulation* arm) const { flexarm_free_simulation(arm); }
  };

  static bool fail(const std::string& why) {  // in a plug-in: RCLCPP_ERROR, and return_type::ERROR
    std::fprintf(stderr, "ros2_control: %s\n", why.c_str());
    return false;
  }

  std::unique_ptr<flexarm_scene, Free> scene_;
  std::unique_ptr<flexarm_simulation, Free> arm_;
  std::vector<double> tau_;
};

/// The place of the controller manager: read, the controllers, write.
int main(int argc, char** argv) {
  if (argc < 4) return std::fprintf(stderr, "usage: ros2_control SCENE.json JOINT RATE [SECONDS]\n"), 2;
  const double period = 1e-3, seconds = argc > 4 ? std::atof(argv[4]) : 1.0;
  ArmSystem system;
  if (!system.on_init(argv[1], {Joint{argv[2], std::atoi(argv[3])}}) || !system.on_activate()) return 1;
  Joint& joint = system.joints[0];
  for (int k = 0; k < static_cast<int>(seconds / period + 0.5); ++k) {
    if (k > 0 && !system.read(period)) return 1;
    joint.command = 2.0 * (0.1 - joint.position) - 0.2 * joint.velocity;
    if (!system.write(period)) return 1;
  }
  if (!system.read(period)) return 1;
  std::printf("%s %.17g rad %.17g rad/s\n", joint.name.c_str(), joint.position, joint.velocity);
}
