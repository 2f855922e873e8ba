// The lane kernels of one instruction set, as a table of functions.
#pragma once

#include "door/layout.hpp"

namespace flexarm {
namespace lanes {

/// How an arm in fixed steps ended: flexarm::Status and, beyond it, BatchStatus.
enum Ending { ok, singular, not_converged, not_finite, not_done, ended };

/// Options of the one-step methods (methods.hpp); each reads its own.
struct MethodOptions {
  double spectral_radius = 1.0, rtol = 1e-10;
  int max_iterations = 20;
};

/// Properties of a one-step method.
struct MethodTraits {
  const char* name;
  bool rubs;      ///< dry friction is in its equations
  bool iterates;  ///< it reads rtol
  bool damps;     ///< it reads spectral_radius
  double limit;   ///< of its step times the highest frequency; 0: none
};
/// Counts of a method's work.
struct Work {
  long evaluations = 0, factorisations = 0, solves = 0;
};

/// Inputs and outputs of arms in fixed steps. Numbers of lane l are at i width + l.
class Scenarios {
 public:
  /// Writes the inputs at half step `half`: prescribed entries of q, v, a; tau; the laws' offsets; the loads [f; m].
  virtual void set(long half, double* q, double* v, double* a, double* tau, double* offset, double* wrenches) = 0;
  /// Where `step` steps are taken: whether other forces may be held from there on (1), controllers look, which are
  /// shown accelerations (2), or nothing happens (0).
  virtual int due(long step) = 0;
  /// Lets that happen. @return whether other forces act now; in which lanes (1 or 0)
  virtual bool change(long step, const double* q, const double* v, const double* a, double* changed) = 0;
  /// Looks for events in the step to here. @return whether one ends an arm; in which lanes (1 or 0)
  virtual bool look(long step, const double* q, const double* v, double* ended) = 0;
  /// Whether the state after `step` is asked for (1), with accelerations and forces (2), or not (0).
  virtual int wanted(long step) = 0;
  /// @param reactions  force of each contact (3) and then force and moment of each loop (6), in the world
  virtual void row(const double* q, const double* v, const double* a, const double* tau, const double* reactions,
                   const int* status) = 0;
  /// Whether to go on.
  virtual bool alive(long step) = 0;

 protected:
  ~Scenarios() = default;
};

/// Arms in fixed steps: the task of one call. Numbers of lane l are at i width + l.
struct Roll {
  const Layout* layout;
  const double* numbers;  ///< of KernelArm::side_by_side; of one arm, of KernelArm::grouped
  int width;              ///< arms: one, with the points of its beams across the lanes; or one for each lane
  const double* length;   ///< of each step (s)
  long steps;
  int method;  ///< the number of its row in methods.hpp
  MethodOptions options;
  const double* weight;          ///< by lane: mass times gravity squared (N m/s^2)
  const int *free, *coordinate;  ///< rates that are not prescribed; the coordinate of each rate
  int free_count;
  const double *farthest, *fastest;  ///< by lane: sizes of q and v that only a motion has that runs away (see Arm)
  int laws;                          ///< of feedback; their numbers, law by law:
  const double *column, *by_q, *by_v, *limit;  ///< nv, nq, nv, 1
  int limits;                                  ///< rates whose motor has a limit
  const int* limited;                          ///< which
  const double* most;                          ///< of each; infinity where an arm of the pack has none
  int rubs, rubs_given;                        ///< rates with dry friction, and then those of them that are prescribed
  const int* rubbing;                          ///< which
  const double *coulomb, *stiction;            ///< of each
  bool varies;                                 ///< whether `set` gives other values within a step than at its beginning
  bool watched;                                ///< whether there are events
  Scenarios* scenarios;

