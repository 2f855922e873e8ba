// SUNDIALS' view of the linear systems: owns the matrix or the Krylov solver. Included by ida*.cpp alone.
#pragma once

#include <idas/idas.h>
#include <nvector/nvector_serial.h>
#include <sundials/sundials_config.h>

#include <stdexcept>

#include "ida_system.hpp"

namespace flexarm {

inline void check_flag(int flag) {
  if (flag < 0) throw std::runtime_error("SUNDIALS set-up failed, flag " + std::to_string(flag));
}

class LinearPart {
 public:
  LinearPart() = default;
  ~LinearPart();
  LinearPart(const LinearPart&) = delete;
  LinearPart& operator=(const LinearPart&) = delete;

  /// Attaches the solver of s.dense or of s.chain, whichever there is, to IDA's memory.
  void attach(void* memory, IdaSystem& s, N_Vector y, SUNContext context);

 private:
  SUNMatrix matrix_ = nullptr;
  SUNLinearSolver solver_ = nullptr;
};

}  // namespace flexarm
