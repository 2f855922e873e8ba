#include "ida_linear.hpp"

#include <sunlinsol/sunlinsol_dense.h>
#include <sunlinsol/sunlinsol_spgmr.h>
#include <sunmatrix/sunmatrix_dense.h>

#include <cstdlib>
#include <new>

#include "flexarm/ci.hpp"

namespace flexarm {

namespace {

constexpr int kKrylov = 10;  // vectors

/// dF/dy + cj dF/dy'
int dense_jacobian(sunrealtype t, sunrealtype cj, N_Vector y, N_Vector yp, N_Vector, SUNMatrix J, void* data, N_Vector,
                   N_Vector, N_Vector) {
  IdaSystem& s = *static_cast<IdaSystem*>(data);
  DenseJacobian& d = *s.dense;
  try {
    s.set(t, N_VGetArrayPointer(y), N_VGetArrayPointer(yp));
    for (std::size_t k = 0; k < s.ws.loads.size(); ++k) d.derivatives.set_wrench(k, s.ws.loads[k].wrench);
    d.derivatives(s.arm, s.q, s.v, s.a);
    move_arm<double>(s.arm, s.ws, s.q, s.v);
    composite_mass_matrix(s.arm, s.ws);
    coordinate_rate_jacobians(s.arm, s.q, s.v, d.rate_by_q, d.rate_by_v);
    const int nq = s.n_q(), nv = s.n_v();
    for (int k = 0; k < nq; ++k) {
      const int j = s.free_q[k];
      double* column = SUNDenseMatrix_Column(J, k);
      for (int l = 0; l < nq; ++l) column[l] = -d.rate_by_q(s.free_q[l], j);
      column[k] += cj;
      for (int l = 0; l < nv; ++l) column[nq + l] = d.derivatives.dq(s.ws.free[l], j);
    }
    for (int k = 0; k < nv; ++k) {
      const int j = s.ws.free[k];
      double* column = SUNDenseMatrix_Column(J, nq + k);
      for (int l = 0; l < nq; ++l) column[l] = -d.rate_by_v(s.free_q[l], j);
      for (int l = 0; l < nv; ++l) {
        const int i = s.ws.free[l];
        column[nq + l] = d.derivatives.dv(i, j) + cj * s.ws.M(i, j);
      }
    }
    return 0;
  } catch (...) {
    s.thrown = std::current_exception();
    return -1;
  }
}

/// (dF/dy + cj dF/dy') x by a difference quotient of the residual r, over a distance as large as the tolerance.
int chain_times(sunrealtype t, N_Vector y, N_Vector yp, N_Vector r, N_Vector x, N_Vector Jx, sunrealtype cj, void* data,
                N_Vector ahead, N_Vector ahead_p) {
  IdaSystem& s = *static_cast<IdaSystem*>(data);
  try {
    check_flag(IDAGetErrWeights(s.memory, ahead));
    const double size = N_VWrmsNorm(x, ahead);
    if (size == 0.0) {
      N_VConst(0.0, Jx);
      return 0;
    }
    const double step = 1.0 / size;
    N_VLinearSum(1.0, y, step, x, ahead);
    N_VLinearSum(1.0, yp, step * cj, x, ahead_p);
    s.set(t, N_VGetArrayPointer(ahead), N_VGetArrayPointer(ahead_p));
    if (!s.residual(N_VGetArrayPointer(ahead_p), N_VGetArrayPointer(Jx))) return 1;
    N_VLinearSum(1.0 / step, Jx, -1.0 / step, r, Jx);
    return 0;
  } catch (...) {
    s.thrown = std::current_exception();
    return -1;
  }
}

int chain_setup(sunrealtype t, N_Vector y, N_Vector yp, N_Vector, sunrealtype cj, void* data) {
  IdaSystem& s = *static_cast<IdaSystem*>(data);
  try {
    s.set(t, N_VGetArrayPointer(y), N_VGetArrayPointer(yp));
    return s.chain->factor(s.q, s.v, cj) ? 0 : 1;
  } catch (...) {
    s.thrown = std::current_exception();
    return -1;
  }
}

int chain_solve(sunrealtype, N_Vector, N_Vector, N_Vector, N_Vector r, N_Vector x, sunrealtype cj, sunrealtype,
                void* data) {
  IdaSystem& s = *static_cast<IdaSystem*>(data);
  const double* pr = N_VGetArrayPointer(r);
  double* px = N_VGetArrayPointer(x);
  const int nq = s.n_q(), nv = s.n_v();
  for (int k = 0; k < nq; ++k) s.r1[s.free_q[k]] = pr[k];
  for (int k = 0; k < nv; ++k) s.r2[s.ws.free[k]] = pr[nq + k];
  s.chain->solve(s.r1, s.r2, cj, s.x1, s.x2);
  for (int k = 0; k < nq; ++k) px[k] = s.x1[s.free_q[k]];
  for (int k = 0; k < nv; ++k) px[nq + k] = s.x2[s.ws.free[k]];
  return 0;
}

struct Sweep { void* data = nullptr; SUNPSetupFn setup = nullptr; SUNPSolveFn solve = nullptr; };
SUNLinearSolver sweep_solver(SUNContext context) {
  SUNLinearSolver S = SUNLinSolNewEmpty(context);
  S->content = new Sweep;
  S->ops->gettype = [](SUNLinearSolver) { return SUNLINEARSOLVER_ITERATIVE; };
  S->ops->getid = [](SUNLinearSolver) { return SUNLINEARSOLVER_CUSTOM; };
  S->ops->setatimes = [](SUNLinearSolver, void*, SUNATimesFn) { return 0; };
  S->ops->setpreconditioner = [](SUNLinearSolver L, void* d, SUNPSetupFn a, SUNPSolveFn b) {
    *static_cast<Sweep*>(L->content) = {d, a, b}; return 0; };
  S->ops->initialize = [](SUNLinearSolver) { return 0; };
  S->ops->setup = [](SUNLinearSolver L, SUNMatrix) { auto* w = static_cast<Sweep*>(L->content); return w->setup(w->data); };
  S->ops->solve = [](SUNLinearSolver L, SUNMatrix, N_Vector x, N_Vector b, sunrealtype tol) {
    auto* w = static_cast<Sweep*>(L->content); return w->solve(w->data, b, x, tol, 1); };
  S->ops->numiters = [](SUNLinearSolver) { return 1; };
  S->ops->resnorm = [](SUNLinearSolver) { return 0.0; };
  S->ops->resid = [](SUNLinearSolver) -> N_Vector { return nullptr; };
  S->ops->setscalingvectors = [](SUNLinearSolver, N_Vector, N_Vector) { return 0; };
  S->ops->free = [](SUNLinearSolver L) { delete static_cast<Sweep*>(L->content); SUNLinSolFreeEmpty(L); return 0; };
  return S;
}

}  // namespace

void LinearPart::attach(void* memory, const IdaSystem& s, N_Vector y, SUNContext context) {
  if (s.dense) {
    matrix_ = SUNDenseMatrix(s.size(), s.size(), context);
    if (!matrix_) throw std::bad_alloc();
    solver_ = SUNLinSol_Dense(y, matrix_, context);
  } else {
    solver_ = getenv("SWEEP") ? sweep_solver(context) : SUNLinSol_SPGMR(y, SUN_PREC_LEFT, kKrylov, context);
  }
  if (!solver_) throw std::bad_alloc();
  check_flag(IDASetLinearSolver(memory, solver_, matrix_));
  if (s.dense) {
    check_flag(IDASetJacFn(memory, dense_jacobian));
  } else {
    check_flag(IDASetPreconditioner(memory, chain_setup, chain_solve));
    check_flag(IDASetJacTimes(memory, nullptr, chain_times));
    if (getenv("EPSLIN")) IDASetEpsLin(memory, atof(getenv("EPSLIN")));
  }
}

LinearPart::~LinearPart() {
  if (solver_) SUNLinSolFree(solver_);
  if (matrix_) SUNMatDestroy(matrix_);
}

}  // namespace flexarm
