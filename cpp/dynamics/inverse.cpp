#include "flexarm/inverse.hpp"

#include "arrays.hpp"
#include "flexarm/dry_friction.hpp"
#include "setup/single.hpp"

namespace flexarm {

void move_chain(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  ws.chain_to_move().move(q.data(), v.data());
}

void stiffness_times(Workspace& ws, const Eigen::VectorXd& x, Eigen::VectorXd& out) {
  ws.placed_chain().stiffness_times(x.data(), out.data());
}

void inverse(Workspace& ws, const double* q, const double* v, const double* a, double* tau) {
  using Array = Eigen::Map<const Eigen::VectorXd>;
  const Eigen::Index nv = ws.tau.size();
  ws.chain_to_move().inverse(q, v, a, tau);
  add_feedback(ws, Array(q, ws.nq()), Array(v, nv), -1.0, Eigen::Map<Eigen::VectorXd>(tau, nv));
}

void inverse_dynamics(const Arm&, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                      const Eigen::VectorXd& a) {
  inverse(ws, q.data(), v.data(), a.data(), ws.tau.data());
}

void joint_forces(const Arm&, Workspace& ws, const Eigen::VectorXd& a) {
  ws.placed_chain().forces(a.data(), ws.tau.data());
}

void take_loop_forces(Workspace& ws, const Eigen::VectorXd& applied, double* out) {
  ws.rest = ws.tau - applied;
  ws.placed_chain().react(ws.rest.data(), ws.spare.data(), out);
  ws.tau -= ws.rest;
}

struct JointReactions::InSpace {
  lanes::SingleFrames frames;
  std::vector<double> wrenches;
};

JointReactions::JointReactions(const Arm& arm, const std::vector<Load>& loads)
    : in_space_(new InSpace{lanes::SingleFrames(arm, loads), std::vector<double>(6 * loads.size())}) {
  if (in_space_->frames.arm().layout().rigid_rows > 0) refuse_loops(arm, "the force through a joint");
}
JointReactions::JointReactions(JointReactions&&) noexcept = default;
JointReactions::~JointReactions() = default;

void JointReactions::set_wrench(std::size_t load, const Vec6<double>& wrench) {
  Eigen::Map<Vec6<double>>(in_space_->wrenches.data() + 6 * load) = wrench;
}

Vec6<double> JointReactions::operator()(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                        const Eigen::VectorXd& a, std::size_t link, bool inboard) {
  const lanes::SingleFrames& frames = in_space_->frames;
  const lanes::KernelArm::Spot& origin = frames.arm().origin(link);
  const Eigen::Vector3d base = -arm.gravity();  // accelerates against gravity
  Vec6<double> F;
  frames->reaction(frames.self(), origin.place, origin.numbers.data(), base.data(), in_space_->wrenches.data(),
                   q.data(), v.data(), a.data(), F.data());
  if (!inboard) return F;
  const auto pose = [&](const lanes::KernelArm::Spot& at) {
    return flexarm::pose(frames, at.place, at.numbers.data(), true);
  };
  const Pose own = pose(origin), seat = arm.parent(link) >= 0 ? pose(frames.arm().seat(arm, link)) : Pose{};
  const Eigen::Matrix3d R = seat.R.transpose() * own.R;
  Vec6<double> out;  // Phi^T F
  out.head<3>() = R * F.head<3>();
  out.tail<3>() =
      R * F.tail<3>() + Eigen::Vector3d(seat.R.transpose() * (own.p - seat.p)).cross(Eigen::Vector3d(out.head<3>()));
  return out;
}

}  // namespace flexarm
