#include "flexarm/ab.hpp"

#include <cmath>

#include "arrays.hpp"
#include "setup/single.hpp"
#include "step/feedback.hpp"

namespace flexarm {

Status status_of(lanes::Outcome outcome) {
  return outcome == lanes::Outcome::good       ? Status::ok
         : outcome == lanes::Outcome::singular ? Status::singular
                                               : Status::not_finite;
}

long operation_count(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  return lanes::operation_count(lanes::KernelArm::of(arm), q.data(), v.data());
}

Status forward(Workspace& ws, const double* q, const double* v, const double* tau, double* a) {
  using Array = Eigen::Map<const Eigen::VectorXd>;
  const Eigen::Index nv = ws.a.size();
  const Array all_q(q, ws.nq()), all_v(v, nv);
  if (!ws.feedback.empty() || !ws.limits.empty()) {
    ws.give(tau);
    ws.total = Array(tau, nv);
    add_feedback(ws, all_q, all_v, 1.0, ws.total);
    tau = ws.total.data();
  }
  const Status status = status_of(ws.chain_to_move().forward(q, v, tau, a));
  if (!all_finite(all_q) || !all_finite(all_v)) return Status::not_finite;
  return status != Status::ok || all_finite(Array(a, nv)) ? status : Status::not_finite;
}

Status forward_dynamics_ab(const Arm&, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                           const Eigen::VectorXd& tau) {
  return forward(ws, q.data(), v.data(), tau.data(), ws.a.data());
}

Status forward_dynamics(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                        const Eigen::VectorXd& tau) {
  return forward_dynamics_ab(arm, ws, q, v, tau);
}

namespace {

/// The laws of the workspace, for the kernel's Woodbury formula.
FeedbackLaws<double> laws_of(const Arm& arm, Workspace& ws) {
  FeedbackLaws<double> laws;
  laws.laws = static_cast<int>(ws.feedback.size());
  laws.nq = arm.nq();
  laws.nv = arm.nv();
  laws.limits = static_cast<int>(ws.limits.size());
  double* at = ws.feedback_numbers.data();
  laws.column = at;
  laws.by_q = laws.column + laws.laws * laws.nv;
  laws.by_v = laws.by_q + laws.laws * laws.nq;
  laws.limit = laws.by_v + laws.laws * laws.nv;
  laws.most = laws.limit + laws.laws;
  Arena arena(at + laws.laws * (2 * laws.nv + laws.nq + 1) + laws.limits);
  laws.lay_out(arena);
  for (int l = 0; l < laws.laws; ++l) laws.offset[l] = ws.feedback[static_cast<std::size_t>(l)].offset;
  return laws;
}

/// The motor's force beside the laws, of a limit.
auto beside(const Workspace& ws) {
  return [&ws](int c) {
    const AppliedLimit& l = ws.limits[static_cast<std::size_t>(c)];
    return l.given - l.friction;
  };
}

}  // namespace

Status factor(const Arm& arm, Workspace& ws, const double* q, const double* v, const lanes::Shift& shift) {
  const Status status = status_of(ws.placed_chain().factor(shift, v, ws.twice_kinetic));
  if (status != Status::ok) return status;
  if (!ws.feedback.empty()) {
    make_room_for_limits(ws);
    FeedbackLaws<double> laws = laws_of(arm, ws);
    laws.factor(
        shift, q, v, ws.free.data(), static_cast<int>(ws.free.size()), [&](int i) { return arm.coordinate_of(i); },
        [&](int c) { return ws.limits[static_cast<std::size_t>(c)].rate; }, beside(ws),
        [&](const double* r, double* x) { ws.chain().solve(r, x); });
  }
  return std::isfinite(ws.twice_kinetic) ? Status::ok : Status::not_finite;
}

void solve(const Arm& arm, Workspace& ws, const double* r, double* x) {
  ws.chain().solve(r, x);
  if (!ws.feedback.empty()) laws_of(arm, ws).correct(x);
}

bool correction(const Arm& arm, Workspace& ws, const double* q, const double* v, double* r, double* x) {
  ws.chain().correct(r, x);
  return !ws.feedback.empty() && laws_of(arm, ws).correct_within(q, v, beside(ws), x);
}

Status factor_shifted(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                      const Shift& shift) {
  return factor(arm, ws, q.data(), v.data(), {shift.damping, shift.stiffness});
}

void solve_shifted(const Arm& arm, Workspace& ws, const Eigen::VectorXd& r, Eigen::VectorXd& x) {
  solve(arm, ws, r.data(), x.data());
}

}  // namespace flexarm
