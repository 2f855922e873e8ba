#include "tangents.hpp"

#include <cmath>

#include "arrays.hpp"
#include "flexarm/check.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/dry_friction.hpp"

namespace flexarm {

using Eigen::MatrixXd;
using Eigen::VectorXd;

Nears::Nears(const std::vector<Parameter>& parameters) {
  for (const Parameter& p : parameters) {
    if (p.neighbours.empty()) bad_value("neighbours of parameter " + std::to_string(size()), 0, "must be one or more");
    emplace_back();
    for (const Neighbour& n : p.neighbours) back().push_back(std::make_unique<Near>(n));
  }
}

template <class Value>
MatrixXd Nears::sum(const Value& value) const {
  MatrixXd out;
  for (std::size_t k = 0; k < size(); ++k)
    for (const std::unique_ptr<Near>& near : (*this)[k]) {
      const VectorXd& x = value(*near);
      if (out.size() == 0) out.setZero(x.size(), static_cast<Eigen::Index>(size()));
      out.col(static_cast<Eigen::Index>(k)) += near->of.weight * x;
    }
  return out;
}

MatrixXd Nears::q0() const {
  return sum([](const Near& n) -> const VectorXd& { return n.of.problem.q0; });
}
MatrixXd Nears::v0() const {
  return sum([](const Near& n) -> const VectorXd& { return n.of.problem.v0; });
}
MatrixXd Nears::held() const {
  return sum([](const Near& n) -> const VectorXd& { return n.control.held(); });
}

bool Nears::sample(double t, double until, const System& run, const MatrixXd& q, const MatrixXd& v, const MatrixXd& a) {
  bool changed = false;
  for (std::size_t k = 0; k < size(); ++k)
    for (const std::unique_ptr<Near>& near : (*this)[k]) {
      if (!near->control.due(until)) continue;
      const auto column = static_cast<Eigen::Index>(k);
      System& n = near->system;
      n.q = run.q + near->of.offset * q.col(column);
      n.v = run.v + near->of.offset * v.col(column);
      n.a = run.a + near->of.offset * a.col(column);
      n.drive(t);
      changed = near->control.run(until, n.q, n.v, n.a) || changed;
    }
  return changed;
}

StateTangents::StateTangents(System& system, const std::vector<Parameter>& parameters)
    : s_(system), slopes_(s_.arm, places(s_.loads)), near_(parameters) {
  const auto count = static_cast<Eigen::Index>(parameters.size());
  q = MatrixXd::Zero(s_.arm.nq(), count);
  v = a = inverse_by_p_ = applied_by_p_ = MatrixXd::Zero(s_.arm.nv(), count);
  P_.resize(s_.n_v(), count);
  for (const Parameter& p : parameters) forces_only_.push_back(p.forces_only);
  for (const auto& all : near_)
    for (const std::unique_ptr<Near>& near : all) check(*near);
  if (count == 0) return;
  q = near_.q0();
  v = near_.v0();
}

void StateTangents::check(const Near& near) const {
  const Arm& arm = *near.of.problem.arm;
  if (arm.nq() != s_.arm.nq() || arm.nv() != s_.arm.nv() || near.system.ws.free != s_.ws.free ||
      near.system.ws.feedback.size() != s_.ws.feedback.size() || near.of.problem.q0.size() != arm.nq() ||
      near.of.problem.v0.size() != arm.nv())
    bad_value("a neighbour's coordinates, motions or controllers", "others", "must be those of the run");
  if (near.system.ws.limits.size() != s_.ws.limits.size())
    bad_value("torque_limit", near.system.ws.limits.size(), "has no derivative where there is none");
  if (rubs(arm).size() != rubs(s_.arm).size())
    bad_value("coulomb or stiction", 0.0, "has no derivative where there is no dry friction");
}

void StateTangents::differ(double t, int column, const std::vector<std::unique_ptr<Near>>& all) {
  auto inverse = inverse_by_p_.col(column), forces = applied_by_p_.col(column);
  inverse.setZero();
  forces.setZero();
  VectorXd applied;
  for (int i = 0; i < s_.arm.nv(); ++i)
    if (s_.ws.prescribed[static_cast<std::size_t>(i)])
      q(s_.arm.coordinate_of(i), column) = v(i, column) = a(i, column) = 0.0;
  for (const std::unique_ptr<Near>& near : all) {
    System& n = near->system;
    const double weight = near->of.weight;
    n.q = s_.q;
    n.v = s_.v;
    n.a = s_.a;
    n.drive(t);
    applied = n.tau;
    add_on_sides(n.ws.feedback, n.ws.limits, sides_.data(), n.q, n.v, applied);
    forces += weight * applied;
    for (int i = 0; i < s_.arm.nv(); ++i) {
      if (!s_.ws.prescribed[static_cast<std::size_t>(i)]) continue;
      q(s_.arm.coordinate_of(i), column) += weight * n.q[s_.arm.coordinate_of(i)];
      v(i, column) += weight * n.v[i];
      a(i, column) += weight * n.a[i];
    }
    if (forces_only_[static_cast<std::size_t>(column)] && s_.n_v() == s_.arm.nv())
      continue;  // else it may move a held rate
    move_chain(n.ws, n.q, n.v);
    joint_forces(n.arm, n.ws, n.a);
    inverse += weight * n.ws.tau;
  }
}

void StateTangents::linearise(double t) {
  for (std::size_t k = 0; k < s_.ws.loads.size(); ++k) slopes_.set_wrench(k, s_.ws.loads[k].wrench);
  slopes_(s_.arm, s_.q, s_.v, s_.a);
  by_q_ = slopes_.dq;
  by_v_ = slopes_.dv;
  add_feedback_slopes(s_.ws.feedback, s_.ws.limits, s_.q, s_.v, by_q_, by_v_);
  sides_.resize(s_.ws.feedback.size() + s_.ws.limits.size());
  sides(s_.ws.feedback, s_.ws.limits, s_.q, s_.v, sides_.data());
  composite_mass_matrix(s_.arm, s_.ws, s_.q);
  K_ = by_q_(s_.ws.free, s_.free_q);
  C_ = by_v_(s_.ws.free, s_.ws.free);
  M_ = s_.ws.M(s_.ws.free, s_.ws.free);
  if (balls()) {
    MatrixXd by_q(s_.arm.nq(), s_.arm.nq()), by_v(s_.arm.nq(), s_.arm.nv());
    coordinate_rate_jacobians(s_.arm, s_.q, s_.v, by_q, by_v);
    rate_by_q_ = by_q(s_.free_q, s_.free_q);
    rate_by_v_ = by_v(s_.free_q, s_.ws.free);
  }
  for (int k = 0; k < size(); ++k) differ(t, k, near_[static_cast<std::size_t>(k)]);
  P_ = inverse_by_p_(s_.ws.free, Eigen::all) - applied_by_p_(s_.ws.free, Eigen::all);
}

bool StateTangents::accelerate() {
  const MatrixXd force = -(K_ * q(s_.free_q, Eigen::all) + C_ * v(s_.ws.free, Eigen::all) + P_);
  const MatrixXd found = M_.ldlt().solve(force);
  a(s_.ws.free, Eigen::all) = found;
  return a.allFinite();
}

void StateTangents::correct(double cj, const MatrixXd& r1, const MatrixXd& r2, MatrixXd& dq, MatrixXd& dv) {
  if (!balls()) {
    factor_.compute(cj * M_ + C_ + K_ / cj);
    dv = factor_.solve(K_ * r1 / cj - r2);
    dq = (dv - r1) / cj;
    return;
  }
  const Eigen::PartialPivLU<MatrixXd> own(cj * MatrixXd::Identity(s_.n_q(), s_.n_q()) - rate_by_q_);
  const MatrixXd by_v = own.solve(rate_by_v_), by_r1 = own.solve(r1);
  factor_.compute(cj * M_ + C_ + K_ * by_v);
  dv = factor_.solve(K_ * by_r1 - r2);
  dq = by_v * dv - by_r1;
}

MatrixXd StateTangents::rates(const MatrixXd& q_free, const MatrixXd& v_free) const {
  return balls() ? MatrixXd(rate_by_q_ * q_free + rate_by_v_ * v_free) : v_free;
}

bool StateTangents::sample(double t) {
  if (!s_.control.due(t)) return false;
  if (s_.accelerate() == Status::ok) s_.a = s_.ws.a;
  linearise(t);
  accelerate();
  return near_.sample(t, t, s_, q, v, a);
}

bool StateTangents::record(double t, std::vector<Trajectory::Tangent>& out, Eigen::Index row) {
  linearise(t);
  if (!accelerate()) return false;
  const std::vector<int>& free = s_.ws.free;
  const auto all = Eigen::all;
  const MatrixXd q_free = q(s_.free_q, all), v_free = v(free, all);
  MatrixXd total =
      applied_by_p_ + (slopes_.dq - by_q_)(all, s_.free_q) * q_free + (slopes_.dv - by_v_)(all, free) * v_free;
  MatrixXd friction = MatrixXd::Zero(s_.arm.nv(), size());
  for (const Drive& d : s_.drives) {
    if (!d.motion) continue;
    const int i = d.coordinate;
    const Eigen::RowVectorXd reaction = inverse_by_p_.row(i) + slopes_.dq.row(i)(s_.free_q) * q_free +
                                        slopes_.dv.row(i)(free) * v_free + s_.ws.M.row(i)(free) * a(free, all);
    if (d.rubs)
      friction.row(i) = reaction - total.row(i);
    else
      total.row(i) = reaction;
  }
  for (int k = 0; k < size(); ++k) {
    Trajectory::Tangent& tangent = out[static_cast<std::size_t>(k)];
    tangent.q.row(row) = q.col(k);
    tangent.v.row(row) = v.col(k);
    tangent.a.row(row) = a.col(k);
    tangent.tau.row(row) = total.col(k);
    tangent.friction.row(row) = friction.col(k);
  }
  return total.allFinite();
}

}  // namespace flexarm
