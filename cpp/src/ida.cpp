#include "flexarm/ida.hpp"

#include <ida/ida.h>
#include <nvector/nvector_serial.h>
#include <sundials/sundials_config.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <memory>

#include "flexarm/check.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/derivatives.hpp"
#include "system.hpp"

namespace flexarm {

namespace {

constexpr int kLook = 200;  // steps between two calls of `alive`

/// The arm as IDA sees it: state y = [q; v] of the free coordinates and rates.
struct IdaSystem : System {
  InverseDerivatives derivatives;
  Eigen::VectorXd dq;
  Eigen::MatrixXd rate_by_q, rate_by_v;
  std::exception_ptr thrown;  // by a drive, inside a C callback
  std::string message;        // IDA's last word

  IdaSystem(const Arm& arm_, const std::vector<Drive>& drives_, const std::vector<LoadDrive>& loads_,
            const Eigen::VectorXd& tau_)
      : System(arm_, drives_, loads_, tau_),
        derivatives(arm_, places(loads_)),
        dq(q),
        rate_by_q(arm_.nq(), arm_.nq()),
        rate_by_v(arm_.nq(), arm_.nv()) {}

  void set(double t, const double* y, const double* yp) {
    drive(t);
    for (int k = 0; k < n_q(); ++k) q[free_q[k]] = y[k];
    for (int k = 0; k < n_v(); ++k) {
      const int i = ws.free[k];
      v[i] = y[n_q() + k];
      if (yp) a[i] = yp[n_q() + k];
    }
  }

  /// y and dy/dt of the current coordinates, rates and accelerations.
  std::pair<Eigen::VectorXd, Eigen::VectorXd> state() {
    Eigen::VectorXd y(n_q() + n_v()), yp(n_q() + n_v());
    coordinate_rates(arm, q, v, dq);
    for (int k = 0; k < n_q(); ++k) {
      y[k] = q[free_q[k]];
      yp[k] = dq[free_q[k]];
    }
    for (int k = 0; k < n_v(); ++k) {
      y[n_q() + k] = v[ws.free[k]];
      yp[n_q() + k] = a[ws.free[k]];
    }
    return {y, yp};
  }
};

int residual(sunrealtype t, N_Vector y, N_Vector yp, N_Vector r, void* data) {
  IdaSystem& s = *static_cast<IdaSystem*>(data);
  try {
    const double *py = N_VGetArrayPointer(y), *pyp = N_VGetArrayPointer(yp);
    double* pr = N_VGetArrayPointer(r);
    s.set(t, py, pyp);
    inverse_dynamics<double>(s.arm, s.ws, s.q, s.v, s.a);
    coordinate_rates(s.arm, s.q, s.v, s.dq);
    for (int k = 0; k < s.n_q(); ++k) pr[k] = pyp[k] - s.dq[s.free_q[k]];
    for (int k = 0; k < s.n_v(); ++k) {
      const int i = s.ws.free[k];
      pr[s.n_q() + k] = s.ws.tau[i] - s.tau[i];
      if (!std::isfinite(pr[s.n_q() + k])) return 1;  // IDA tries a smaller step
    }
    return 0;
  } catch (...) {
    s.thrown = std::current_exception();
    return -1;
  }
}

/// dF/dy + cj dF/dy'
int jacobian(sunrealtype t, sunrealtype cj, N_Vector y, N_Vector yp, N_Vector, SUNMatrix J, void* data, N_Vector,
             N_Vector, N_Vector) {
  IdaSystem& s = *static_cast<IdaSystem*>(data);
  try {
    s.set(t, N_VGetArrayPointer(y), N_VGetArrayPointer(yp));
    for (std::size_t k = 0; k < s.ws.loads.size(); ++k) s.derivatives.set_wrench(k, s.ws.loads[k].wrench);
    s.derivatives(s.arm, s.q, s.v, s.a);
    move_arm<double>(s.arm, s.ws, s.q, s.v);
    composite_mass_matrix(s.arm, s.ws);
    coordinate_rate_jacobians(s.arm, s.q, s.v, s.rate_by_q, s.rate_by_v);
    const int nq = s.n_q(), nv = s.n_v();
    for (int k = 0; k < nq; ++k) {
      const int j = s.free_q[k];
      double* column = SUNDenseMatrix_Column(J, k);
      for (int l = 0; l < nq; ++l) column[l] = -s.rate_by_q(s.free_q[l], j);
      column[k] += cj;
      for (int l = 0; l < nv; ++l) column[nq + l] = s.derivatives.dq(s.ws.free[l], j);
    }
    for (int k = 0; k < nv; ++k) {
      const int j = s.ws.free[k];
      double* column = SUNDenseMatrix_Column(J, nq + k);
      for (int l = 0; l < nq; ++l) column[l] = -s.rate_by_v(s.free_q[l], j);
      for (int l = 0; l < nv; ++l) {
        const int i = s.ws.free[l];
        column[nq + l] = s.derivatives.dv(i, j) + cj * s.ws.M(i, j);
      }
    }
    return 0;
  } catch (...) {
    s.thrown = std::current_exception();
    return -1;
  }
}

#if SUNDIALS_VERSION_MAJOR < 7
void keep_message(int, const char*, const char*, char* text, void* data) {
  static_cast<IdaSystem*>(data)->message = text;
}
#endif

/// Owns what SUNDIALS allocates.
struct Solver {
  SUNContext context = nullptr;
  N_Vector y = nullptr, yp = nullptr;
  SUNMatrix matrix = nullptr;
  SUNLinearSolver linear = nullptr;
  void* memory = nullptr;

