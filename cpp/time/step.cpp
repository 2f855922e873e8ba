#include "flexarm/step.hpp"

#include <algorithm>
#include <cmath>

#include "flexarm/check.hpp"
#include "flexarm/dry_friction.hpp"
#include "lanes/alpha.hpp"
#include "lanes/single.hpp"
#include "sweeps.hpp"

namespace flexarm {

namespace {

/// An arm's workspace as the generalised-alpha method sees it.
struct Engine {
  using Scalar = double;
  using Mask = bool;
  const Arm& arm;
  Workspace* ws = nullptr;
  Eigen::VectorXd q, v, a, r, x;  // the workspace's functions take vectors
  const int* free = nullptr;
  int free_count = 0;

  explicit Engine(const Arm& arm_) : arm(arm_), q(arm.zero()), v(Eigen::VectorXd::Zero(arm.nv())), a(v), r(v), x(v) {}
  bool fast() const { return ws->fast && ws->feedback.empty(); }

  void place(const double* q0, const double* u, double* out) const {
    for (std::size_t n = 0; n < arm.size(); ++n) {
      const Link& link = arm.link(n);
      const int i = arm.first_q(n), j = arm.first(n), nq = link.joint().nq(), nj = link.nj();
      link.joint().displace(q0 + i, u + j, out + i);
      for (int k = 0; k < link.ne(); ++k) out[i + nq + k] = q0[i + nq + k] + u[j + nj + k];
    }
  }
  void inverse(const double* q_, const double* v_, const double* a_, double* tau, bool with_masses) {
    v = Eigen::Map<const Eigen::VectorXd>(v_, v.size());
    if (fast()) {
      ws->kernels().inverse(q_, v_, a_, tau);
      return;
    }
    q = Eigen::Map<const Eigen::VectorXd>(q_, q.size());
    a = Eigen::Map<const Eigen::VectorXd>(a_, a.size());
    inverse_dynamics<double>(arm, *ws, q, v, a, with_masses);
    Eigen::Map<Eigen::VectorXd>(tau, v.size()) = ws->tau;
  }
  bool factor(const lanes::Shift& shift, double& twice_kinetic) {
    if (fast()) return ws->fast->factor(shift, v.data(), twice_kinetic);
    const bool good = factor_shifted(arm, *ws, q, v, Shift{shift.damping, shift.stiffness}, true) == Status::ok;
    twice_kinetic = ws->twice_kinetic;
    return good;
  }
  void solve(const double* r_, double* x_) {
    if (fast()) {
      ws->fast->solve(r_, x_);
      return;
    }
    r = Eigen::Map<const Eigen::VectorXd>(r_, r.size());
    solve_shifted(arm, *ws, r, x);
    Eigen::Map<Eigen::VectorXd>(x_, x.size()) = x;
  }
};

}  // namespace

struct ImplicitStep::Iteration {
  Engine engine;
  Alpha<Engine> alpha;
  const std::vector<Rub> rubs;
  std::vector<int> rubbing, now;  // their rates, those that are not prescribed
  Eigen::VectorXd x;              // accelerations
  explicit Iteration(const Arm& arm) : engine(arm), rubs(flexarm::rubs(arm)), x(Eigen::VectorXd::Zero(arm.nv())) {
    rubbing.reserve(rubs.size());
    now.reserve(rubs.size());
  }

