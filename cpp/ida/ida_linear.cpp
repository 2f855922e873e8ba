#include "ida_linear.hpp"

#include <sunlinsol/sunlinsol_dense.h>
#include <sunlinsol/sunlinsol_spgmr.h>
#include <sunmatrix/sunmatrix_dense.h>

#include <new>

#include "flexarm/ci.hpp"

namespace flexarm {

namespace {

constexpr int kKrylov = 10;      // vectors
constexpr double kEased = 1e-9;  // of the size of rows of loops
constexpr double kGood = 0.3;    // error of the preconditioner alone, in parts of the solution

/// The rows and columns of loops. Of a quaternion E^T E is a quarter of the unit matrix. dg/dt changes by the
/// coordinates half as much as d^2 g/dt^2 = G^T a + v^T H v does by the rates (with balls, nearly).
void put_loops(const IdaSystem& s, const Eigen::MatrixXd& E, const Eigen::MatrixXd& slopes, double cj, SUNMatrix J) {
  const int nq = s.n_q(), nv = s.n_v(), m = s.n_loops();
  const auto at = [&](int row, int column) -> double& { return SUNDenseMatrix_Column(J, column)[row]; };
  for (int r = 0; r < m; ++r) {
    const auto g = s.G.col(s.rows[static_cast<std::size_t>(r)]);
    const int y = nq + nv + r, drift = y + m;
    double by_rates = 0.0, by_forces = 0.0;
    for (int k = 0; k < nv; ++k) {
      const int i = s.ws.free[static_cast<std::size_t>(k)];
      at(nq + k, y) = -g[i];
      at(drift, nq + k) = g[i];
      by_rates += s.yielding[i] * g[i] * g[i];
      by_forces += g[i] * g[i] / s.ws.M(i, i);
    }
    at(y, drift) = kEased * by_rates / cj;  // at singular positions rows depend on others
    at(drift, y) = kEased * by_forces / cj;
    for (int k = 0; k < nq; ++k) {
      const int i = s.free_q[static_cast<std::size_t>(k)];
      double by_drift = 0.0, by_q = 0.0, rate_by_q = 0.0;
      for (int j : s.ws.free) {
        const double e = E(i, j), turned = s.arm.coordinate_of(j) < 0 ? 4.0 * e : e;
        by_drift -= e * s.yielding[j] * g[j];
        by_q += turned * g[j];
        rate_by_q += turned * 0.5 * slopes(s.rows[static_cast<std::size_t>(r)], s.arm.nq() + j);
      }
      at(k, drift) = by_drift;
      at(y, k) = by_q;
      at(drift, k) = rate_by_q;
    }
  }
}

/// dF/dy + cj dF/dy'
int dense_jacobian(sunrealtype t, sunrealtype cj, N_Vector y, N_Vector yp, N_Vector, SUNMatrix J, void* data, N_Vector,
                   N_Vector, N_Vector) {
  return IdaSystem::answer(data, [&](IdaSystem& s) {
    DenseJacobian& d = *s.dense;
    s.set(t, N_VGetArrayPointer(y), N_VGetArrayPointer(yp));
    for (std::size_t k = 0; k < s.ws.loads.size(); ++k) d.derivatives.set_wrench(k, s.ws.loads[k].wrench);
    d.derivatives.recall(s.ws);
    if (!s.rows.empty()) {
      inverse_dynamics(s.arm, s.ws, s.q, s.v, s.a);
      s.find_loops();
    }
    d.derivatives(s.arm, s.q, s.v, s.a);
    add_feedback_slopes(s.ws.feedback, s.ws.limits, s.q, s.v, d.derivatives.dq, d.derivatives.dv);
    composite_mass_matrix(s.arm, s.ws, s.q);
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
    if (!s.rows.empty()) put_loops(s, d.rate_by_v, d.derivatives.loops, cj, J);
    return 0;
  });
}

/// (dF/dy + cj dF/dy') x by a difference quotient of the residual r, over a distance as large as the tolerance.
int chain_times(sunrealtype t, N_Vector y, N_Vector yp, N_Vector r, N_Vector x, N_Vector Jx, sunrealtype cj, void* data,
                N_Vector ahead, N_Vector ahead_p) {
  return IdaSystem::answer(data, [&](IdaSystem& s) {
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
  });
}

int chain_setup(sunrealtype t, N_Vector y, N_Vector yp, N_Vector, sunrealtype cj, void* data) {
  return IdaSystem::answer(data, [&](IdaSystem& s) {
    s.set(t, N_VGetArrayPointer(y), N_VGetArrayPointer(yp));
    return s.chain->factor(s, cj) ? 0 : 1;
  });
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

/// GMRES, or its preconditioner alone, which is a third cheaper in all and mostly as good: then Newton's own iterations
/// do the rest. Which of the two is decided after each setup, by the error that the preconditioner alone would make.
struct ChainSolver {
  SUNLinearSolver gmres = nullptr;
  N_Vector alone = nullptr, weights = nullptr;
  IdaSystem* system = nullptr;
  void* data = nullptr;  // of `precondition`
  SUNPSolveFn precondition = nullptr;
  enum { unknown, good, poor } alone_is = unknown;
  double setup_at = 0.0;

  static ChainSolver& of(SUNLinearSolver solver) { return *static_cast<ChainSolver*>(solver->content); }
  ~ChainSolver() {
    if (gmres) SUNLinSolFree(gmres);
    if (alone) N_VDestroy(alone);
  }
  int setup() {
    // a second setup at one time: Newton's iteration failed there with the preconditioner alone, or the step was cut
    alone_is = system->driven == setup_at ? poor : unknown;
    setup_at = system->driven;
    return SUNLinSolSetup(gmres, nullptr);
  }
  int solve(N_Vector x, N_Vector b, double tolerance) {
    if (alone_is == good) return precondition(data, b, x, tolerance, SUN_PREC_LEFT);
    if (alone_is == unknown) {
      const int flag = precondition(data, b, alone, tolerance, SUN_PREC_LEFT);
      if (flag != 0) return flag;
    }
    const int flag = SUNLinSolSolve(gmres, nullptr, x, b, tolerance);
    if (alone_is == unknown && flag >= 0) {
      const double size = N_VWrmsNorm(x, weights);
      N_VLinearSum(1.0, x, -1.0, alone, alone);
      if (size > 0.0) alone_is = N_VWrmsNorm(alone, weights) <= kGood * size ? good : poor;
    }
    return flag;
  }
};

SUNLinearSolver chain_solver(IdaSystem& s, N_Vector y, SUNContext context) {
  SUNLinearSolver out = SUNLinSolNewEmpty(context);
  if (!out) throw std::bad_alloc();
  ChainSolver* c = new ChainSolver;
  out->content = c;
  c->system = &s;
  c->gmres = SUNLinSol_SPGMR(y, SUN_PREC_LEFT, kKrylov, context);
  c->alone = N_VClone(y);
  SUNLinearSolver_Ops ops = out->ops;
  ops->gettype = [](SUNLinearSolver) { return SUNLINEARSOLVER_ITERATIVE; };
  ops->getid = [](SUNLinearSolver) { return SUNLINEARSOLVER_CUSTOM; };
  ops->setatimes = [](SUNLinearSolver l, void* data, SUNATimesFn f) {
    return SUNLinSolSetATimes(ChainSolver::of(l).gmres, data, f);
  };
  ops->setpreconditioner = [](SUNLinearSolver l, void* data, SUNPSetupFn setup, SUNPSolveFn solve) {
    ChainSolver::of(l).data = data;
    ChainSolver::of(l).precondition = solve;
    return SUNLinSolSetPreconditioner(ChainSolver::of(l).gmres, data, setup, solve);
  };
  ops->setscalingvectors = [](SUNLinearSolver l, N_Vector left, N_Vector right) {
    ChainSolver::of(l).weights = left;
    return SUNLinSolSetScalingVectors(ChainSolver::of(l).gmres, left, right);
  };
  ops->setzeroguess = [](SUNLinearSolver l, auto on) { return SUNLinSolSetZeroGuess(ChainSolver::of(l).gmres, on); };
  ops->initialize = [](SUNLinearSolver l) { return SUNLinSolInitialize(ChainSolver::of(l).gmres); };
  ops->setup = [](SUNLinearSolver l, SUNMatrix) { return ChainSolver::of(l).setup(); };
  ops->solve = [](SUNLinearSolver l, SUNMatrix, N_Vector x, N_Vector b, sunrealtype tolerance) {
    return ChainSolver::of(l).solve(x, b, tolerance);
  };
  ops->numiters = [](SUNLinearSolver l) {
    return ChainSolver::of(l).alone_is == ChainSolver::good ? 1 : SUNLinSolNumIters(ChainSolver::of(l).gmres);
  };
  ops->resnorm = [](SUNLinearSolver l) { return SUNLinSolResNorm(ChainSolver::of(l).gmres); };
  ops->resid = [](SUNLinearSolver l) { return SUNLinSolResid(ChainSolver::of(l).gmres); };
  ops->free = [](SUNLinearSolver l) {
    delete static_cast<ChainSolver*>(l->content);
    SUNLinSolFreeEmpty(l);
    return 0;
  };
  if (!c->gmres || !c->alone) {
    SUNLinSolFree(out);
    throw std::bad_alloc();
  }
  return out;
}

}  // namespace

void LinearPart::attach(void* memory, IdaSystem& s, N_Vector y, SUNContext context) {
  if (s.dense) {
    matrix_ = SUNDenseMatrix(s.size(), s.size(), context);
    if (!matrix_) throw std::bad_alloc();
    solver_ = SUNLinSol_Dense(y, matrix_, context);
  } else {
    solver_ = chain_solver(s, y, context);
  }
  if (!solver_) throw std::bad_alloc();
  check_flag(IDASetLinearSolver(memory, solver_, matrix_));
  if (s.dense) {
    check_flag(IDASetJacFn(memory, dense_jacobian));
  } else {
    check_flag(IDASetPreconditioner(memory, chain_setup, chain_solve));
    check_flag(IDASetJacTimes(memory, nullptr, chain_times));
  }
}

LinearPart::~LinearPart() {
  if (solver_) SUNLinSolFree(solver_);
  if (matrix_) SUNMatDestroy(matrix_);
}

}  // namespace flexarm
