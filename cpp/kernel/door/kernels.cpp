#include "door/kernels.hpp"
#include "door/frame_kernels.hpp"

#include <cstdlib>
#include <cstring>
#include <stdexcept>

namespace flexarm {
namespace lanes {

extern const Kernels kernels_base;
extern const FrameKernels frames_base;
extern const LaneKernels lanes_base;
#ifdef FLEXARM_HAS_AVX2
extern const Kernels kernels_avx2;
extern const FrameKernels frames_avx2;
extern const LaneKernels lanes_avx2;
#endif
#ifdef FLEXARM_HAS_AVX512
extern const Kernels kernels_avx512;
extern const FrameKernels frames_avx512;
extern const LaneKernels lanes_avx512;
#endif

namespace {

/// Of one instruction set.
struct Set {
  const Kernels& kernels;
  const FrameKernels& frames;
};

Set choose() {
#ifndef FLEXARM_HAS_AVX2
  if (const char* asked = std::getenv("FLEXARM_ISA"); asked && std::strcmp(asked, "avx2") == 0)
    throw std::runtime_error("FLEXARM_ISA = \"avx2\": this build has no kernels for it; build with FLEXARM_SETS=ALL");
#endif
#if defined(FLEXARM_HAS_AVX2) || defined(FLEXARM_HAS_AVX512)
  const char* asked = std::getenv("FLEXARM_ISA");
  const auto allowed = [&](const char* name) { return !asked || std::strcmp(asked, name) == 0; };
  const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#endif
#ifdef FLEXARM_HAS_AVX512
  const bool avx512 = avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                      __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw");
  if (avx512 && allowed("avx512")) return {kernels_avx512, frames_avx512};
#endif
#ifdef FLEXARM_HAS_AVX2
  if (avx2 && (allowed("avx2") || allowed("avx512"))) return {kernels_avx2, frames_avx2};
#endif
  return {kernels_base, frames_base};
}

const Set& best() {
  static const Set set = choose();
  return set;
}

}  // namespace

const Kernels& best_kernels() { return best().kernels; }
const FrameKernels& best_frames() { return best().frames; }
const LaneKernels& best_lanes() {  // in no table with the others
#ifdef FLEXARM_HAS_AVX512
  if (&best_kernels() == &kernels_avx512) return lanes_avx512;
#endif
#ifdef FLEXARM_HAS_AVX2
  if (&best_kernels() == &kernels_avx2) return lanes_avx2;
#endif
  return lanes_base;
}

}  // namespace lanes
}  // namespace flexarm