  /// To be called before anything is done with another workspace.
  void attach(Workspace& ws) {
    engine.ws = &ws;
    engine.free = ws.free.data();
    engine.free_count = static_cast<int>(ws.free.size());
    now.clear();
    for (const Rub& r : rubs)
      if (std::binary_search(ws.free.begin(), ws.free.end(), r.rate)) now.push_back(r.rate);
    if (now == rubbing) return;
    std::swap(now, rubbing);
    Contacts<Engine>& c = alpha.contacts;
    c.lay_out(c.coulomb, rubbing.data(), static_cast<int>(rubbing.size()), alpha.nv);
    int k = 0;
    for (const Rub& r : rubs) {
      if (k == c.count || c.at[k] != r.rate) continue;
      c.coulomb[k] = r.coulomb;
      c.stiction[k++] = r.stiction;
    }
  }
  Status settle(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& tau) {
    x = ws.a;
    const bool good = alpha.settle(engine, q.data(), v.data(), tau.data(), x.data(), true);
    if (!all_finite(q) || !all_finite(v) || !all_finite(tau) || (good && !all_finite(x))) return Status::not_finite;
    if (!good) return Status::singular;
    ws.a = x;
    return Status::ok;
  }
};

ImplicitStep::~ImplicitStep() = default;
int ImplicitStep::iterations() const { return iteration_->alpha.iterations; }
ImplicitStep* ImplicitStep::rubbing() { return iteration_->rubs.empty() ? nullptr : this; }

ImplicitStep::ImplicitStep(const Arm& arm, double h, const ImplicitOptions& options)
    : arm_(&arm),
      h_(positive("step", h)),
      options_(options),
      friction_(Eigen::VectorXd::Zero(arm.nv())),
      iteration_(std::make_unique<Iteration>(arm)) {
  const double rho = options.spectral_radius;
  if (!(rho >= 0.0 && rho <= 1.0)) bad_value("spectral_radius", rho, "must be from 0 to 1");
  positive("rtol", options.rtol);
  if (options.max_iterations < 1) bad_value("max_iterations", options.max_iterations, "must be at least 1");
  Alpha<Engine>& alpha = iteration_->alpha;
  numbers_.resize(
      static_cast<Eigen::Index>(Alpha<Engine>::scalars(arm.nq(), arm.nv(), static_cast<int>(iteration_->rubs.size()))));
  alpha.lay_out(numbers_.data(), arm.nq(), arm.nv(), nullptr, 0);
  alpha.o = AlphaOptions::of(rho, options.rtol, options.max_iterations);
  double mass = 0.0;
  for (const Link& link : arm.links()) mass += link.mass();
  alpha.weight = mass * arm.gravity().squaredNorm();
}

Status ImplicitStep::start(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                           const Eigen::VectorXd& tau) {
  const Status status = jump(ws, q, v, tau);
  if (status != Status::ok) return status;
  iteration_->alpha.contraction = 1.0;
  iteration_->alpha.scale = 0.0;
  started_ = true;
  return Status::ok;
}

Status ImplicitStep::jump(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                          const Eigen::VectorXd& tau) {
  Alpha<Engine>& alpha = iteration_->alpha;
  const Status status = accelerate(ws, q, v, tau, friction_);
  if (status != Status::ok) return status;
  alpha.contacts.end_instant(v.data(), true);
  alpha.begin(ws.a.data(), true);
  alpha.h_before = 0.0;
  return Status::ok;
}

Status ImplicitStep::accelerate(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                const Eigen::VectorXd& tau, Eigen::VectorXd& friction) {
  iteration_->attach(ws);
  if (iteration_->rubs.empty()) return forward_dynamics(*arm_, ws, q, v, tau);
  const Status status = iteration_->settle(ws, q, v, tau);
  report(v, iteration_->alpha.contacts.force, friction);
  return status;
}

void ImplicitStep::report(const Eigen::VectorXd& v, const double* force, Eigen::VectorXd& friction) const {
  friction.setZero();
  for (const Rub& r : iteration_->rubs)  // of those that are prescribed; the others follow
    friction[r.rate] = v[r.rate] == 0.0 ? 0.0 : -std::copysign(r.coulomb, v[r.rate]);
  const Contacts<Engine>& contacts = iteration_->alpha.contacts;
  for (int c = 0; c < contacts.count; ++c) friction[contacts.at[c]] = force[c];
}

Status ImplicitStep::advance(double h, Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v,
                             const Eigen::VectorXd& tau, const Given& given) {
  if (!started_) {
    const Status status = start(ws, q, v, tau);
    if (status != Status::ok) return status;
  }
  iteration_->attach(ws);
  Engine& engine = iteration_->engine;
  Alpha<Engine>& alpha = iteration_->alpha;
  std::copy(v.begin(), v.end(), alpha.v0);
  if (given) given(1.0);
  std::copy(q.begin(), q.end(), alpha.q0);  // free ones are still those of the beginning
  alpha.predict(engine, h, ws.a.data());
  const bool good = alpha.iterate(engine, h, q.data(), v.data(), tau.data(), false);
  counts_.evaluations = alpha.evaluations;
  counts_.factorisations = alpha.factorisations;
  counts_.iterations = alpha.solves;
  const bool arrived = all_finite(q) && all_finite(v) && arm_->within_reach(q, v);
  if (!good || !arrived) {
    std::copy(alpha.q0, alpha.q0 + q.size(), q.begin());
    std::copy(alpha.v0, alpha.v0 + v.size(), v.begin());
    const bool sane = all_finite(q) && all_finite(v) && all_finite(tau) && all_finite(ws.a);
    return good || !sane ? Status::not_finite : Status::not_converged;
  }
  alpha.end(h, true);
  std::copy(alpha.a0, alpha.a0 + v.size(), ws.a.begin());
  if (iteration_->rubs.empty()) return Status::ok;
  Status status = Status::ok;
  if (alpha.contacts.end_step(v.data(), true)) {  // other forces act from here on
    ++counts_.switches;
    status = iteration_->settle(ws, q, v, tau);
    alpha.contacts.end_instant(v.data(), true);
    alpha.begin(ws.a.data(), true);
  }
  report(v, alpha.contacts.before, friction_);
  return status;
}

Rk4Step::Rk4Step(const Arm& arm, double h, DryFriction friction)
    : arm_(&arm),
      h_(positive("step", h)),
      q0_(arm.zero()),
      v0_(Eigen::VectorXd::Zero(arm.nv())),
      dq_(q0_),
      q_sum_(q0_),
      v_sum_(v0_) {
  if (friction == DryFriction::refused) refuse_friction(arm, "rk4");
}

Status Rk4Step::advance(double h, Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau,
                        const Given& given) {
  constexpr double times[] = {0.0, 0.5, 0.5, 1.0}, weights[] = {1.0, 2.0, 2.0, 1.0};
  q0_ = q;
  v0_ = v;
  q_sum_.setZero();
  v_sum_.setZero();
  Status status = Status::ok;
  for (int stage = 0; stage < 4 && status == Status::ok; ++stage) {
    if (stage > 0) {
      q = q0_ + times[stage] * h * dq_;
      v = v0_ + times[stage] * h * ws.a;
    }
    if (given) given(times[stage]);
    status = forward_dynamics(*arm_, ws, q, v, tau);
    ++counts_.evaluations;
    coordinate_rates(*arm_, q, v, dq_);
    q_sum_ += weights[stage] * dq_;
    v_sum_ += weights[stage] * ws.a;
  }
  if (status == Status::singular) status = Status::not_finite;  // no arm is; the motion has run away
  q = q0_ + h / 6.0 * q_sum_;
  v = v0_ + h / 6.0 * v_sum_;
  if (given) given(1.0);
  for (std::size_t n = 0; n < arm_->size(); ++n) arm_->link(n).joint().normalise(q.data() + arm_->first_q(n));
  if (!arm_->within_reach(q, v)) status = Status::not_finite;
  if (status != Status::ok) {
    q = q0_;
    v = v0_;
  }
  return status;
}

}  // namespace flexarm