  Solver(IdaSystem& s, const IdaOptions& o, double t0, const Eigen::VectorXd& y0, const Eigen::VectorXd& yp0,
         double t_end) {
    const sunindextype n = y0.size();
#if SUNDIALS_VERSION_MAJOR < 7
    check(SUNContext_Create(nullptr, &context));
#else
    check(SUNContext_Create(SUN_COMM_NULL, &context));
    SUNContext_ClearErrHandlers(context);
#endif
    y = N_VNew_Serial(n, context);
    yp = N_VNew_Serial(n, context);
    matrix = SUNDenseMatrix(n, n, context);
    linear = SUNLinSol_Dense(y, matrix, context);
    memory = IDACreate(context);
    if (!y || !yp || !matrix || !linear || !memory) throw std::bad_alloc();
    Eigen::Map<Eigen::VectorXd>(N_VGetArrayPointer(y), n) = y0;
    Eigen::Map<Eigen::VectorXd>(N_VGetArrayPointer(yp), n) = yp0;
    check(IDASetUserData(memory, &s));
#if SUNDIALS_VERSION_MAJOR < 7
    check(IDASetErrHandlerFn(memory, keep_message, &s));
#endif
    check(IDAInit(memory, residual, t0, y, yp));
    check(IDASStolerances(memory, o.rtol, o.atol));
    check(IDASetLinearSolver(memory, linear, matrix));
    check(IDASetJacFn(memory, jacobian));
    check(IDASetMaxOrd(memory, o.max_order));
    check(IDASetMaxNumSteps(memory, kLook));
    check(IDASetStopTime(memory, t_end));
  }
  ~Solver() {
    if (memory) IDAFree(&memory);
    if (linear) SUNLinSolFree(linear);
    if (matrix) SUNMatDestroy(matrix);
    if (yp) N_VDestroy(yp);
    if (y) N_VDestroy(y);
    if (context) SUNContext_Free(&context);
  }
  Solver(const Solver&) = delete;
  Solver& operator=(const Solver&) = delete;

