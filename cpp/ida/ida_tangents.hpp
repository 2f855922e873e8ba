// IDAS' view of the tangents: their vectors, and the solver of their equations. Included by ida*.cpp alone.
#pragma once

#include <sundials/sundials_nonlinearsolver.h>

#include "flexarm/ida.hpp"
#include "ida_linear.hpp"

namespace flexarm {

/// Owns the objects of IDAS for the tangents of a system. They are corrected after each step's state, by an exact
/// solution of their equations, which are linear: with the matrices of the state reached, whatever solves those of the
/// state.
class TangentPart {
 public:
  TangentPart() = default;
  ~TangentPart();
  TangentPart(const TangentPart&) = delete;
  TangentPart& operator=(const TangentPart&) = delete;

  /// Integrates the tangents of s from where they are, too.
  void attach(void* memory, IdaSystem& s, N_Vector y, SUNContext context, const IdaOptions& options,
              const std::vector<Parameter>& parameters);
  /// Begins anew with the tangents of s.
  void restart(void* memory, const IdaSystem& s);
  /// The tangents at the time reached, into those of s.
  void get(void* memory, IdaSystem& s);

 private:
  void put(const IdaSystem& s);
  int count_ = 0;
  N_Vector *y_ = nullptr, *yp_ = nullptr;
  SUNNonlinearSolver solver_ = nullptr;
};

}  // namespace flexarm
