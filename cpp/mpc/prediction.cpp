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
  if (m > 1) first[1] = 1;  // it is what is applied
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

Prediction::Prediction(const Arm& arm, const Grid& grid, const std::vector<MpcOutput>& outputs,
                       const std::vector<MpcRow>& rows, const MpcOptions& options)
    : arm_(arm),
      grid_(grid),
      outputs_(outputs),
      rows_(rows),
      period_(options.period),
      step_(arm, options.columns, static_cast<std::size_t>(grid.stages()) + 1, options.friction_speed),
      columns_(options.columns) {
  const Index n = arm.nv(), nu = columns_.cols(), stages = grid.stages(), nz = nu * grid.blocks();
  to_inputs_ = columns_.completeOrthogonalDecomposition().pseudoInverse();
  for (const MpcOutput& output : outputs) {
    spot_of_.push_back(-1);
    if (!output.placed) continue;
    const auto same = [&](const Spot& s) { return s.link == output.link && s.x == output.x; };
    const auto found = std::find_if(spots_.begin(), spots_.end(), same);
    spot_of_.back() = static_cast<int>(found - spots_.begin());
    if (found == spots_.end())
      spots_.push_back({output.link, output.x, PlacedSlice(arm, output.link, output.x),
                        MotionDerivatives(arm, output.link, output.x), Eigen::Vector3d::Zero()});
  }
  const Index count = static_cast<Index>(rows.size());
  states = MatrixXd::Zero(2 * n, stages + 1);
  held = MatrixXd::Zero(nu, stages);
  values = VectorXd::Zero(stages * count);
  by_plan = RowMatrix::Zero(stages * count, nz);
  A_.assign(static_cast<std::size_t>(stages), MatrixXd::Zero(2 * n, 2 * n));
  C_.assign(static_cast<std::size_t>(stages), MatrixXd::Zero(count, 2 * n));
  B_ = MatrixXd::Zero(2 * n, nu);
  S_ = S_next_ = MatrixXd::Zero(2 * n, nz);
  q_ = v_ = a_ = tau_ = VectorXd::Zero(n);
  change_ = next_ = VectorXd::Zero(2 * n);
}

void Prediction::hold(const VectorXd& q, Eigen::Ref<VectorXd> u) {
  a_.setZero();
  inverse_dynamics(arm_, step_.workspace(), q, a_, a_);
  u.noalias() = to_inputs_ * step_.workspace().tau;
}

Status Prediction::step(VectorXd& q, VectorXd& v, const VectorXd& u) {
  tau_.noalias() = columns_ * u;
  return step_(static_cast<std::size_t>(grid_.stages()), period_, q, v, tau_);
}

Status Prediction::operator()(const VectorXd& q, const VectorXd& v, const MatrixXd& plan) {
  const Index n = arm_.nv(), nu = columns_.cols(), count = static_cast<Index>(rows_.size());
  states.col(0).head(n) = q_ = q;
  states.col(0).tail(n) = v_ = v;
  S_.setZero();
  S_next_.setZero();
  for (Index k = 0; k < grid_.stages(); ++k) {
    const Index b = grid_.block[static_cast<std::size_t>(k)], known = nu * (b + 1);
    MatrixXd &A = A_[static_cast<std::size_t>(k)], &C = C_[static_cast<std::size_t>(k)];
    hold(q_, held.col(k));
    tau_.noalias() = columns_ * plan.col(b);
    const Status status = step_(static_cast<std::size_t>(k), grid_.lengths[k], q_, v_, tau_);
    if (status != Status::ok) return status;
    step_.derivatives(A, B_);
    states.col(k + 1).head(n) = q_;
    states.col(k + 1).tail(n) = v_;
    S_next_.leftCols(known).noalias() = A * S_.leftCols(known);
    S_next_.middleCols(nu * b, nu) += B_;
    S_.swap(S_next_);
    observe(k);
    by_plan.block(k * count, 0, count, known).noalias() = C * S_.leftCols(known);
  }
  return by_plan.allFinite() && values.allFinite() ? Status::ok : Status::not_finite;
}

/// Values of the rows at the end of a stage, where q_ and v_ are, and their derivatives by that state.
void Prediction::observe(Index stage) {
  const Index n = arm_.nv();
  if (!spots_.empty()) {
    Workspace& ws = step_.workspace();
    move_arm(arm_, ws, q_, v_);
    a_.setZero();
    for (Spot& s : spots_) {
      s.p = slice_pose(ws, s.at).p;
      s.motion(arm_, q_, v_, a_);
    }
  }
  Index at = stage * static_cast<Index>(rows_.size()), row = 0;
  MatrixXd& C = C_[static_cast<std::size_t>(stage)];
  for (const MpcRow& r : rows_) {
    const MpcOutput& o = outputs_[r.output];
    auto by = C.row(row++);
    if (!o.placed) {
      by.segment(r.rate ? n : 0, n) = o.by_q.transpose();
      values[at++] = o.by_q.dot(r.rate ? v_ : q_);
      continue;
    }
    const Spot& s = spots_[static_cast<std::size_t>(spot_of_[r.output])];
    by.segment(r.rate ? n : 0, n).noalias() = o.along.transpose() * s.motion.dv.topRows<3>();
    if (r.rate) by.head(n).noalias() = o.along.transpose() * s.motion.dq.topRows<3>();
    values[at++] = r.rate ? by.tail(n).dot(v_) : o.along.dot(s.p);
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
