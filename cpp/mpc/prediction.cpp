#include "prediction.hpp"

#include <algorithm>
#include <cmath>

#include "flexarm/check.hpp"
#include "flexarm/inverse.hpp"

namespace flexarm {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

Grid::Grid(const MpcOptions& o) {
  positive("period", o.period);
  positive("horizon", o.horizon);
  if (o.stages < 1 || o.stages > 1000) bad_value("stages", o.stages, "must be from 1 to 1000");
  if (o.blocks < 1 || o.blocks > o.stages) bad_value("blocks", o.blocks, "must be from 1 to the number of stages");
  const double rest = o.horizon - o.stages * o.period;
  if (rest < -1e-9 * o.horizon)
    bad_value("horizon", o.horizon, "must not be shorter than `stages` periods; take fewer stages");
  const Index n = o.stages, m = o.blocks;
  const double growth = n > 1 ? 2.0 * std::max(rest, 0.0) / static_cast<double>(n * (n - 1)) : 0.0;
  lengths.resize(n);
  times = VectorXd::Zero(n + 1);
  for (Index k = 0; k < n; ++k) {
    lengths[k] = o.period + growth * static_cast<double>(k);
    times[k + 1] = times[k] + lengths[k];
  }
  begins.resize(m);
  durations = VectorXd::Zero(m);
  std::vector<Index> first;  // stages
  for (Index b = 0; b <= m; ++b) {
    const double part = static_cast<double>(b) / static_cast<double>(m);
    first.push_back(b + static_cast<Index>(std::llround(static_cast<double>(n - m) * part * part)));
  }
  if (m > 1) first[1] = 1;  // it is the one applied
  for (Index b = 0; b < m; ++b) {
    const Index from = first[static_cast<std::size_t>(b)], to = first[static_cast<std::size_t>(b) + 1];
    begins[b] = times[from];
    durations[b] = times[to] - times[from];
    block.insert(block.end(), static_cast<std::size_t>(to - from), b);
  }
  shift = MatrixXd::Zero(m, m);
  for (Index b = 0; b < m; ++b) {
    const double from = begins[b] + o.period, to = from + durations[b];
    for (Index a = 0; a < m; ++a) {
      const double end = a + 1 < m ? begins[a + 1] : std::numeric_limits<double>::infinity();
      shift(b, a) = std::max(0.0, std::min(to, end) - std::max(from, begins[a])) / durations[b];
    }
  }
}

Prediction::Prediction(const Problem& problem, const Grid& grid, const std::vector<MpcOutput>& outputs,
                       const std::vector<MpcRow>& rows, const MpcOptions& options)
    : arm_(*problem.arm),
      grid_(grid),
      outputs_(outputs),
      rows_(rows),
      period_(options.period),
      carried_(options.carried),
      laws_(problem.samplers, arm_.nv()),
      nu_(options.columns.cols()),
      step_(problem, (MatrixXd(arm_.nv(), nu_ + laws_.columns().cols()) << options.columns, laws_.columns()).finished(),
            {}, options.friction_speed, static_cast<std::size_t>(grid.stages()) + 1) {
  const Index n = arm_.nv(), m = laws_.size(), all = 2 * n + m, forces = nu_ + laws_.columns().cols();
  const Index stages = grid.stages(), nz = nu_ * grid.blocks(), count = static_cast<Index>(rows.size());
  to_inputs_ = options.columns.completeOrthogonalDecomposition().pseudoInverse();
  for (const MpcOutput& output : outputs) {
    by_q_.push_back(VectorXd::Zero(arm_.nq()));
    for (int i = 0; i < arm_.nv(); ++i)
      if (arm_.coordinate_of(i) >= 0) by_q_.back()[arm_.coordinate_of(i)] = output.by_q[i];
    spot_of_.push_back(-1);
    if (!output.placed) continue;
    const auto same = [&](const Spot& s) { return s.link == output.link && s.x == output.x; };
    const auto found = std::find_if(spots_.begin(), spots_.end(), same);
    spot_of_.back() = static_cast<int>(found - spots_.begin());
    if (found == spots_.end())
      spots_.push_back({output.link, output.x, PlacedSlice(arm_, output.link, output.x),
                        MotionDerivatives(arm_, output.link, output.x), Eigen::Vector3d::Zero()});
  }
  at_ = zero();
  states = MatrixXd::Zero(arm_.nq() + n, stages + 1);
  held = MatrixXd::Zero(nu_, stages);
  values = VectorXd::Zero(stages * count);
  by_plan = RowMatrix::Zero(stages * count, nz);
  A_.assign(static_cast<std::size_t>(stages), MatrixXd::Zero(all, all));
  C_.assign(static_cast<std::size_t>(stages), MatrixXd::Zero(count, all));
  B_ = MatrixXd::Zero(all, nu_);
  S_ = S_next_ = MatrixXd::Zero(all, nz);
  A_step_ = MatrixXd::Zero(2 * n, 2 * n);
  B_step_ = MatrixXd::Zero(2 * n, forces);
  if (arm_.nq() != arm_.nv()) {
    E_ = MatrixXd::Zero(arm_.nq(), n);
    E_by_q_ = MatrixXd::Zero(arm_.nq(), arm_.nq());
  }
  a_ = tau_ = forces_ = still_ = none_ = VectorXd::Zero(n);
  inputs_ = VectorXd::Zero(forces);
  change_ = next_ = VectorXd::Zero(all);
}

MpcState Prediction::zero() const { return {arm_.zero(), VectorXd::Zero(arm_.nv()), VectorXd::Zero(laws_.size())}; }

void Prediction::hold(double t, const MpcState& at, Eigen::Ref<VectorXd> u) {
  System& s = step_.system();
  s.drive(t);
  still_.tail(carried_) = at.v.tail(carried_);
  inverse_dynamics(arm_, s.ws, at.q, still_, none_);
  a_ = s.ws.tau - s.tau;
  for (std::size_t k = 0; k < laws_.acting().size(); ++k)
    a_ -= at.z[laws_.acting()[k]] * laws_.columns().col(static_cast<Index>(k));
  u.noalias() = to_inputs_ * a_;
}

void Prediction::difference(const MpcState& from, const MpcState& to, VectorXd& change) {
  const Index n = arm_.nv();
  displacement(arm_, from.q, to.q, tau_);
  change.head(n) = tau_;
  change.segment(n, n) = to.v - from.v;
  change.tail(laws_.size()) = to.z - from.z;
}

/// The state at_ from time t on over h seconds under u, in parts that end where sampled laws do something.
/// @param A  null, or derivatives of its end by its beginning; then B_ by u
Status Prediction::advance(std::size_t which, double t, double h, const Eigen::Ref<const VectorXd>& u, MatrixXd* A) {
  const Index n = arm_.nv();
  inputs_.head(nu_) = u;
  if (laws_.size() == 0) {
    forces_.noalias() = step_.columns() * inputs_;
    const Status status = step_(which, t, h, at_.q, at_.v, forces_);
    if (A && status == Status::ok) step_.derivatives(*A, B_);
    return status;
  }
  std::vector<MatrixXd*> slopes;
  if (A) {
    A->setIdentity();
    B_.setZero();
    slopes = {A, &B_};
  }
  const double end = t + h, same = 1e-6 * period_;
  while (t < end - same) {
    if (E_.size() > 0) coordinate_rate_jacobians(arm_, at_.q, at_.v, E_by_q_, E_);
    laws_.pass(t, at_.q, at_.v, at_.z, slopes, E_);
    for (std::size_t k = 0; k < laws_.acting().size(); ++k)
      inputs_[nu_ + static_cast<Index>(k)] = at_.z[laws_.acting()[k]];
    const double next = laws_.next(t), to = next < end - same ? next : end;
    forces_.noalias() = step_.columns() * inputs_;
    if (const Status status = step_(which, t, to - t, at_.q, at_.v, forces_); status != Status::ok) return status;
    t = to;
    if (!A) continue;
    step_.derivatives(A_step_, B_step_);
    for (MatrixXd* s : slopes) {
      A_next_.noalias() = A_step_ * s->topRows(2 * n);
      for (std::size_t k = 0; k < laws_.acting().size(); ++k)
        A_next_ += B_step_.col(nu_ + static_cast<Index>(k)) * s->row(2 * n + laws_.acting()[k]);
      s->topRows(2 * n) = A_next_;
    }
    B_.topRows(2 * n) += B_step_.leftCols(nu_);
  }
  return Status::ok;
}

Status Prediction::step(double t, MpcState& state, const VectorXd& u) {
  std::swap(at_, state);
  const Status status = advance(static_cast<std::size_t>(grid_.stages()), t, period_, u, nullptr);
  std::swap(at_, state);
  return status;
}

Status Prediction::operator()(double t, const MpcState& from, const MatrixXd& plan) {
  const Index n = arm_.nv(), nq = arm_.nq(), count = static_cast<Index>(rows_.size());
  at_ = from;
  states.col(0) << at_.q, at_.v;
  S_.setZero();
  S_next_.setZero();
  for (Index k = 0; k < grid_.stages(); ++k) {
    const Index b = grid_.block[static_cast<std::size_t>(k)], known = nu_ * (b + 1);
    MatrixXd &A = A_[static_cast<std::size_t>(k)], &C = C_[static_cast<std::size_t>(k)];
    hold(t + grid_.times[k], at_, held.col(k));
    const Status status = advance(static_cast<std::size_t>(k), t + grid_.times[k], grid_.lengths[k], plan.col(b), &A);
    if (status != Status::ok) return status;
    states.col(k + 1).head(nq) = at_.q;
    states.col(k + 1).tail(n) = at_.v;
    S_next_.leftCols(known).noalias() = A * S_.leftCols(known);
    S_next_.middleCols(nu_ * b, nu_) += B_;
    S_.swap(S_next_);
    observe(k);
    by_plan.block(k * count, 0, count, known).noalias() = C * S_.leftCols(known);
  }
  return by_plan.allFinite() && values.allFinite() ? Status::ok : Status::not_finite;
}

/// Values of the rows at the end of a stage, where at_ is, and their derivatives by that state.
void Prediction::observe(Index stage) {
  const Index n = arm_.nv();
  const bool balls = E_.size() > 0;
  if (!spots_.empty()) {
    Workspace& ws = step_.system().ws;
    move_arm(arm_, ws, at_.q, at_.v);
    for (Spot& s : spots_) {
      s.p = slice_pose(ws, s.at).p;
      s.motion(arm_, at_.q, at_.v, none_);
    }
    if (balls) coordinate_rate_jacobians(arm_, at_.q, at_.v, E_by_q_, E_);
  }
  Index at = stage * static_cast<Index>(rows_.size()), row = 0;
  MatrixXd& C = C_[static_cast<std::size_t>(stage)];
  for (const MpcRow& r : rows_) {
    const MpcOutput& o = outputs_[r.output];
    auto by = C.row(row++);
    if (!o.placed) {
      by.segment(r.rate ? n : 0, n) = o.by_q.transpose();
      values[at++] = r.rate ? o.by_q.dot(at_.v) : by_q_[r.output].dot(at_.q);
      continue;
    }
    const Spot& s = spots_[static_cast<std::size_t>(spot_of_[r.output])];
    by.segment(r.rate ? n : 0, n).noalias() = o.along.transpose() * s.motion.dv.topRows<3>();
    if (r.rate && balls)
      by.head(n).noalias() = o.along.transpose() * s.motion.dq.topRows<3>() * E_;
    else if (r.rate)
      by.head(n).noalias() = o.along.transpose() * s.motion.dq.topRows<3>();
    values[at++] = r.rate ? by.segment(n, n).dot(at_.v) : o.along.dot(s.p);
  }
}

void Prediction::add_free(const VectorXd& change, VectorXd& rows) {
  const Index count = static_cast<Index>(rows_.size());
  change_ = change;
  for (Index k = 0; k < grid_.stages(); ++k) {
    next_.noalias() = A_[static_cast<std::size_t>(k)] * change_;
    change_.swap(next_);
    rows.segment(k * count, count).noalias() += C_[static_cast<std::size_t>(k)] * change_;
  }
}

}  // namespace flexarm
