#include "flexarm/mpc.hpp"

#include <cmath>
#include <string>

#include "flexarm/check.hpp"
#include "flexarm/dry_friction.hpp"
#include "kalman_parts.hpp"
#include "prediction.hpp"
#include "qp.hpp"

namespace flexarm {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

void check(const Arm& arm, std::size_t k, const MpcOutput& o) {
  if (o.placed ? !(o.along.allFinite() && o.along.norm() > 0.0) : o.by_q.size() != arm.nv() || !o.by_q.allFinite())
    bad_value(entry("outputs", k, "by_q"), o.by_q.size(),
              "must be finite numbers, one for each rate; of a place: along");
  for (int i = 0; !o.placed && i < arm.nv(); ++i)
    if (o.by_q[i] != 0.0 && arm.coordinate_of(i) < 0)
      bad_value(entry("outputs", k, "by_q"), "of a ball", "a ball has no coordinates to be led; take places");
  non_negative(entry("outputs", k, "weight"), o.weight);
  non_negative(entry("outputs", k, "rate_weight"), o.rate_weight);
  if (!(o.lower < o.upper)) bad_value(entry("outputs", k, "lower"), o.lower, "must be below `upper`");
  if (!(o.rate_lower < o.rate_upper)) bad_value(entry("outputs", k, "rate_lower"), o.rate_lower, "must be below");
}

void check_inputs(const char* field, const VectorXd& x, Index nu, double least) {
  if (x.size() != nu) bad_value(field, x.size(), "numbers; must be one for each input, " + std::to_string(nu));
  for (Index k = 0; k < nu; ++k)
    if (!(x[k] >= least)) bad_value(std::string(field) + "[" + std::to_string(k) + "]", x[k], "must not be negative");
}

void check(const Problem& problem, const MpcOptions& o) {
  const Arm& arm = *problem.arm;
  const Index nu = o.columns.cols();
  refuse_contact_friction(arm, "predictive control");
  refuse_loops(arm, "predictive control");
  if (nu < 1 || o.columns.rows() != arm.nv() || !o.columns.allFinite())
    bad_value("columns", o.columns.rows(), "rows; must be finite, a row for each rate, a column for each input");
  for (const Drive& d : problem.drives)
    if (d.motion && !o.columns.row(d.coordinate).isZero(0.0))
      bad_value("columns", d.coordinate, "is a rate whose motion is prescribed; no input moves it");
  const double inf = std::numeric_limits<double>::infinity();
  check_inputs("lower", o.lower, nu, -inf);
  check_inputs("upper", o.upper, nu, -inf);
  for (Index k = 0; k < nu; ++k)
    if (!(o.lower[k] <= o.upper[k])) bad_value("lower[" + std::to_string(k) + "]", o.lower[k], "must be below `upper`");
  check_inputs("rate_limit", o.rate_limit, nu, 0.0);
  for (Index k = 0; k < nu; ++k) positive("rate_limit", std::min(o.rate_limit[k], 1e300));
  check_inputs("effort", o.effort, nu, 0.0);
  check_inputs("rate_effort", o.rate_effort, nu, 0.0);
  for (Index k = 0; k < nu; ++k)
    if (!(o.effort[k] + o.rate_effort[k] > 0.0) || !std::isfinite(o.effort[k] + o.rate_effort[k]))
      bad_value("effort[" + std::to_string(k) + "]", o.effort[k], "effort or rate_effort must be positive, and finite");
  non_negative("terminal", o.terminal);
  positive("soft", o.soft);
  positive("friction_speed", o.friction_speed);
  if (o.carried < 0 || o.carried > arm.nv()) bad_value("carried", o.carried, "must be of the arm's rates");
  if (o.iterations < 1) bad_value("iterations", o.iterations, "must be at least 1");
  if (o.max_qp_iterations < 1) bad_value("max_qp_iterations", o.max_qp_iterations, "must be at least 1");
}

std::vector<MpcRow> rows_of(const std::vector<MpcOutput>& outputs) {
  std::vector<MpcRow> rows;
  for (std::size_t k = 0; k < outputs.size(); ++k) {
    const MpcOutput& o = outputs[k];
    const MpcRow value{k, false, o.weight, o.lower, o.upper}, rate{k, true, o.rate_weight, o.rate_lower, o.rate_upper};
    for (const MpcRow& row : {value, rate})
      if (row.weight > 0.0 || row.limited()) rows.push_back(row);
  }
  return rows;
}

/// The unit in which the violation of a limit is measured.
double span(const MpcRow& r) {
  const double size = r.upper - r.lower;
  if (std::isfinite(size)) return 0.5 * size;
  return std::max(1e-3, std::abs(std::isfinite(r.upper) ? r.upper : r.lower));
}

}  // namespace

