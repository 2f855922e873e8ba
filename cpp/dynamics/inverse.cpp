#include "flexarm/inverse.hpp"

#include "arrays.hpp"
#include "lanes/single.hpp"

namespace flexarm {

void move_chain(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  ws.chain().move(q.data(), v.data());
}

void inverse(Workspace& ws, const double* q, const double* v, const double* a, double* tau) {
  using Array = Eigen::Map<const Eigen::VectorXd>;
  const Eigen::Index nv = ws.tau.size();
  ws.chain().inverse(q, v, a, tau);
  add_feedback(ws.feedback, Array(q, ws.nq()), Array(v, nv), -1.0, Eigen::Map<Eigen::VectorXd>(tau, nv));
}

void inverse_dynamics(const Arm&, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                      const Eigen::VectorXd& a) {
  inverse(ws, q.data(), v.data(), a.data(), ws.tau.data());
}

void joint_forces(const Arm&, Workspace& ws, const Eigen::VectorXd& a) { ws.chain().forces(a.data(), ws.tau.data()); }

struct JointReactions::InSpace {
  const lanes::FrameKernels& kernels = lanes::best_frames();
  lanes::KernelArm arm;
  lanes::Memory memory;
  std::vector<double> wrenches;

  InSpace(const Arm& of, const std::vector<Load>& loads)
      : arm(lanes::KernelArm::in_space(of).loaded(of, loads)),
        memory(kernels.memory(arm.layout())),
        wrenches(6 * loads.size()) {
    kernels.begin(arm.layout(), arm.numbers().data(), memory.get());
  }
  Pose pose(const lanes::KernelArm::Spot& at) const {
    Pose out;
    Eigen::Matrix<double, 3, 3, Eigen::RowMajor> R;
    kernels.pose(memory.get(), at.place, at.numbers.data(), true, out.p.data(), R.data());
    out.R = R;
    return out;
  }
};

JointReactions::JointReactions(const Arm& arm, const std::vector<Load>& loads)
    : in_space_(std::make_unique<InSpace>(arm, loads)) {}
JointReactions::~JointReactions() = default;

void JointReactions::set_wrench(std::size_t load, const Vec6<double>& wrench) {
  Eigen::Map<Vec6<double>>(in_space_->wrenches.data() + 6 * load) = wrench;
}

Vec6<double> JointReactions::operator()(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                        const Eigen::VectorXd& a, std::size_t link, bool inboard) {
  InSpace& s = *in_space_;
  const lanes::KernelArm::Spot& origin = s.arm.origin(link);
  const Eigen::Vector3d base = -arm.gravity();  // which accelerates against gravity
  Vec6<double> F;
  s.kernels.reaction(s.memory.get(), origin.place, origin.numbers.data(), base.data(), s.wrenches.data(), q.data(),
                     v.data(), a.data(), F.data());
  if (!inboard) return F;
  const Pose own = s.pose(origin), seat = link > 0 ? s.pose(s.arm.end(link - 1)) : Pose{};
  const Eigen::Matrix3d R = seat.R.transpose() * own.R;
  Vec6<double> out;  // Phi^T F
  out.head<3>() = R * F.head<3>();
  out.tail<3>() =
      R * F.tail<3>() + Eigen::Vector3d(seat.R.transpose() * (own.p - seat.p)).cross(Eigen::Vector3d(out.head<3>()));
  return out;
}

}  // namespace flexarm
