#include "flexarm/derivatives.hpp"

#include <memory>

#include "lanes/frame_kernels.hpp"
#include "lanes/kernel_arm.hpp"
#include "lanes/kernels.hpp"

namespace flexarm {

namespace {

constexpr std::size_t kAligned = 64;  // bytes, as the kernels want their memory

/// Memory within, as the kernels want it.
void* aligned(std::vector<double>& memory) {
  void* at = memory.data();
  std::size_t space = memory.size() * sizeof(double);
  return std::align(kAligned, space - kAligned, at, space);
}

}  // namespace

InverseDerivatives::InverseDerivatives(const Arm& arm, const std::vector<Load>& loads)
    : dq(Eigen::MatrixXd::Zero(arm.nv(), arm.nq())),
      dv(Eigen::MatrixXd::Zero(arm.nv(), arm.nv())),
      known_(std::make_shared<const lanes::KernelArm>(lanes::KernelArm::of(arm).loaded(arm, loads))),
      wrenches_(6 * loads.size()),
      memory_((kAligned + lanes::best_kernels().slopes_memory(known_->layout())) / sizeof(double) + 1) {}

void InverseDerivatives::set_wrench(std::size_t load, const Vec6<double>& wrench) {
  Eigen::Map<Vec6<double>>(wrenches_.data() + 6 * load) = wrench;
}

void InverseDerivatives::operator()(const Arm&, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                    const Eigen::VectorXd& a, bool by_v) {
  lanes::best_kernels().slopes(known_->layout(), known_->numbers().data(), wrenches_.data(), aligned(memory_), q.data(),
                               v.data(), a.data(), dq.data(), by_v ? dv.data() : nullptr);
}

MotionDerivatives::MotionDerivatives(const Arm& arm, std::size_t link, std::optional<double> x)
    : dq(Eigen::MatrixXd::Zero(12, arm.nq())),
      dv(Eigen::MatrixXd::Zero(12, arm.nv())),
      at_(arm, link, x),
      kept_(arm.kept()),
      known_(&lanes::KernelArm::in_space(arm)),
      memory_((kAligned + lanes::best_frames().slopes_memory(known_->layout())) / sizeof(double) + 1) {}

void MotionDerivatives::operator()(const Arm&, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                   const Eigen::VectorXd& a) {
  lanes::best_frames().slopes(known_->layout(), known_->numbers().data(), aligned(memory_), at_.place(), at_.numbers(),
                              q.data(), v.data(), a.data(), dq.data(), dv.data());
}

Mat6X<double> MotionDerivatives::jacobian_rate(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  Eigen::VectorXd rate(arm.nq());
  coordinate_rates(arm, q, v, rate);
  Mat6X<double> J(6, arm.nv());
  lanes::best_frames().jacobian_rate(known_->layout(), known_->numbers().data(), aligned(memory_), at_.place(),
                                     at_.numbers(), q.data(), rate.data(), J.data());
  return J;
}

}  // namespace flexarm
