#include "flexarm/derivatives.hpp"

#include "arrays.hpp"
#include "flexarm/check.hpp"
#include "setup/single.hpp"

namespace flexarm {

namespace lanes {

/// An arm with loads for the kernels' derivatives, and their memory.
class SlopesMemory {
 public:
  SlopesMemory(const Arm& arm, const std::vector<Load>& loads, const std::vector<bool>& prescribed)
      : wrenches(6 * loads.size()),
        arm_(KernelArm::of(arm).loaded(arm, loads)),
        grouped_(arm_.grouped(kernels.width, prescribed)),
        memory_(kernels.slopes_memory(of())) {}
  SlopesOf of() const {
    return {arm_.layout(),
            grouped_.layout(),
            arm_.numbers().data(),
            grouped_.numbers().data(),
            remembered.empty() ? nullptr : remembered.data(),
            held.empty() ? nullptr : held.data()};
  }
  void* memory() const { return memory_.get(); }
  void set_wrench(std::size_t load, const Vec6<double>& wrench) {
    Eigen::Map<Vec6<double>>(wrenches.data() + 6 * load) = wrench;
  }

  const Kernels& kernels = best_kernels();
  std::vector<double> wrenches;
  std::vector<double> remembered, held;  ///< see Workspace

 private:
  KernelArm arm_, grouped_;
  Memory memory_;
};

}  // namespace lanes

InverseDerivatives::InverseDerivatives(const Arm& arm, const std::vector<Load>& loads)
    : dq(Eigen::MatrixXd::Zero(arm.nv(), arm.nq())),
      dv(Eigen::MatrixXd::Zero(arm.nv(), arm.nv())),
      loops(Eigen::MatrixXd::Zero(lanes::KernelArm::of(arm).layout().rigid_rows, arm.nq() + arm.nv())),
      memory_(new lanes::SlopesMemory(arm, loads, {})) {}

void InverseDerivatives::set_wrench(std::size_t load, const Vec6<double>& wrench) { memory_->set_wrench(load, wrench); }

void InverseDerivatives::recall(const Workspace& ws) {
  memory_->remembered = ws.remembered;
  memory_->held = ws.loop_forces;
}

void InverseDerivatives::hold(const Arm& arm, const Eigen::VectorXd& forces) {
  memory_->held.clear();
  if (forces.size() == 0) return;
  const lanes::Layout& layout = lanes::KernelArm::of(arm).layout();
  Eigen::Index all = 0;
  for (std::size_t k = 0; k < arm.loops().size(); ++k) {
    const lanes::LoopJoint& known = layout.loop[k];
    for (const Loop::Row& row : arm.loops()[k].rows()) {
      for (int i = 0; i < known.rows && all < forces.size(); ++i)
        if (known.row[i].turns == row.turns && known.row[i].i == row.i && known.row[i].j == row.j &&
            known.rigid(known.row[i]))
          memory_->held.push_back(forces[all]);
      ++all;
    }
  }
  if (forces.size() != all)
    bad_value("reactions", std::to_string(forces.size()) + " forces",
              "must be one for each row of the loops: " + std::to_string(all));
}

void InverseDerivatives::operator()(const Arm&, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                    const Eigen::VectorXd& a, bool by_v) {
  memory_->kernels.inverse_slopes(memory_->of(), memory_->memory(), memory_->wrenches.data(), q.data(), v.data(),
                                  a.data(), dq.data(), by_v ? dv.data() : nullptr,
                                  loops.size() > 0 ? loops.data() : nullptr);
}

ForwardDerivatives::ForwardDerivatives(const Arm& arm, const std::vector<Load>& loads,
                                       const std::vector<bool>& prescribed)
    : dq(Eigen::MatrixXd::Zero(arm.nv(), arm.nq())),
      dv(Eigen::MatrixXd::Zero(arm.nv(), arm.nv())),
      dtau(dv),
      a(Eigen::VectorXd::Zero(arm.nv())),
      memory_(new lanes::SlopesMemory(arm, loads, prescribed)) {}

void ForwardDerivatives::set_wrench(std::size_t load, const Vec6<double>& wrench) { memory_->set_wrench(load, wrench); }

Status ForwardDerivatives::operator()(const Arm&, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                      const Eigen::VectorXd& tau) {
  const Status status =
      status_of(memory_->kernels.forward_slopes(memory_->of(), memory_->memory(), memory_->wrenches.data(), q.data(),
                                                v.data(), tau.data(), a.data(), dq.data(), dv.data(), dtau.data()));
  return status != Status::ok || (all_finite(q) && all_finite(v) && all_finite(a)) ? status : Status::not_finite;
}

MotionDerivatives::MotionDerivatives(const Arm& arm, std::size_t link, std::optional<double> x)
    : dq(Eigen::MatrixXd::Zero(12, arm.nq())),
      dv(Eigen::MatrixXd::Zero(12, arm.nv())),
      at_(arm, link, x),
      kept_(arm.kept()),
      known_(&lanes::KernelArm::in_space(arm)),
      memory_(new lanes::Memory(lanes::best_frames().slopes_memory(known_->layout()))) {}

void MotionDerivatives::operator()(const Arm&, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                   const Eigen::VectorXd& a) {
  lanes::best_frames().slopes(known_->layout(), known_->numbers().data(), memory_->get(), at_.place(), at_.numbers(),
                              q.data(), v.data(), a.data(), dq.data(), dv.data());
}

Mat6X<double> MotionDerivatives::jacobian_rate(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  Eigen::VectorXd rate(arm.nq());
  coordinate_rates(arm, q, v, rate);
  Mat6X<double> J(6, arm.nv());
  lanes::best_frames().jacobian_rate(known_->layout(), known_->numbers().data(), memory_->get(), at_.place(),
                                     at_.numbers(), q.data(), rate.data(), J.data());
  return J;
}

}  // namespace flexarm
