// The lane kernels of one instruction set, as a table of functions.
#pragma once

#include "lanes/layout.hpp"

namespace flexarm {
namespace lanes {

/// A pack of scenarios in fixed steps: what one call does. Numbers of lane l are at i width + l.
struct Roll {
  const Layout* layout;
  const double* numbers;  ///< of KernelArm::side_by_side
  const double* length;   ///< of each step (s)
  long steps;
  bool implicit;                 ///< generalised-alpha, or else rk4
  double spectral_radius, rtol;  ///< of generalised-alpha
  int max_iterations;
  const double* weight;          ///< by lane: mass times gravity squared (N m/s^2)
  const int *free, *coordinate;  ///< rates that are not prescribed; the coordinate of each rate
  int free_count;
  const double *farthest, *fastest;  ///< by lane: sizes of q and v that only a motion has that runs away (see Arm)
  int laws;                          ///< of feedback; their numbers, law by law:
  const double *column, *by_q, *by_v, *limit;  ///< nv, nq, nv, 1
  int rubs, rubs_given;                        ///< rates with dry friction, and then those of them that are prescribed
  const int* rubbing;                          ///< which
  const double *coulomb, *stiction;            ///< of each
  bool varies;                                 ///< whether `set` gives other values within a step than at its beginning

  void* context;
  /// What is given at half step `half`, forces as held over `step`: prescribed entries of q, v, a; tau; the laws'
  /// offsets; the loads [f; m].
  void (*set)(void* context, long step, long half, double* q, double* v, double* a, double* tau, double* offset,
              double* wrenches);
  /// Whether other forces are held from `step` on than before; in which lanes (1 or 0).
  bool (*jumps)(void* context, long step, double* changed);
  /// Whether the state after `step` is asked for (1), with accelerations and forces (2), or not (0).
  int (*wanted)(void* context, long step);
  void (*row)(void* context, const double* q, const double* v, const double* a, const double* tau, const int* status);
  bool (*alive)(void* context, long step);

  int* status;                               ///< by lane: those of flexarm::Status, or 4: not done
  long* reached;                             ///< by lane: steps
  long evaluations, factorisations, solves;  ///< of the pack
};

/// Of one arm, points of its beams lie across the lanes.
struct Kernels {
  const char* name;
  int width;  ///< doubles in a pack
  std::size_t (*memory)(const Layout&);
  /// Lays out the memory (aligned to 64 bytes), which then is the `self` of what follows.
  void (*begin)(const Layout&, const double* numbers, void* memory);
  /// The loads' forces and moments from now on: [f; m] of each.
  void (*load)(void* self, const double* wrenches);
  /// Accelerations; a holds those that are given. @return whether the mass matrix is positive definite
  bool (*forward)(void* self, const double* q, const double* v, const double* tau, double* a);
  /// Inverse dynamics.
  void (*inverse)(void* self, const double* q, const double* v, const double* a, double* tau);
  /// After `inverse` at rates v: factors M + shift, and gives v^T M v.
  bool (*factor)(void* self, const Shift& shift, const double* v, double* twice_kinetic);
  /// x = (M + shift)^-1 r, zero where given.
  void (*solve)(void* self, const double* r, double* x);
  std::size_t (*roll_memory)(const Roll&);
  /// From coordinates q and rates v; memory aligned to 64 bytes.
  void (*roll)(Roll&, void* memory, const double* q, const double* v);
  std::size_t (*slopes_memory)(const Layout&);
  /// Exact dtau/dq (nv x nq) and dtau/dv (nv x nv) of inverse dynamics, by columns; numbers of a KernelArm that is
  /// not grouped, memory aligned to 64 bytes.
  void (*slopes)(const Layout&, const double* numbers, const double* wrenches, void* memory, const double* q,
                 const double* v, const double* a, double* by_q, double* by_v);
};

/// The widest that this processor has; FLEXARM_ISA = base or avx2 in the environment asks for less.
const Kernels& best_kernels();

}  // namespace lanes
}  // namespace flexarm
