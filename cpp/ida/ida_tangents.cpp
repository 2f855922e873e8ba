#include "ida_tangents.hpp"

#include <new>

namespace flexarm {

namespace {

// Change of cj, in parts, from which on the state's Jacobian is factored anew. With IDA's own 0.25 the remaining
// error of the state's equations disturbs the tangents: three times the steps at rtol 1e-8.
constexpr double kStale = 0.05;

/// In place of r = F_y s + F_y' s' + F_p of each tangent s, the change of s by which r becomes zero.
int corrections(int count, sunrealtype t, N_Vector y, N_Vector yp, N_Vector, N_Vector* ys, N_Vector* yps, N_Vector* out,
                void* data, N_Vector, N_Vector, N_Vector) {
  return IdaSystem::answer(data, [&](IdaSystem& s) {
    sunrealtype cj = 0.0;
    check_flag(IDAGetCurrentCj(s.memory, &cj));
    s.set(t, N_VGetArrayPointer(y), N_VGetArrayPointer(yp));
    s.tangents->linearise(t);
    const Eigen::Index m = s.n_q(), n = s.n_v();
    const auto numbers = [&](N_Vector x) { return Eigen::Map<Eigen::VectorXd>(N_VGetArrayPointer(x), m + n); };
    Eigen::MatrixXd q(m, count), v(n, count), a(n, count), r1(m, count), r2(n, count);
    for (int k = 0; k < count; ++k) {
      q.col(k) = numbers(ys[k]).head(m);
      v.col(k) = numbers(ys[k]).tail(n);
      a.col(k) = numbers(yps[k]).tail(n);
      r1.col(k) = numbers(yps[k]).head(m);
    }
    r1 -= s.tangents->rates(q, v);
    s.tangents->residual(q, v, a, r2);
    s.tangents->correct(cj, r1, r2, q, v);
    for (int k = 0; k < count; ++k) numbers(out[k]) << q.col(k), v.col(k);
    return v.allFinite() ? 0 : 1;
  });
}

/// The memory of the solver of the tangents' equations.
struct Content {
  SUNNonlinSolSysFn system = nullptr;
  N_Vector change = nullptr;
  ~Content() {
    if (change) N_VDestroy(change);
  }
  static Content& of(SUNNonlinearSolver solver) { return *static_cast<Content*>(solver->content); }
};

/// Adds the result of `corrections`, once.
int solve(SUNNonlinearSolver solver, N_Vector sum, void* memory) {
  Content& c = Content::of(solver);
  if (!c.change) c.change = N_VClone(sum);
  if (!c.change) return -1;
  N_VConst(0.0, sum);
  if (const int flag = c.system(sum, c.change, memory); flag != 0) return flag;
  N_VScale(1.0, c.change, sum);
  return 0;
}

SUNNonlinearSolver one_correction(SUNContext context) {
  SUNNonlinearSolver out = SUNNonlinSolNewEmpty(context);
  if (!out) throw std::bad_alloc();
  out->content = new Content;
  out->ops->gettype = [](SUNNonlinearSolver) { return SUNNONLINEARSOLVER_ROOTFIND; };
  out->ops->setsysfn = [](SUNNonlinearSolver l, SUNNonlinSolSysFn f) {
    Content::of(l).system = f;
    return 0;
  };
  out->ops->solve = [](SUNNonlinearSolver l, N_Vector, N_Vector sum, N_Vector, sunrealtype, auto, void* memory) {
    return solve(l, sum, memory);
  };
  out->ops->free = [](SUNNonlinearSolver l) {
    delete static_cast<Content*>(l->content);
    SUNNonlinSolFreeEmpty(l);
    return 0;
  };
  return out;
}

}  // namespace

void TangentPart::attach(void* memory, IdaSystem& s, N_Vector y, SUNContext context, const IdaOptions& options,
                         const std::vector<Parameter>& parameters) {
  count_ = s.tangents->size();
  y_ = N_VCloneVectorArray(count_, y);
  yp_ = N_VCloneVectorArray(count_, y);
  if (!y_ || !yp_) throw std::bad_alloc();
  put(s);
  check_flag(IDASensInit(memory, count_, IDA_STAGGERED, corrections, y_, yp_));
  std::vector<double> atol;
  for (const Parameter& p : parameters) atol.push_back(options.atol / p.scale);
  check_flag(IDASensSStolerances(memory, options.rtol, atol.data()));
  check_flag(IDASetSensErrCon(memory, 1));
  check_flag(IDASetDeltaCjLSetup(memory, kStale));
  solver_ = one_correction(context);
  check_flag(IDASetNonlinearSolverSensStg(memory, solver_));
}

void TangentPart::restart(void* memory, const IdaSystem& s) {
  put(s);
  check_flag(IDASensReInit(memory, IDA_STAGGERED, y_, yp_));
}

void TangentPart::put(const IdaSystem& s) {
  const StateTangents& from = *s.tangents;
  const Eigen::MatrixXd rates = from.rates(from.q(s.free_q, Eigen::all), from.v(s.ws.free, Eigen::all));
  for (int k = 0; k < count_; ++k) {
    const auto vector = [&](N_Vector x) { return Eigen::Map<Eigen::VectorXd>(N_VGetArrayPointer(x), s.size()); };
    vector(y_[k]) << from.q.col(k)(s.free_q), from.v.col(k)(s.ws.free);
    vector(yp_[k]) << rates.col(k), from.a.col(k)(s.ws.free);
  }
}

void TangentPart::get(void* memory, IdaSystem& s) {
  sunrealtype t = 0.0;
  check_flag(IDAGetSens(memory, &t, y_));
  for (int k = 0; k < count_; ++k) {
    const Eigen::Map<const Eigen::VectorXd> x(N_VGetArrayPointer(y_[k]), s.size());
    s.tangents->q.col(k)(s.free_q) = x.head(s.n_q());
    s.tangents->v.col(k)(s.ws.free) = x.tail(s.n_v());
  }
}

TangentPart::~TangentPart() {
  if (solver_) SUNNonlinSolFree(solver_);
  if (yp_) N_VDestroyVectorArray(yp_, count_);
  if (y_) N_VDestroyVectorArray(y_, count_);
}

}  // namespace flexarm