MpcOutput MpcOutput::joint(const Arm& arm, int rate) {
  checked_joint(arm, "rate", rate);
  if (arm.coordinate_of(rate) < 0) bad_value("rate", rate, "is of a ball, which has no coordinates to be led");
  MpcOutput out;
  out.by_q = VectorXd::Unit(arm.nv(), rate);
  return out;
}

MpcOutput MpcOutput::place(const Arm& arm, std::size_t link, std::optional<double> x, const Eigen::Vector3d& along) {
  if (link >= arm.size()) bad_value("link", link, "there is no such link");
  MpcOutput out;
  out.by_q = VectorXd::Zero(arm.nv());
  out.placed = true;
  out.link = link;
  out.x = x;
  out.along = along;
  return out;
}

struct Mpc::Impl {
  const Problem problem;
  const Arm& arm;
  const std::vector<MpcOutput> outputs;
  const MpcOptions options;
  const Reference reference;
  const std::vector<MpcRow> rows;
  const Grid grid;
  Prediction prediction;
  std::vector<Index> limited;  ///< rows with limits, of those of a stage
  std::vector<Index> rated;    ///< inputs with limited rates
  Qp qp;
  MatrixXd plan, shifted;
  VectorXd u, forces, aims, weights, values, gaps, change, r, dr, block_times;
  MpcState begin;    ///< of the plan
  MpcState carried;  ///< at the next sample, of unmeasured coordinates
  MpcState now;
  double time = 0.0;  ///< of the plan's begin
  bool planned = false, prepared = false;
  long failures = 0;

  Impl(const Problem& problem_, const std::vector<MpcOutput>& outputs_, const MpcOptions& options_,
       Reference reference_);
  Index nu() const { return options.columns.cols(); }
  Index nv() const { return arm.nv(); }
  static VectorXd penalties(const MpcOptions& o, const std::vector<MpcRow>& rows, const Grid& grid, bool linear);
  void hold(double t, const MpcState& at, bool applied);
  Status linearise(double t);
  void build();
  bool solve();
  Status answer(double t, const VectorXd& at_q, const VectorXd& at_v);
  void apply();
};

/// Of the rows of the quadratic program: limits of outputs, stage by stage, then of rates of inputs, block by block.
VectorXd Mpc::Impl::penalties(const MpcOptions& o, const std::vector<MpcRow>& rows, const Grid& grid, bool linear) {
  std::vector<double> out;
  for (Index k = 0; k < grid.stages(); ++k)
    for (const MpcRow& r : rows)
      if (r.limited()) out.push_back(o.soft * grid.lengths[k] / (linear ? span(r) : span(r) * span(r)));
  for (Index b = 0; b < grid.blocks(); ++b)
    for (Index j = 0; j < o.columns.cols(); ++j)
      if (std::isfinite(o.rate_limit[j])) out.push_back(0.0);
  return Eigen::Map<VectorXd>(out.data(), static_cast<Index>(out.size()));
}

namespace {
const MpcOptions& checked(const Problem& problem, const std::vector<MpcOutput>& outputs, const MpcOptions& options) {
  problem.check();
  for (std::size_t k = 0; k < outputs.size(); ++k) check(*problem.arm, k, outputs[k]);
  check(problem, options);
  return options;
}
}  // namespace

