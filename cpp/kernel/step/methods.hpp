// The one-step methods, a row each; packs (roll.hpp) and steps of one arm (step.cpp) run on the same text.
//
// The engine of a method: one arm, or an arm in each lane of a pack, with its controllers:
//   Scalar                        double, or Pack; masks say in which lanes
//   free, free_count              the rates that are not prescribed
//   weight                        mass times gravity squared
//   place(q0, u, q)               q = q0 displaced by u, rates times time, on the manifold; not of prescribed ones
//   rates(q, v, dq)               dq/dt, of a quaternion too; normalise(q) gives quaternions unit length
//   step_contacts(by_end), met()  whether forces of contacts are those at the end of a step, and where any touches or
//                                 lets go in it (arm/contacts.hpp)
//   closes()                      whether it has loops
//   close_accelerations(x)        adds those of which their equations at the last `inverse` are fulfilled
//   close_places(shift, w), close_rates(shift, z)  a displacement that makes g zero, and rates that make dg/dt zero,
//                                 while a `correction` of the accelerations moves them, too; by the equations at the
//                                 last `inverse` and the last `factor`. @return its size squared, in the norm of M +
//                                 shift
//   hold_change(open), let_go()   loops hold with the change of force that the last `correction` has found, too; with
//                                 no force
//   closed()                      where their equations were nearly fulfilled there
//   project(shift, q, v, scratch)  onto the loops; shut(q, v, scratch) from nearly there, by the last `factor`
//   accelerate(q, v, tau, x)      forward dynamics; x holds the prescribed ones
//   inverse(q, v, a, tau, anew)   inverse dynamics, and, where `anew`, the data that `factor` needs
//   factor(shift, twice)          of M + shift: where it is positive definite; twice = v^T M v
//   solve(r, x)                   x = (M + shift)^-1 r, zero where prescribed
//   correction(r, x)              the same for a residual at the last `inverse`, up to limits of controllers and back;
//                                 the residual loses the forces of loops.
//                                 @return where `solve` is another from now on
// The interface of a method, a class over the engine, in a header of its own with its row:
//   lay_out                       takes its memory (arena.hpp); the rates that may rub, its options
//   friction()                    its contacts, whose Coulomb friction and stiction the caller sets
//   forget()                      its memory of steps before
//   begin(.., x, where)           begins at a state under these forces; x gets the accelerations.
//                                 @return where there are such
//   accelerate(.., x, where)      accelerations as the method has them, dry friction included; between two switches of
//                                 it, or not
//   step(.., given, skip)         from q, v to those at the end; given(c) sets the inputs at c of the step.
//                                 @return where its equations are solved; elsewhere an arm's end is `unsolved`
//   accept(h, v, x, where)        the step counts; @return where other forces act behind it, so that it must `begin`
//   asked_at_end()                whether the engine was last asked there, up to the last correction
//   q0, v0                        the state before the step, but for prescribed motions
//   iterations, work              of the last step; of all
//   divisions, doubt              steps that were divided, and the largest error that one may have, in each lane
#pragma once

#include "step/alpha.hpp"
#include "step/runge_kutta.hpp"

namespace {

template <class... Rows>
struct MethodTable {
  static constexpr int count = sizeof...(Rows);
  static constexpr MethodTraits traits[] = {Rows::traits...};

  /// Of a name; -1: none.
  static int number(const char* name) {
    for (int k = 0; k < count; ++k)
      if (__builtin_strcmp(traits[k].name, name) == 0) return k;
    return -1;
  }
  /// f of the row of this number, as an object of its type.
  template <class F>
  static void visit(int number, const F& f) {
    int k = 0;
    ((k++ == number ? f(Rows{}) : void()), ...);
  }
};

/// A further method has its row here. (The needs of derivatives of its steps are in step.cpp.)
using Methods = MethodTable<Implicit, Rk4>;

}  // namespace
