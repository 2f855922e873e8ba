// The kernels of kinematic outputs, as a table of functions.
#pragma once

#include "door/layout.hpp"

namespace flexarm {
namespace lanes {

/// Of a whole arm, world axes.
struct Sums {
  double kinetic;    ///< J
  double mass;       ///< kg
  double moment[3];  ///< mass times centre of mass (kg m)
  double momentum[6];
};

/// Of arms in space (KernelArm::in_space). `self` is memory (aligned to 64 bytes) that `begin` has laid out; numbers of
/// a place are those of KernelArm's spots. Vectors are [linear; angular], world axes.
struct FrameKernels {
  std::size_t (*memory)(const Layout&);
  void (*begin)(const Layout&, const double* numbers, void* memory);
  /// Places and velocities of all frames.
  void (*place)(void* self, const double* q, const double* v);
  /// Accelerations; after `place`. The base accelerates by `base`.
  void (*accelerate)(void* self, const double* base, const double* a);
  /// Place (3) and orientation (3 x 3, by rows) of a place in the world, or in its node's axes.
  void (*pose)(void* self, const Place&, const double* numbers, bool in_world, double* p, double* R);
  /// Jacobian, 6 x nv by columns (Eq. 91).
  void (*jacobian)(void* self, const Place&, const double* numbers, double* J);
  /// Velocity and acceleration (Eq. 85, 86), 6 each; after `accelerate`.
  void (*motion)(void* self, const Place&, const double* numbers, double* velocity, double* acceleration);
  /// Force and moment (6) through the joint of a link of which `link` is its own frame, on it and in its axes (Eq. 84);
  /// of an arm with its loads' values. Places all frames.
  void (*reaction)(void* self, const Place& link, const double* numbers, const double* base, const double* wrenches,
                   const double* q, const double* v, const double* a, double* out);
  void (*sums)(void* self, const double* q, const double* v, Sums& out);
  /// Of each contact its gap and rate, and the normal force.
  void (*contacts)(void* self, const double* q, const double* v, double* motion);
  /// g and dg/dt of each row of the loops.
  void (*loops)(void* self, const double* q, const double* v, double* motion);
  /// Of each strut its length, rate and force, which a driven force adds to, and dl/dq (nv) behind those of the one
  /// before.
  void (*struts)(void* self, const double* q, const double* v, const double* driven, double* motion, double* by_q);
  std::size_t (*slopes_memory)(const Layout&);
  /// Exact derivatives of [velocity; acceleration] at fixed a, by q (12 x nq) and v (12 x nv), by columns.
  void (*slopes)(const Layout&, const double* arm, void* memory, const Place&, const double* numbers, const double* q,
                 const double* v, const double* a, double* by_q, double* by_v);
  /// Time derivative of the Jacobian where the coordinates change at `rate` (nq).
  void (*jacobian_rate)(const Layout&, const double* arm, void* memory, const Place&, const double* numbers,
                        const double* q, const double* rate, double* J);
};

/// Of the instruction set of `best_kernels`.
const FrameKernels& best_frames();

}  // namespace lanes
}  // namespace flexarm
