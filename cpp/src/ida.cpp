#include "flexarm/ida.hpp"

#include <ida/ida.h>
#include <nvector/nvector_serial.h>
#include <sundials/sundials_config.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>

#include <chrono>
#include <exception>
#include <memory>

#include "flexarm/ab.hpp"
#include "flexarm/check.hpp"
#include "flexarm/ci.hpp"

namespace flexarm {

namespace {

constexpr int kLook = 200;  // steps between two calls of `alive`

/// The arm as IDA sees it: state y = [q; v] of the free coordinates.
struct System {
  const Arm& arm;
  const std::vector<Drive>& drives;
  const Eigen::VectorXd& constant_tau;
  Workspace ws;
  InverseDerivatives derivatives;
  Eigen::VectorXd q, v, a, tau;  // of all coordinates
  std::exception_ptr thrown;     // by a drive, inside a C callback
  std::string message;           // IDA's last word

  System(const Arm& arm_, const std::vector<Drive>& drives_, const Eigen::VectorXd& tau_)
      : arm(arm_),
        drives(drives_),
        constant_tau(tau_),
        ws(arm_, prescribed(arm_, drives_)),
        derivatives(arm_),
        q(Eigen::VectorXd::Zero(arm_.nv())),
        v(q),
        a(q),
        tau(tau_) {}

  static std::vector<bool> prescribed(const Arm& arm, const std::vector<Drive>& drives) {
    std::vector<bool> given(static_cast<std::size_t>(arm.nv()), false);
    for (const Drive& d : drives)
      if (d.motion) given[static_cast<std::size_t>(d.coordinate)] = true;
    return given;
  }
  int n_free() const { return static_cast<int>(ws.free.size()); }

