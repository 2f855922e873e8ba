#include "ida_system.hpp"

#include <algorithm>
#include <cmath>

#include "arrays.hpp"
#include "setup/single.hpp"

namespace flexarm {

namespace {

constexpr double kDependent = 1e-9;  // parts of a row of loops that others do not have: below, it depends on them

constexpr double kStiff = 1e-6;  // how far an elastic coordinate yields to the loops, beside one of a joint

constexpr double kOpen = 1e4;  // tolerances by which a row may be open (m, or rad)
constexpr double kLeastOpen = 1e-9;

}  // namespace

ChainInverse::ChainInverse(const Arm& arm, const std::vector<bool>& prescribed, const Control& control)
    : arm_(&arm), ws_(arm, prescribed), turn_(Eigen::VectorXd::Zero(arm.nv())), rhs_(turn_), ball_(arm.size()) {
  ws_.feed_back(control.feedback());
}

bool ChainInverse::factor(const System& s, double cj) {
  const Eigen::VectorXd &q = s.q, &v = s.v;
  ws_.feedback = s.ws.feedback;  // with their present offsets, which tell the laws at their limits
  ws_.limits = s.ws.limits;
  ws_.remembered = s.ws.remembered;
  move_chain(ws_, q, v);
  for (std::size_t n = 0; n < arm_->size(); ++n)
    if (const Joint& joint = arm_->link(n).joint(); joint.has_ball())
      ball_[n] = ball_rate_matrix(q.data() + arm_->first_q(n) + joint.nq() - 4);
  return factor_shifted(*arm_, ws_, q, v, {1.0 / cj, 1.0 / (cj * cj)}) == Status::ok;
}

void ChainInverse::solve(const Eigen::VectorXd& r1, const Eigen::VectorXd& r2, double cj, Eigen::VectorXd& dq,
                         Eigen::VectorXd& dv) {
  for (std::size_t n = 0; n < arm_->size(); ++n) {
    const Link& link = arm_->link(n);
    const int i = arm_->first_q(n), j = arm_->first(n), nq = link.joint().nq(), nj = link.nj(), ne = link.ne();
    turn_.segment(j, nj) = r1.segment(i, nj);
    if (link.joint().has_ball())  // E^T E is a quarter of the unit matrix
      turn_.segment<3>(j + nj - 3).noalias() = 4.0 * ball_[n].transpose() * r1.segment<4>(i + nq - 4);
    turn_.segment(j + nj, ne) = r1.segment(i + nq, ne);
  }
  stiffness_times(ws_, turn_, rhs_);
  rhs_ = (r2 - rhs_ / cj) / cj;
  solve_shifted(*arm_, ws_, rhs_, dv);
  for (std::size_t n = 0; n < arm_->size(); ++n) {
    const Link& link = arm_->link(n);
    const int i = arm_->first_q(n), j = arm_->first(n), nq = link.joint().nq(), nj = link.nj(), ne = link.ne();
    dq.segment(i, nj) = dv.segment(j, nj);
    if (link.joint().has_ball()) dq.segment<4>(i + nq - 4).noalias() = ball_[n] * dv.segment<3>(j + nj - 3);
    dq.segment(i + nq, ne) = dv.segment(j + nj, ne);
  }
  dq = (dq + r1) / cj;
}

void IdaSystem::set(double t, const double* y, const double* yp) {
  if (t != driven) drive(t);
  driven = t;
  for (int k = 0; k < n_q(); ++k) q[free_q[k]] = y[k];
  for (int k = 0; k < n_v(); ++k) {
    const int i = ws.free[k];
    v[i] = y[n_q() + k];
    if (yp) a[i] = yp[n_q() + k];
  }
  const double* loops = y + n_q() + n_v();
  for (int k = 0; k < n_loops(); ++k) {
    ws.loop_forces[static_cast<std::size_t>(rows[static_cast<std::size_t>(k)])] = loops[k];
    drift[k] = loops[n_loops() + k];
  }
}

void IdaSystem::choose_rows() {
  const Eigen::Index n = ws.chain().layout().rigid_rows;
  if (n == 0) return;
  G.resize(arm.nv(), n);
  found.resize(3, n);
  move_chain(ws, q, v);
  find_loops();
  Eigen::MatrixXd free(n_v(), n);
  for (int k = 0; k < n_v(); ++k) free.row(k) = G.row(ws.free[k]);
  const double least = kDependent * G.colwise().norm().maxCoeff();
  for (auto column : free.colwise()) {  // a row that nothing free moves is not chosen for its rounding
    const double size = column.norm();
    column *= size > least ? 1.0 / size : 0.0;
  }
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(free);
  qr.setThreshold(kDependent);
  for (Eigen::Index k = 0; k < qr.rank(); ++k) rows.push_back(qr.colsPermutation().indices()[k]);
  std::sort(rows.begin(), rows.end());
  yielding = Eigen::VectorXd::Ones(arm.nv());
  for (std::size_t k = 0; k < arm.size(); ++k)
    yielding.segment(arm.first(k) + arm.link(k).nj(), arm.link(k).ne()).setConstant(kStiff);
  ws.loop_forces.assign(static_cast<std::size_t>(n), 0.0);
  drift = Eigen::VectorXd::Zero(n_loops());
  shifted = v;
}

bool IdaSystem::loops_closed(double rtol) {
  if (rows.empty()) return true;
  move_chain(ws, q, v);
  find_loops();
  return found.row(0).cwiseAbs().maxCoeff() <= kOpen * std::max(rtol, kLeastOpen);
}

void IdaSystem::find_loops() { ws.chain().loop_rows(found.data(), G.data()); }

void IdaSystem::remember(double t, const double* y) {
  set(t, y, nullptr);
  System::remember();
}

bool IdaSystem::within_reach(const double* y) const {
  bool all = true;
  for (int k = 0; k < n_q(); ++k) all = all && std::abs(y[k]) <= arm.farthest()[free_q[k]];
  for (int k = 0; k < n_v(); ++k) all = all && std::abs(y[n_q() + k]) <= arm.fastest()[ws.free[k]];
  return all;
}

std::pair<Eigen::VectorXd, Eigen::VectorXd> IdaSystem::state() {
  Eigen::VectorXd y(size()), yp(size());
  coordinate_rates(arm, q, v, dq);
  for (int k = 0; k < n_q(); ++k) {
    y[k] = q[free_q[k]];
    yp[k] = dq[free_q[k]];
  }
  for (int k = 0; k < n_v(); ++k) {
    y[n_q() + k] = v[ws.free[k]];
    yp[n_q() + k] = a[ws.free[k]];
  }
  if (rows.empty()) return {y, yp};
  y.tail(2 * n_loops()).setZero();
  yp.tail(2 * n_loops()).setZero();
  std::fill(ws.loop_forces.begin(), ws.loop_forces.end(), 0.0);
  inverse_dynamics(arm, ws, q, v, a);
  find_loops();
  Eigen::MatrixXd columns(n_v(), n_loops());
  Eigen::VectorXd left(n_v());
  for (int k = 0; k < n_v(); ++k) {
    const int i = ws.free[k];
    left[k] = ws.tau[i] - tau[i] - friction[i];
    for (int r = 0; r < n_loops(); ++r) columns(k, r) = G(i, rows[static_cast<std::size_t>(r)]);
  }
  y.segment(n_q() + n_v(), n_loops()) = columns.colPivHouseholderQr().solve(left);
  return {y, yp};
}

bool IdaSystem::residual(const double* yp, double* r) {
  inverse_dynamics(arm, ws, q, v, a);
  if (rows.empty()) {
    coordinate_rates(arm, q, v, dq);
  } else {
    find_loops();
    shifted = v;
    for (int k = 0; k < n_loops(); ++k) {
      const int row = rows[static_cast<std::size_t>(k)];
      for (int i : ws.free) shifted[i] += yielding[i] * G(i, row) * drift[k];
      r[n_q() + n_v() + k] = found(0, row);
      r[n_q() + n_v() + n_loops() + k] = found(1, row);
    }
    coordinate_rates(arm, q, shifted, dq);
  }
  for (int k = 0; k < n_q(); ++k) r[k] = yp[k] - dq[free_q[k]];
  double sum = 0.0;
  for (int k = 0; k < n_v(); ++k) {
    const int i = ws.free[k];
    r[n_q() + k] = ws.tau[i] - tau[i];
    sum += std::abs(r[n_q() + k]);
  }
  return std::isfinite(sum);
}

}  // namespace flexarm