Mpc::Impl::Impl(const Problem& problem_, const std::vector<MpcOutput>& outputs_, const MpcOptions& options_,
                Reference reference_)
    : problem(problem_),
      arm(*problem.arm),
      outputs(outputs_),
      options(checked(problem, outputs_, options_)),
      reference(std::move(reference_)),
      rows(rows_of(outputs)),
      grid(options),
      prediction(problem, grid, outputs, rows, options),
      qp(static_cast<int>(nu() * grid.blocks()), penalties(options, rows, grid, true),
         penalties(options, rows, grid, false), options.max_qp_iterations) {
  for (std::size_t k = 0; k < rows.size(); ++k)
    if (rows[k].limited()) limited.push_back(static_cast<Index>(k));
  for (Index j = 0; j < nu(); ++j)
    if (std::isfinite(options.rate_limit[j])) rated.push_back(j);
  const Index all = grid.stages() * static_cast<Index>(rows.size());
  plan = shifted = MatrixXd::Zero(nu(), grid.blocks());
  u = VectorXd::Zero(nu());
  forces = VectorXd::Zero(nv());
  begin = carried = now = prediction.zero();
  change = VectorXd::Zero(2 * nv() + begin.z.size());
  aims = weights = values = gaps = VectorXd::Zero(all);
  r = dr = VectorXd::Zero(static_cast<Index>(outputs.size()));
  block_times = VectorXd::Zero(grid.blocks() + 1);
  Index at = 0;
  for (Index k = 0; k < grid.stages(); ++k) {
    const double last = k + 1 == grid.stages() ? options.terminal : 0.0;
    for (const MpcRow& row : rows) weights[at++] = row.weight * (grid.lengths[k] + last);
  }
  // rows of rates of inputs never change
  const Index first = grid.stages() * static_cast<Index>(limited.size());
  Index row = first;
  if (row < qp.A.rows()) qp.A.bottomRows(qp.A.rows() - row).setZero();
  for (Index b = 0; b < grid.blocks(); ++b)
    for (const Index j : rated) {
      qp.A(row, b * nu() + j) = 1.0;
      if (b > 0) qp.A(row, (b - 1) * nu() + j) = -1.0;
      ++row;
    }
  block_times << grid.begins, grid.times[grid.stages()];
  hold(0.0, begin, true);
}

/// The plan that holds the arm at time t, and, if nothing was applied yet, its inputs as those.
void Mpc::Impl::hold(double t, const MpcState& at, bool applied) {
  prediction.hold(t, at, plan.col(0));
  for (Index j = 0; j < nu(); ++j) {
    const double x = std::isfinite(plan(j, 0)) ? plan(j, 0) : 0.0;
    plan.row(j).setConstant(std::min(std::max(x, options.lower[j]), options.upper[j]));
  }
  if (!applied) return;
  u = plan.col(0);
  forces.noalias() = options.columns * u;
}

/// Predicts from `begin` at time t under the plan, and makes the quadratic program in the plan's changes.
Status Mpc::Impl::linearise(double t) {
  prepared = false;
  for (Index j = 0; j < nu(); ++j)  // to the last bit: a motor beyond its limit would feel no change
    for (Index b = 0; b < grid.blocks(); ++b)
      plan(j, b) = std::min(std::max(plan(j, b), options.lower[j]), options.upper[j]);
  if (const Status status = prediction(t, begin, plan); status != Status::ok) return status;
  time = t;
  Index at = 0;
  for (Index k = 0; k < grid.stages(); ++k) {
    reference(t + grid.times[k + 1], r, dr);
    for (const MpcRow& row : rows) {
      const Index output = static_cast<Index>(row.output);
      aims[at++] = row.weight > 0.0 ? (row.rate ? dr[output] : r[output]) : 0.0;
    }
  }
  if (!aims.allFinite()) return Status::not_finite;
  build();
  prepared = qp.prepare();
  return prepared ? Status::ok : Status::singular;
}