  int* status;              ///< by lane: an Ending
  long* reached;            ///< by lane: steps
  double *divided, *doubt;  ///< by lane: steps that were divided, and the largest error that one may have
  Work work;                ///< of all lanes together
};

/// Of derivatives: an arm as it is, and grouped for kernels of one arm.
struct SlopesOf {
  const Layout &layout, &grouped;
  const double *numbers, *grouped_numbers;
  const double* remembered;      ///< of contacts, in a run; or null
  const double* held = nullptr;  ///< forces of the rigid rows of loops; or null
};

/// Outcome of a factorisation.
enum class Outcome { good, singular, not_finite };

/// Of one arm, points of its beams lie across the lanes.
struct Kernels {
  const char* name;
  int width;  ///< doubles in a pack
  std::size_t (*memory)(const Layout&);
  /// Lays out the memory (aligned to 64 bytes), which then is `self` for the other functions.
  void (*begin)(const Layout&, const double* numbers, void* memory);
  /// The loads' forces and moments from now on: [f; m] of each.
  void (*load)(void* self, const double* wrenches);
  /// Accelerations; a holds those that are given.
  Outcome (*forward)(void* self, const double* q, const double* v, const double* tau, double* a);
  /// Inverse dynamics.
  void (*inverse)(void* self, const double* q, const double* v, const double* a, double* tau);
  /// Sets coordinates q and rates v; `forward` and `inverse` do so, too. Without v, for `mass_matrix`
  /// alone.
  void (*move)(void* self, const double* q, const double* v);
  /// Inverse dynamics where the chain is.
  void (*forces)(void* self, const double* a, double* tau);
  /// The mass matrix (nv x nv) where the chain is.
  void (*mass_matrix)(void* self, double* M);
  /// The memory of contacts in runs (kRemembered numbers each), and each one's force on the arm, in the world (3),
  /// where the chain was moved last; null: not asked. `recall` sets this memory.
  void (*contacts)(void* self, double* remembered, double* force);
  void (*recall)(void* self, const double* remembered);
  /// Contacts at the end of a step from their memory, with that weight of the force there; negative: at an
  /// instant. `met`: whether any has touched or let go in it.
  void (*step_contacts)(void* self, double by_end);
  bool (*met)(void* self);
  /// Factors M + shift where the chain is, at rates v, and gives v^T M v.
  Outcome (*factor)(void* self, const Shift& shift, const double* v, double* twice_kinetic);
  /// x = (M + shift)^-1 r, zero where given.
  void (*solve)(void* self, const double* r, double* x);
  /// The same for a step of Newton's iteration, of arms with loops (arm/loops.hpp): d^2 g/dt^2 as found by `inverse`
  /// becomes zero, and the residual r loses the loops' forces.
  void (*correct)(void* self, double* r, double* x);
  /// Of arms with rigid loops, by the last factors. Adds accelerations that make d^2 g/dt^2, as found by `inverse`,
  /// zero.
  void (*close_accelerations)(void* self, double* x);
  /// A displacement, of coordinates that are zero before, that closes the loops beside that by these accelerations;
  /// and rates. @return the square of its size in the norm of M + shift
  double (*close_places)(void* self, const Shift& shift, double* w);
  double (*close_rates)(void* self, const Shift& shift, double* z);
  /// Rigid rows hold with the change of force that `correct` has found, too; with none.
  void (*hold_change)(void* self);
  void (*let_go)(void* self);
  /// Whether all are nearly closed where the chain is.
  bool (*closed)(void* self);
  /// Coordinates and rates onto the loops, the nearest in the norm of M + shift; moves the chain. Scratch: nv.
  void (*project)(void* self, const Shift& shift, double* q, double* v, double* scratch);
  /// From nearly there, by the last factors.
  void (*shut)(void* self, double* q, double* v, double* scratch);
  /// Of forces r that inverse dynamics needs beyond all applied ones: those of the loops, force and moment (6) of each
  /// on its side b, in the world; r becomes their generalised forces, beyond those set by `hold`. Scratch: nv.
  void (*react)(void* self, double* r, double* scratch, double* forces);
  /// g, dg/dt and, after `inverse`, d^2 g/dt^2 of each rigid row of the loops, and, unless null, G by columns.
  void (*loop_rows)(void* self, double* rows, double* G);
  /// Forces of the rigid rows from now on.
  void (*hold)(void* self, const double* reactions);
  /// Changes of the forces of joints, beams and struts (nv) where the coordinates change by x (nv, turns of balls),
  /// by their stiffness as implicit steps take it, without loads by state; after `factor` with a shift.
  void (*stiffness_times)(void* self, const double* x, double* out);
  std::size_t (*slopes_memory)(const SlopesOf&);
  /// Exact dtau/dq (nv x nq) and dtau/dv (nv x nv, or null) of inverse dynamics, by columns, and, unless null, those of
  /// d^2 g/dt^2 of the rigid rows of loops, by columns of q and, if asked for, v; memory aligned to 64 bytes.
  void (*inverse_slopes)(const SlopesOf&, void* memory, const double* wrenches, const double* q, const double* v,
                         const double* a, double* by_q, double* by_v, double* loops);
  /// Accelerations of forward dynamics, into a, which holds those that are given; and exact da/dq (nv x nq), da/dv and
  /// da/dtau (nv x nv), by columns, zero where given.
  Outcome (*forward_slopes)(const SlopesOf&, void* memory, const double* wrenches, const double* q, const double* v,
                            const double* tau, double* a, double* by_q, double* by_v, double* by_tau);
};

/// Of several arms, one in each lane. A table of its own: programs that never run arms side by side are linked without.
struct LaneKernels {
  int width;  ///< doubles in a pack
  /// Inverse dynamics of arms side by side (KernelArm::side_by_side), one in each lane, at a state each. Numbers of
  /// lane l are at i width + l; they and the memory are aligned to 64 bytes. Elastic bodies of nodes that are not
  /// `own` (without loads, and not cut) are the same in all lanes, and in all calls from one in which none is `known`
  /// on, at the same q and v: they are bent once.
  std::size_t (*side_memory)(const Layout&);
  void (*inverse_side_by_side)(const Layout&, const double* numbers, const bool* own, void* memory, bool* known,
                               const double* wrenches, const double* q, const double* v, const double* a, double* tau);
  std::size_t (*roll_memory)(Roll&);
  /// From coordinates q and rates v; memory aligned to 64 bytes.
  void (*roll)(Roll&, void* memory, const double* q, const double* v);
};

/// The widest that this processor has; FLEXARM_ISA = base or avx2 in the environment asks for less.
const Kernels& best_kernels();
const LaneKernels& best_lanes();

}  // namespace lanes
}  // namespace flexarm
