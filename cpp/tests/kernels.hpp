// The fast kernels of every instruction set that this processor has, and places of arms to try them at.
#pragma once

#include "arms.hpp"
#include "lanes/single.hpp"

namespace flexarm {
namespace lanes {
extern const Kernels kernels_base;
extern const FrameKernels frames_base;
#ifdef FLEXARM_HAS_AVX2
extern const Kernels kernels_avx2;
extern const FrameKernels frames_avx2;
#endif
#ifdef FLEXARM_HAS_AVX512
extern const Kernels kernels_avx512;
extern const FrameKernels frames_avx512;
#endif
}  // namespace lanes
}  // namespace flexarm

namespace flexarm_test {

inline std::vector<const flexarm::lanes::Kernels*> all_kernels() {
  std::vector<const flexarm::lanes::Kernels*> out{&flexarm::lanes::kernels_base};
#ifdef FLEXARM_HAS_AVX2
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) out.push_back(&flexarm::lanes::kernels_avx2);
#endif
#ifdef FLEXARM_HAS_AVX512
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq"))
    out.push_back(&flexarm::lanes::kernels_avx512);
#endif
  return out;
}

inline std::vector<const flexarm::lanes::FrameKernels*> all_frames() {
  std::vector<const flexarm::lanes::FrameKernels*> out;
  for (const flexarm::lanes::Kernels* k : all_kernels()) {
    if (k == &flexarm::lanes::kernels_base) out.push_back(&flexarm::lanes::frames_base);
#ifdef FLEXARM_HAS_AVX2
    if (k == &flexarm::lanes::kernels_avx2) out.push_back(&flexarm::lanes::frames_avx2);
#endif
#ifdef FLEXARM_HAS_AVX512
    if (k == &flexarm::lanes::kernels_avx512) out.push_back(&flexarm::lanes::frames_avx512);
#endif
  }
  return out;
}

/// One arm on one set of kernels.
struct Fast {
  const flexarm::lanes::Kernels& kernels;
  flexarm::lanes::KernelArm fast;
  flexarm::lanes::Memory memory;
  Fast(const flexarm::Arm& arm, const flexarm::lanes::Kernels& k, const std::vector<bool>& given,
       const std::vector<flexarm::Load>& loads = {})
      : kernels(k),
        fast(flexarm::lanes::KernelArm::of(arm)->loaded(arm, loads).grouped(k.width, given)),
        memory(k.memory(fast.layout())) {
    kernels.begin(fast.layout(), fast.numbers().data(), memory.get());
  }
};

/// A place with beams bent by some tenths of their length (or turned by `bent` radians), and rates.
inline void place(const flexarm::Arm& arm, double phase, Eigen::VectorXd& q, Eigen::VectorXd& v, double bent = 0.1) {
  q = wave(arm.nq(), phase, 1.0);
  v = wave(arm.nv(), phase + 1.0, 1.0);
  for (std::size_t n = 0; n < arm.size(); ++n)
    for (int k = 0; k < arm.link(n).ne(); ++k) {
      const double size = 0.05 + arm.link(n).beam()->tip().linear.col(k).norm();
      q[arm.first_q(n) + arm.link(n).joint().nq() + k] *= bent / size;
      v[arm.first(n) + arm.link(n).nj() + k] *= 0.5 / size;
    }
}

}  // namespace flexarm_test
