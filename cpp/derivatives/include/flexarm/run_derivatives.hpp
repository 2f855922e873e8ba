// Exact derivatives of a run by fixed steps, forward (tangents) and backward (adjoint), along its tape.
#pragma once

#include <vector>

#include "flexarm/parameter.hpp"
#include "flexarm/step.hpp"
#include "flexarm/trajectory.hpp"

namespace flexarm {

/// Both sides of the equations of motion at the places of a tape, (places, nv) each: forces that the motion needs, by
/// inverse dynamics and the dry friction of sliding joints, and forces that are applied, of drives, laws and loads.
/// They are equal where a rate is free. Of an arm with m rigid rows of loops, `needed` has 3 m + 2 nv columns more, all
/// of which are zero: d^2 g/dt^2, g and dg/dt, and both equations of the moves that closed a step (Tape::Closing).
struct Balance {
  Trajectory::Rows needed, applied;
};

/// Keeps, in the tape of this problem, on which side of its limit each law and each motor is at the places, and with
/// which forces loops hold there.
void complete(const Problem& of, Tape& tape);

/// Derivatives of the balance at the places of a tape by each parameter, at fixed q, v and a, but for those prescribed,
/// under the forces that the run's controllers hold.
std::vector<Balance> balance_slopes(const Problem& of, const std::vector<Parameter>& parameters, const Tape& tape,
                                    int threads = 1);

/// The sums of `balance_slopes` over the places of a tape, times weights of its shape: with those of an adjoint, the
/// derivative of its number by each parameter.
Eigen::VectorXd weigh(const Problem& of, const std::vector<Parameter>& parameters, const Tape& tape,
                      const Trajectory::Rows& needed, const Trajectory::Rows& applied, int threads = 1);

/// Steps that this problem takes from the beginnings of the tape's switches.
struct Repeated {
  Trajectory::Rows ends;  ///< [displacement from the coordinates that the tape's step led to; v] (switches, 2 nv)
  std::vector<std::vector<double>> ways;  ///< which way friction went in each (OneStep::way)
};
Repeated repeat_switches(const Problem& of, const Tape& tape, const ImplicitOptions& options);

/// Answers of this problem's sampled laws at the looks of a run's: a row of each, forces (nv) and the new memory of a
/// LinearLaw. Each looks at the run's state, and a LinearLaw goes on from the run's memory; another law must
/// not remember.
Trajectory::Rows repeat_looks(const Problem& of, const Problem& run, const Tape& tape);

/// Derivatives of a number that depends on a run.
struct Adjoint {
  Eigen::VectorXd q0, v0;            ///< by the start
  Trajectory::Rows needed, applied;  ///< by the forces of `Balance` at the places, as if these were free to choose
  Trajectory::Rows switches;         ///< by the result of `repeat_switches`
  Trajectory::Rows held;             ///< by forces that act all through the step of each switch (switches, nv)
  Trajectory::Rows looks;            ///< by the result of `repeat_looks`
};

/// Derivatives of the method's own equations at their solution, exact but for rounding; of steps without equations
/// of their own (Tape::Switch), by differences of such a step.
/// @param switches_by_p  derivatives of `repeat_switches` by each parameter (switches, 2 nv)
/// @param parameters  whose neighbours tell the start, and whose sampled laws are asked too, each at its own state
/// @param accelerations  whether a and tau are asked for as well
/// @param threads  that make slopes; laws of `of` must bear it
/// @return of each parameter derivatives of the rows; of friction none
/// @throws std::invalid_argument for ball joints
std::vector<Trajectory::Tangent> tangents(const Problem& of, const Tape& tape, const ImplicitOptions& options,
                                          const std::vector<Trajectory::Rows>& switches_by_p,
                                          const std::vector<Parameter>& parameters, bool accelerations,
                                          int threads = 1);
/// Derivatives of [q; v] in the last row by that at the start, A (2 nv, 2 nv), and by forces that are held all through
/// the tape, B (2 nv, nv); without sampled laws and balls.
void state_matrices(const Problem& of, const Tape& tape, const ImplicitOptions& options, Eigen::MatrixXd& A,
                    Eigen::MatrixXd& B);
/// @param q, v, a, tau  derivatives of the number by the run's rows (rows, nv); a and tau may be empty
/// @param rough  takes slopes at two places of each step alone, for half the time: exact but for changes of slopes
///               within a step
Adjoint adjoint(const Problem& of, const Tape& tape, const ImplicitOptions& options, const Trajectory::Rows& q,
                const Trajectory::Rows& v, const Trajectory::Rows& a, const Trajectory::Rows& tau, int threads = 1,
                bool rough = false);

}  // namespace flexarm