  static void check(int flag) {
    if (flag < 0) throw std::runtime_error("SUNDIALS set-up failed, flag " + std::to_string(flag));
  }
};

std::string reason(int flag, const IdaSystem& s) {
  switch (flag) {
    case IDA_ILL_INPUT:
      return "the first step came out as zero: forces or tolerances are too extreme";
    case IDA_TOO_MUCH_ACC:
      return "the tolerances are too small for double precision";
    case IDA_ERR_FAIL:
      return "the error test failed too often: the solution changes faster than any step can follow";
    case IDA_CONV_FAIL:
    case IDA_REP_RES_ERR:
      return "the equations could not be solved at the smallest step: the solution may diverge";
    case IDA_LSETUP_FAIL:
    case IDA_LSOLVE_FAIL:
      return "the Jacobian became singular";
    default:
      return s.message.empty() ? "IDA stopped with flag " + std::to_string(flag) : s.message;
  }
}

void check_options(const IdaOptions& o) {
  positive("rtol", o.rtol);
  if (o.rtol < 1e-14) bad_value("rtol", o.rtol, "must be at least 1e-14: double precision has no more");
  positive("atol", o.atol);
  if (o.max_order < 1 || o.max_order > 5) bad_value("max_order", o.max_order, "must be from 1 to 5");
}

/// Times that no step may pass over, or a driven arm at rest would sleep through a pulse: the samples of the drives,
/// and the output times for drives that are functions.
std::vector<double> stop_times(const std::vector<Drive>& drives, const std::vector<LoadDrive>& loads,
                               const Eigen::VectorXd& t) {
  bool functions = false;
  std::vector<double> stops = sample_times(drives, loads, t, functions);
  stops.push_back(t[t.size() - 1]);
  if (functions) stops.insert(stops.end(), t.begin() + 1, t.end());
  std::sort(stops.begin(), stops.end());
  return stops;
}

}  // namespace

Trajectory simulate_ida(const Arm& arm, const std::vector<Drive>& drives, const Eigen::VectorXd& t,
                        const Eigen::VectorXd& q0, const Eigen::VectorXd& v0, const Eigen::VectorXd& tau,
                        const IdaOptions& options, const Alive& alive, const std::vector<LoadDrive>& loads) {
  check_arguments(arm, drives, t, q0, v0, tau);
  check_options(options);
  const auto started = std::chrono::steady_clock::now();
  IdaSystem s(arm, drives, loads, tau);
  Trajectory out = empty_trajectory(arm, t);
  s.q = q0;
  s.v = v0;
  s.drive(t[0]);
  if (!s.record(out, options.composite)) return out;
  if (s.n_q() == 0) {  // everything is prescribed: nothing to integrate
    for (Eigen::Index k = 1; k < t.size(); ++k) {
      s.drive(t[k]);
      if (!s.record(out, options.composite)) return out;
      out.reached = t[k];
    }
    return out;
  }

  const auto [y0, yp0] = s.state();
  Solver solver(s, options, t[0], y0, yp0, t[t.size() - 1]);
  const std::vector<double> stops = stop_times(drives, loads, t);
  while (out.done < t.size() && out.failure.empty()) {
    const double goal = t[out.done];
    IDASetStopTime(solver.memory, *std::upper_bound(stops.begin(), stops.end() - 1, out.reached));
    sunrealtype now = out.reached;
    const int flag = IDASolve(solver.memory, goal, &now, solver.y, solver.yp, IDA_NORMAL);
    if (s.thrown) std::rethrow_exception(s.thrown);
    const double gained = now - out.reached;
    out.reached = now;
    const bool going = !alive || alive(now);
    if (flag == IDA_TOO_MUCH_WORK) {  // time to look around, no more, unless the steps have shrunk to nothing
      if (gained < kLook * 1e-12 * (t[t.size() - 1] - t[0]))
        out.failure = "the step size fell below 1e-12 of the time asked for: the solution changes too fast";
    } else if (flag < 0) {
      out.failure = reason(flag, s);
    } else if (now >= goal) {
      s.set(goal, N_VGetArrayPointer(solver.y), nullptr);
      s.record(out, options.composite);
    }
    if (!going && out.failure.empty()) out.failure = kInterrupted;
  }
  IDAGetNumSteps(solver.memory, &out.stats.steps);
  IDAGetNumResEvals(solver.memory, &out.stats.residuals);
  IDAGetNumJacEvals(solver.memory, &out.stats.jacobians);
  IDAGetNumNonlinSolvIters(solver.memory, &out.stats.newton_iterations);
  IDAGetNumErrTestFails(solver.memory, &out.stats.failed_steps);
  out.stats.wall_time = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  return out;
}

}  // namespace flexarm