/// The Hessian and the rows of limits.
void Mpc::Impl::build() {
  const Index count = static_cast<Index>(rows.size()), m = nu();
  qp.H.setZero();
  for (Index k = 0; k < grid.stages(); ++k) {
    const Index b = grid.block[static_cast<std::size_t>(k)], known = m * (b + 1);
    for (Index i = k * count; i < (k + 1) * count; ++i) {
      if (weights[i] == 0.0) continue;
      const auto by = prediction.by_plan.row(i).head(known).transpose();
      qp.H.topLeftCorner(known, known).selfadjointView<Eigen::Lower>().rankUpdate(by, weights[i]);
    }
    for (Index j = 0; j < m; ++j) qp.H(b * m + j, b * m + j) += options.effort[j] * grid.lengths[k];
    Index row = k * static_cast<Index>(limited.size());
    for (const Index i : limited) qp.A.row(row++) = prediction.by_plan.row(k * count + i);
  }
  for (Index b = 0; b < grid.blocks(); ++b) {
    const double between = b > 0 ? grid.begins[b] - grid.begins[b - 1] : options.period;
    for (Index j = 0; j < m; ++j) {
      const Index i = b * m + j;
      qp.H(i, i) += options.rate_effort[j] / between;
      if (b == 0) continue;
      qp.H(i - m, i - m) += options.rate_effort[j] / between;
      qp.H(i, i - m) -= options.rate_effort[j] / between;
    }
  }
  qp.H.triangularView<Eigen::StrictlyUpper>() = qp.H.transpose();
  qp.f.setZero();
  qp.lower.setConstant(-1.0);
  qp.upper.setConstant(1.0);
}

/// The gradient and the bounds where the first state is off by `change`, and their solution.
bool Mpc::Impl::solve() {
  const Index count = static_cast<Index>(rows.size()), m = nu(), nz = qp.f.size();
  values = prediction.values;
  prediction.add_free(change, values);
  gaps = weights.cwiseProduct(values - aims);
  qp.f.noalias() = prediction.by_plan.transpose() * gaps;
  for (Index k = 0; k < grid.stages(); ++k) {
    const Index b = grid.block[static_cast<std::size_t>(k)];
    for (Index j = 0; j < m; ++j)
      qp.f[b * m + j] += options.effort[j] * grid.lengths[k] * (plan(j, b) - prediction.held(j, k));
  }
  Index row = nz;
  const auto bound = [this](double x) { return std::min(std::max(x, -1e30), 1e30); };
  for (Index k = 0; k < grid.stages(); ++k)
    for (const Index i : limited) {
      const MpcRow& r_ = rows[static_cast<std::size_t>(i)];
      qp.lower[row] = bound(r_.lower - values[k * count + i]);
      qp.upper[row++] = bound(r_.upper - values[k * count + i]);
    }
  for (Index b = 0; b < grid.blocks(); ++b) {
    const double between = b > 0 ? grid.begins[b] - grid.begins[b - 1] : options.period;
    for (Index j = 0; j < m; ++j) {
      const Index i = b * m + j;
      const double before = b > 0 ? plan(j, b - 1) : u[j], up = plan(j, b) - before;
      qp.lower[i] = bound(options.lower[j] - plan(j, b));
      qp.upper[i] = bound(options.upper[j] - plan(j, b));
      qp.f[i] += options.rate_effort[j] / between * up;
      if (b > 0) qp.f[i - m] -= options.rate_effort[j] / between * up;
      if (!std::isfinite(options.rate_limit[j])) continue;
      qp.lower[row] = -options.rate_limit[j] * between - up;
      qp.upper[row++] = options.rate_limit[j] * between - up;
    }
  }
  if (!qp.solve()) return false;
  plan += Eigen::Map<const MatrixXd>(qp.z.data(), m, grid.blocks());
  return true;
}

