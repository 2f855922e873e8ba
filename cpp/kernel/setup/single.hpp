// One arm on the lane kernels, with its own memory.
#pragma once

#include <memory>

#include "door/frame_kernels.hpp"
#include "door/kernels.hpp"
#include "setup/kernel_arm.hpp"

namespace flexarm {
namespace lanes {

/// Floating-point operations of one forward dynamics at q, v, in one lane.
long operation_count(const KernelArm& arm, const double* q, const double* v);

/// Memory aligned for the widest pack.
class Memory {
 public:
  explicit Memory(std::size_t bytes = 0) : bytes_(bytes), block_(new unsigned char[bytes + 64]()) {}
  Memory(const Memory& other) : Memory(other.size()) {}  ///< as much, with nothing in it
  Memory(Memory&&) = default;
  Memory& operator=(Memory&&) = default;
  std::size_t size() const { return bytes_; }
  void* get() const {
    void* p = block_.get();
    std::size_t space = bytes_ + 64;
    return std::align(64, bytes_, p, space);
  }

 private:
  std::size_t bytes_;
  std::unique_ptr<unsigned char[]> block_;
};

class Single {
 public:
  Single(const KernelArm& arm, const std::vector<bool>& given)
      : kernels_(best_kernels()), arm_(arm.grouped(kernels_.width, given)), memory_(kernels_.memory(arm_.layout())) {
    begin();
  }
  Single(const Single& other) : kernels_(other.kernels_), arm_(other.arm_), memory_(other.memory_) { begin(); }
  Single& operator=(const Single&) = delete;

  const Layout& layout() const { return arm_.layout(); }
  /// Value of a load from now on.
  void load(const double* wrenches) { kernels_.load(self_, wrenches); }
  Outcome forward(const double* q, const double* v, const double* tau, double* a) {
    return kernels_.forward(self_, q, v, tau, a);
  }
  void inverse(const double* q, const double* v, const double* a, double* tau) {
    kernels_.inverse(self_, q, v, a, tau);
  }
  void move(const double* q, const double* v) { kernels_.move(self_, q, v); }
  void forces(const double* a, double* tau) { kernels_.forces(self_, a, tau); }
  void mass_matrix(double* M) { kernels_.mass_matrix(self_, M); }
  void contacts(double* remembered, double* force) { kernels_.contacts(self_, remembered, force); }
  void step_contacts(double by_end) { kernels_.step_contacts(self_, by_end); }
  bool met() const { return kernels_.met(self_); }
  void recall(const double* remembered) { kernels_.recall(self_, remembered); }
  Outcome factor(const Shift& shift, const double* v, double& twice_kinetic) {
    return kernels_.factor(self_, shift, v, &twice_kinetic);
  }
  void solve(const double* r, double* x) { kernels_.solve(self_, r, x); }
  void correct(double* r, double* x) { kernels_.correct(self_, r, x); }
  void close_accelerations(double* x) { kernels_.close_accelerations(self_, x); }
  double close_places(const Shift& shift, double* w) { return kernels_.close_places(self_, shift, w); }
  double close_rates(const Shift& shift, double* z) { return kernels_.close_rates(self_, shift, z); }
  void hold_change() { kernels_.hold_change(self_); }
  void let_go() { kernels_.let_go(self_); }
  bool closed() const { return kernels_.closed(self_); }
  void project(const Shift& shift, double* q, double* v, double* scratch) {
    kernels_.project(self_, shift, q, v, scratch);
  }
  void shut(double* q, double* v, double* scratch) { kernels_.shut(self_, q, v, scratch); }
  void react(double* r, double* scratch, double* forces) { kernels_.react(self_, r, scratch, forces); }
  void loop_rows(double* rows, double* G) { kernels_.loop_rows(self_, rows, G); }
  void hold(const double* reactions) { kernels_.hold(self_, reactions); }
  void stiffness_times(const double* x, double* out) { kernels_.stiffness_times(self_, x, out); }

 private:
  void begin() {
    self_ = memory_.get();
    kernels_.begin(arm_.layout(), arm_.numbers().data(), self_);
  }

  const Kernels& kernels_;
  KernelArm arm_;
  Memory memory_;
  void* self_ = nullptr;
};

/// Its frames, in space.
class SingleFrames {
 public:
  explicit SingleFrames(const Arm& arm, const FrameKernels& kernels = best_frames())
      : SingleFrames({std::make_shared<MadeOnce>(arm.kept()), &KernelArm::in_space(arm)}, kernels) {}
  /// With loads.
  SingleFrames(const Arm& arm, const std::vector<Load>& loads)
      : SingleFrames(std::make_shared<KernelArm>(KernelArm::in_space(arm).loaded(arm, loads)), best_frames()) {}
  SingleFrames(const SingleFrames& o) : SingleFrames(o.arm_, o.kernels_) {}
  SingleFrames& operator=(const SingleFrames&) = delete;

  const FrameKernels* operator->() const { return &kernels_; }
  const KernelArm& arm() const { return *arm_; }
  void* self() const { return memory_.get(); }

 private:
  SingleFrames(std::shared_ptr<const KernelArm> arm, const FrameKernels& kernels)
      : kernels_(kernels), arm_(std::move(arm)), memory_(kernels_.memory(arm_->layout())) {
    kernels_.begin(arm_->layout(), arm_->numbers().data(), self());
  }

  const FrameKernels& kernels_;
  std::shared_ptr<const KernelArm> arm_;  ///< which is never changed
  Memory memory_;
};

}  // namespace lanes
}  // namespace flexarm