  /// Prescribed coordinates and applied forces at time t.
  void drive(double t) {
    tau = constant_tau;
    for (const Drive& d : drives) {
      if (d.motion) {
        const MotionValue m = d.motion(t);
        q[d.coordinate] = m.q;
        v[d.coordinate] = m.v;
        a[d.coordinate] = m.a;
      } else {
        tau[d.coordinate] += d.force(t);
      }
    }
  }
  void set(double t, const double* y, const double* yp) {
    drive(t);
    const int n = n_free();
    for (int k = 0; k < n; ++k) {
      const int i = ws.free[static_cast<std::size_t>(k)];
      q[i] = y[k];
      v[i] = y[n + k];
      if (yp) a[i] = yp[n + k];
    }
  }
};

int residual(sunrealtype t, N_Vector y, N_Vector yp, N_Vector r, void* data) {
  System& s = *static_cast<System*>(data);
  try {
    const double *py = N_VGetArrayPointer(y), *pyp = N_VGetArrayPointer(yp);
    double* pr = N_VGetArrayPointer(r);
    s.set(t, py, pyp);
    inverse_dynamics<double>(s.arm, s.ws, s.q, s.v, s.a);
    const int n = s.n_free();
    for (int k = 0; k < n; ++k) {
      const int i = s.ws.free[static_cast<std::size_t>(k)];
      pr[k] = pyp[k] - py[n + k];
      pr[n + k] = s.ws.tau[i] - s.tau[i];
      if (!std::isfinite(pr[n + k])) return 1;  // IDA tries a smaller step
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
  System& s = *static_cast<System*>(data);
  try {
    s.set(t, N_VGetArrayPointer(y), N_VGetArrayPointer(yp));
    s.derivatives(s.arm, s.q, s.v, s.a);
    move_arm<double>(s.arm, s.ws, s.q, s.v);
    composite_mass_matrix(s.arm, s.ws);
    const int n = s.n_free();
    for (int k = 0; k < n; ++k) {
      const int j = s.ws.free[static_cast<std::size_t>(k)];
      double *by_q = SUNDenseMatrix_Column(J, k), *by_v = SUNDenseMatrix_Column(J, n + k);
      std::fill(by_q, by_q + n, 0.0);
      std::fill(by_v, by_v + n, 0.0);
      by_q[k] = cj;
      by_v[k] = -1.0;
      for (int l = 0; l < n; ++l) {
        const int i = s.ws.free[static_cast<std::size_t>(l)];
        by_q[n + l] = s.derivatives.dq(i, j);
        by_v[n + l] = s.derivatives.dv(i, j) + cj * s.ws.M(i, j);
      }
    }
    return 0;
  } catch (...) {
    s.thrown = std::current_exception();
    return -1;
  }
}

#if SUNDIALS_VERSION_MAJOR < 7
void keep_message(int, const char*, const char*, char* text, void* data) { static_cast<System*>(data)->message = text; }
#endif

/// Owns what SUNDIALS allocates.
struct Solver {
  SUNContext context = nullptr;
  N_Vector y = nullptr, yp = nullptr;
  SUNMatrix matrix = nullptr;
  SUNLinearSolver linear = nullptr;
  void* memory = nullptr;

  Solver(System& s, int n, const IdaOptions& o, double t0, const Eigen::VectorXd& y0, const Eigen::VectorXd& yp0,
         double t_end) {
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

std::string reason(int flag, const System& s) {
  switch (flag) {
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

void check_arguments(const Arm& arm, const std::vector<Drive>& drives, const Eigen::VectorXd& t,
                     const Eigen::VectorXd& q0, const Eigen::VectorXd& v0, const Eigen::VectorXd& tau,
                     const IdaOptions& o) {
  positive("rtol", o.rtol);
  positive("atol", o.atol);
  if (o.max_order < 1 || o.max_order > 5) bad_value("max_order", o.max_order, "must be from 1 to 5");
  if (t.size() < 2) bad_value("t", t.size(), "needs at least two times");
  if (!t.allFinite()) bad_value("t", "nan or inf", "must be finite");
  for (Eigen::Index k = 0; k + 1 < t.size(); ++k)
    if (!(t[k + 1] > t[k])) bad_value("t[" + std::to_string(k + 1) + "]", t[k + 1], "t must increase");
  const auto check_vector = [&](const char* name, const Eigen::VectorXd& x) {
    if (x.size() != arm.nv()) bad_value(std::string(name) + " length", x.size(), "must be " + std::to_string(arm.nv()));
    if (!x.allFinite()) bad_value(name, "nan or inf", "must be finite");
  };
  check_vector("q0", q0);
  check_vector("v0", v0);
  check_vector("tau", tau);
  for (const Drive& d : drives)
    if (d.coordinate < 0 || d.coordinate >= arm.nv() || !d.motion == !d.force)
      bad_value("drive of coordinate", d.coordinate, "needs a coordinate of the arm and a motion or a force");
}

}  // namespace

Trajectory simulate_ida(const Arm& arm, const std::vector<Drive>& drives, const Eigen::VectorXd& t,
                        const Eigen::VectorXd& q0, const Eigen::VectorXd& v0, const Eigen::VectorXd& tau,
                        const IdaOptions& options, const std::function<void(double)>& alive) {
  check_arguments(arm, drives, t, q0, v0, tau, options);
  const auto started = std::chrono::steady_clock::now();
  System s(arm, drives, tau);
  const int n = s.n_free();
  const auto accelerate = [&] {
    s.ws.a = s.a;
    const Status status = options.composite ? forward_dynamics_ci(arm, s.ws, s.q, s.v, s.tau)
                                            : forward_dynamics_ab(arm, s.ws, s.q, s.v, s.tau);
    return status == Status::ok && s.ws.a.allFinite();
  };

  Trajectory out;
  out.q = out.v = out.a = out.tau = Trajectory::Rows::Constant(t.size(), arm.nv(), std::nan(""));
  out.reached = t[0];
  const auto record = [&] {  // accelerations and reactions at the current state
    if (!accelerate()) {
      out.failure = "the mass matrix is singular";
      return false;
    }
    s.a = s.ws.a;
    inverse_dynamics<double>(arm, s.ws, s.q, s.v, s.a);
    for (const Drive& d : drives)
      if (d.motion) s.tau[d.coordinate] = s.ws.tau[d.coordinate];
    out.q.row(out.done) = s.q;
    out.v.row(out.done) = s.v;
    out.a.row(out.done) = s.a;
    out.tau.row(out.done) = s.tau;
    ++out.done;
    return true;
  };

  s.q = q0;
  s.v = v0;
  s.drive(t[0]);
  if (!record()) return out;
  if (n == 0) {  // everything is prescribed: nothing to integrate
    for (Eigen::Index k = 1; k < t.size(); ++k) {
      s.drive(t[k]);
      if (!record()) return out;
      out.reached = t[k];
    }
    return out;
  }

  Eigen::VectorXd y0(2 * n), yp0(2 * n);
  for (int k = 0; k < n; ++k) {
    const int i = s.ws.free[static_cast<std::size_t>(k)];
    y0[k] = s.q[i];
    y0[n + k] = yp0[k] = s.v[i];
    yp0[n + k] = s.a[i];
  }
  Solver solver(s, 2 * n, options, t[0], y0, yp0, t[t.size() - 1]);
  while (out.done < t.size() && out.failure.empty()) {
    const double goal = t[out.done];
    sunrealtype now = out.reached;
    const int flag = IDASolve(solver.memory, goal, &now, solver.y, solver.yp, IDA_NORMAL);
    if (s.thrown) std::rethrow_exception(s.thrown);
    const double gained = now - out.reached;
    out.reached = now;
    if (alive) alive(now);
    if (flag == IDA_TOO_MUCH_WORK) {  // time to look around, no more, unless the steps have shrunk to nothing
      if (gained < kLook * 1e-12 * (t[t.size() - 1] - t[0]))
        out.failure = "the step size fell below 1e-12 of the time asked for: the solution changes too fast";
    } else if (flag < 0) {
      out.failure = reason(flag, s);
    } else {
      s.set(goal, N_VGetArrayPointer(solver.y), nullptr);
      record();
    }
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