/// Within the limits to the last bit, which the solver keeps to a tolerance.
void Mpc::Impl::apply() {
  for (Index j = 0; j < nu(); ++j) {
    const double most = options.rate_limit[j] * options.period;
    u[j] = std::min(std::max(plan(j, 0), u[j] - most), u[j] + most);
    u[j] = std::min(std::max(u[j], options.lower[j]), options.upper[j]);
  }
  plan.col(0) = u;
  forces.noalias() = options.columns * u;
}

Status Mpc::Impl::answer(double t, const VectorXd& at_q, const VectorXd& at_v) {
  now = carried;
  now.q.head(at_q.size()) = at_q;
  now.v.head(at_v.size()) = at_v;
  Status seen =
      at_q.allFinite() && at_v.allFinite() && arm.within_reach(now.q, now.v) ? Status::ok : Status::not_finite;
  const double start = t + (options.delayed ? options.period : 0.0);
  if (seen == Status::ok && options.delayed) {
    seen = prediction.step(t, now, u);
    if (seen == Status::ok) carried = now;
  }
  if (std::abs(start - time) > 0.5 * options.period) prepared = false;
  if (seen != Status::ok) {  // it goes on as predicted
    if (!planned) return seen;
    change.setZero();
    if (prepared) solve();
    apply();
    return seen;
  }
  if (!planned) hold(start, now, true);
  planned = true;
  if (prepared) {
    prediction.difference(begin, now, change);
    begin = now;
  } else {
    begin = now;
    change.setZero();
    Status status = linearise(start);
    if (status != Status::ok) {  // not under this plan
      hold(start, begin, false);
      status = linearise(start);
    }
    if (status != Status::ok) {
      apply();
      return status;
    }
  }
  bool solved = solve();
  for (int k = 1; k < options.iterations && solved; ++k) {
    change.setZero();
    solved = linearise(start) == Status::ok && solve();
  }
  apply();
  return solved ? Status::ok : Status::not_converged;
}

Mpc::Mpc(const Problem& problem, const std::vector<MpcOutput>& outputs, const MpcOptions& options, Reference reference)
    : impl_(std::make_unique<Impl>(problem, outputs, options, std::move(reference))) {}

Mpc::~Mpc() = default;

void Mpc::reset() {
  Impl& m = *impl_;
  m.planned = m.prepared = false;
  m.failures = 0;
  m.qp.forget();
  m.begin = m.carried = m.prediction.zero();
  m.hold(0.0, m.begin, true);
}

Status Mpc::feedback(double t, const VectorXd& q, const VectorXd& v) {
  Impl& m = *impl_;
  const Status status = m.answer(t, q, v);
  m.failures += status != Status::ok;
  return status;
}

Status Mpc::prepare() {
  Impl& m = *impl_;
  m.prepared = false;
  if (!m.planned) return Status::ok;
  m.shifted.noalias() = m.plan * m.grid.shift.transpose();
  m.plan.swap(m.shifted);
  if (const Status status = m.prediction.step(m.time, m.begin, m.u); status != Status::ok) return status;
  if (!m.options.delayed) m.carried = m.begin;
  return m.linearise(m.time + m.options.period);
}

const VectorXd& Mpc::u() const { return impl_->u; }
const VectorXd& Mpc::forces() const { return impl_->forces; }
const MatrixXd& Mpc::plan() const { return impl_->plan; }
const VectorXd& Mpc::block_times() const { return impl_->block_times; }
const MatrixXd& Mpc::predicted() const { return impl_->prediction.states; }
const VectorXd& Mpc::stage_times() const { return impl_->grid.times; }
int Mpc::qp_iterations() const { return impl_->qp.iterations; }
long Mpc::failures() const { return impl_->failures; }
const MpcOptions& Mpc::options() const { return impl_->options; }
const Arm& Mpc::arm() const { return impl_->arm; }

}  // namespace flexarm
