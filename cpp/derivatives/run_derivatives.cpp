#include "flexarm/run_derivatives.hpp"

#include <algorithm>

#include "flexarm/dry_friction.hpp"
#include "looks.hpp"
#include "step_equations.hpp"
#include "switches.hpp"
#include "tangents.hpp"

namespace flexarm {

using namespace taped;

namespace {

constexpr const char* kRuns = "the derivatives of a run";

/// Column p: of the parameter p, its derivative of needed - applied at place e, and zero where that does not count; of
/// d^2 g/dt^2 below it.
/// @param by_p  of the first columns
/// @param held  derivatives of the forces that are held (nv, np); empty: none are
MatrixXd balance_by(const std::vector<Balance>& by_p, const MatrixXd& held, Index e, const Places& at) {
  MatrixXd out = MatrixXd::Zero(at.n + at.m, std::max(held.cols(), static_cast<Index>(by_p.size())));
  for (std::size_t p = 0; p < by_p.size(); ++p) {
    auto column = out.col(static_cast<Index>(p));
    column = by_p[p].needed.row(e).head(at.n + at.m).transpose();
    column.head(at.n) -= by_p[p].applied.row(e).transpose();
  }
  if (held.size() > 0) out.topRows(at.n) -= at.given_out(e, held);
  for (Index i = 0; i < at.n; ++i)
    if (at.fixed(e, i)) out.row(i).setZero();
  return out;
}

/// The residual's, whose slopes are M, C and K.
void residual_by(const std::vector<Balance>& by_p, const MatrixXd& held, Index e, const Places& at,
                 const Slopes& slopes, MatrixXd& out) {
  out = balance_by(by_p, held, e, at);
  if (at.m > 0) out = slopes.by_balance * out;
}

/// Changes of the state that loops are closed to at place e by those of the equations there.
void follow(const Closing& closing, const std::vector<Balance>& by_p, Index e, const Places& at, MatrixXd& q,
            MatrixXd& v) {
  MatrixXd by = MatrixXd::Zero(2 * (at.m + at.n), q.cols());
  for (std::size_t p = 0; p < by_p.size(); ++p)
    by.col(static_cast<Index>(p)) = by_p[p].needed.row(e).tail(by.rows()).transpose();
  closing.follow(by, q, v);
}

/// First row of `tape.rows` of each entry, from that of the start (entry -1) on; and one behind.
std::vector<std::size_t> rows_of_entries(const Tape& tape) {
  std::vector<std::size_t> first(tape.entries.size() + 2, tape.rows.size());
  for (std::size_t r = tape.rows.size(); r-- > 0;) first[static_cast<std::size_t>(tape.rows[r].entry + 1)] = r;
  for (std::size_t k = first.size() - 1; k-- > 0;) first[k] = std::min(first[k], first[k + 1]);
  return first;
}

/// Tangents of the rows of a tape, a column each of those at its start, and of forces that are held from there.
/// @param by_p  of `balance_slopes`
/// @param switches_by_p, accelerations, threads  see `tangents`
/// @param nears  whose controllers go along
std::vector<Trajectory::Tangent> carry(const Problem& of, const Tape& tape, const ImplicitOptions& options,
                                       const std::vector<Balance>& by_p, const std::vector<Rows>& switches_by_p,
                                       Nears& nears, MatrixXd q, MatrixXd v, MatrixXd held, bool accelerations,
                                       int threads) {
  refuse_contact_friction(*of.arm, kRuns);
  Ahead slopes(of, tape, accelerations, threads);
  Places& places = slopes.places();
  Switches switches(of, tape, options);
  const Index n = places.n, m = places.m, np = q.cols();
  const Stages& method = tape.stages;
  const int s = method.count();
  StepEquations step(slopes, *of.arm, tape);
  const auto count = static_cast<Index>(tape.rows.size());
  const Rows rows(count, n), others(accelerations ? count : 0, n);
  std::vector<Trajectory::Tangent> out(static_cast<std::size_t>(np),
                                       {Rows(count, of.arm->nq()), rows, others, others, {}});
  MatrixXd a0 = MatrixXd::Zero(n, np), alpha0 = a0, a, by, stage_q, stage_v, shut_q, shut_v;
  q = places.in_turns(0, q);
  for (Index i = 0; i < n; ++i)
    if (places.given(i)) {
      q.row(i).setZero();  // the change of a motion by a parameter is in the balance
      v.row(i).setZero();
    }
  const auto accelerate = [&](Index e, const MatrixXd& x, const MatrixXd& y) -> MatrixXd {
    const Slopes& at = slopes(e);
    residual_by(by_p, held, e, places, at, by);
    by += at.K * x + at.C * y;
    return -Eigen::PartialPivLU<MatrixXd>(at.M).solve(by);
  };
  /// Of the force that holds a rate at a place.
  const auto holding = [&](Index e, Index i, const MatrixXd& z) -> Eigen::RowVectorXd {
    const Slopes& at = slopes(e);
    Eigen::RowVectorXd force =
        at.M_needed.row(i) * z + (at.C_needed - at.C_applied).row(i) * v + (at.K_needed - at.K_applied).row(i) * q;
    for (std::size_t p = 0; p < by_p.size(); ++p)
      force[static_cast<Index>(p)] += by_p[p].needed(e, i) - by_p[p].applied(e, i);
    if (held.size() > 0) force -= places.given_out(e, held).row(i);
    return force;
  };
  const auto write = [&](Index row, const MatrixXd& x, const MatrixXd& y) {
    const Index e = tape.rows[static_cast<std::size_t>(row)].point;
    const MatrixXd own = places.in_q(std::max<Index>(e, 0), x);
    MatrixXd z, f;
    if (accelerations) {
      z = accelerate(e, x, y);
      const Slopes& at = slopes(e);
      f = at.K_applied * x + at.C_applied * y;
      if (held.size() > 0) f += places.given_out(e, held);
      for (Index i = 0; i < n; ++i)
        if (places.given(i)) f.row(i) = at.K_needed.row(i) * x + at.C_needed.row(i) * y + at.M_needed.row(i) * z;
      if (m > 0) {
        by = at.forces_balance * balance_by(by_p, held, e, places);
        for (Index i = 0; i < n; ++i)
          if (places.given(i)) f.row(i) += by.row(i);
      }
    }
    for (Index p = 0; p < np; ++p) {
      const auto k = static_cast<std::size_t>(p);
      out[k].q.row(row) = own.col(p);
      out[k].v.row(row) = y.col(p);
      if (!accelerations) continue;
      out[k].a.row(row) = z.col(p);
      for (Index i = 0; i < n; ++i)
        out[k].tau(row, i) = f(i, p) + (places.given(i) ? by_p[k].needed(e, i) : by_p[k].applied(e, i));
    }
  };
  const std::vector<std::size_t> first = rows_of_entries(tape);
  std::size_t sampled = 0, leaps = 0;
  /// Samples behind entry k - 1 that come before a place.
  const auto sample = [&](std::size_t k, Index before) {
    for (; sampled < tape.samples.size() && tape.samples[sampled].entry < static_cast<Index>(k); ++sampled) {
      const Tape::Sample& now = tape.samples[sampled];
      if (now.point >= before) return;
      const MatrixXd z = accelerate(now.point, q, v);
      nears.sample(tape.t[static_cast<std::size_t>(now.point)], now.until, places.move(now.point),
                   places.in_q(now.point, q), v, z);
      held = nears.held();
    }
  };
  /// Rows at the end of entry k - 1, and the samples there.
  const auto finish = [&](std::size_t k, std::size_t from) {
    for (std::size_t r = from; r < first[k + 1]; ++r) {
      sample(k, tape.rows[r].point);
      write(static_cast<Index>(r), q, v);
    }
    sample(k, tape.points());
  };
  finish(0, first[0]);
  for (std::size_t k = 0; k < tape.entries.size(); ++k) {
    const Tape::Entry& entry = tape.entries[k];
    if (entry.h == 0.0) {
      if (method.remembers) {
        a0 = alpha0 = accelerate(entry.point, q, v);
      } else if (const Saltation& leap = tape.leaps[leaps++]; leap.tears == 0.0) {
        leap.leap(v.row(leap.of), v);
      } else {
        leap.leap(holding(entry.point, leap.of, accelerate(entry.point, q, v)), v);
      }
      finish(k + 1, first[k + 1]);
      continue;
    }
    const double h = entry.h;
    if (entry.lag != 1.0) alpha0 = a0 + entry.lag * (alpha0 - a0);
    if (entry.point < 0) {
      const auto index = static_cast<Index>(k);
      const Tape::Switch& from = switches.of(index);
      const auto number = &from - tape.switches.data();
      const auto count_rubs = static_cast<Index>(from.rates.size());
      MatrixXd state = MatrixXd::Zero(4 * n + count_rubs + held.rows(), np);
      state.topRows(4 * n) << q, v, a0, alpha0;
      state.bottomRows(held.rows()) = held;
      const Index e = place_before(tape, index);
      for (Index c = 0; c < count_rubs; ++c)
        if (from.sense[c] == 0.0) state.row(4 * n + c) = holding(e, from.rates[static_cast<std::size_t>(c)], a0);
      MatrixXd end = switches.slopes(from, held.size() > 0) * state;
      for (std::size_t p = 0; p < switches_by_p.size(); ++p)
        end.col(static_cast<Index>(p)) += switches_by_p[p].row(number).transpose();
      for (Index i = 0; i < n; ++i)
        if (places.given(i)) {
          end.row(i).setZero();
          end.row(n + i).setZero();
        }
      q = end.topRows(n);
      v = end.bottomRows(n);
      finish(k + 1, first[k + 1]);
      continue;
    }
    for (Index i = 0; !method.remembers && i < n; ++i)
      if (places.fixed(entry.point, i)) v.row(i).setZero();
    step.factor(static_cast<Index>(k), false);
    const Closing* closing = step.closing();
    shut_q.resize(n, np);
    if (closing) follow(*closing, by_p, step.closing_place(entry), places, shut_q, shut_v);
    a.resize(s * n, np);
    for (int i = 0; i <= s; ++i) {
      stage_q = q + h * method.c[i] * v;
      stage_v = v;
      if (method.remembers) {
        stage_q += h * h * (method.q_by_start(i, 0) * a0 + method.q_by_start(i, 1) * alpha0);
        stage_v += h * (method.v_by_start(i, 0) * a0 + method.v_by_start(i, 1) * alpha0);
      }
      for (const Turn& turn : step.turns.at(i)) turn.add_beginning(q, v, a0, alpha0, stage_q);
      if (i == s) break;
      residual_by(by_p, held, entry.point + i, places, slopes(entry.point + i), by);
      if (closing && method.remembers) by += step.closed_K() * shut_q + step.closed_C() * shut_v;
      a.middleRows(i * n, n) = -(by + step.K(i) * stage_q + step.C(i) * stage_v);
    }
    step.solve(a);
    std::size_t r = first[k + 1];
    for (; r < first[k + 2] && tape.rows[r].v_by_a.size() > 0; ++r) {  // within the step, of methods that start anew
      const Tape::Row& row = tape.rows[r];
      MatrixXd x = q + h * row.c * v, y = v;
      for (int j = 0; j < s; ++j) {
        x += h * h * row.q_by_a[j] * a.middleRows(j * n, n);
        y += h * row.v_by_a[j] * a.middleRows(j * n, n);
      }
      for (const Turn& turn : step.turns.at(row)) {
        turn.add_beginning(q, v, a0, alpha0, x);
        turn.add_stages(a, n, x);
      }
      if (m > 0) {
        const Closing& own = slopes(row.point).closing;
        MatrixXd more_q = x, more_v = y;
        own.close(x, y);
        follow(own, by_p, row.point, places, more_q, more_v);
        x += more_q;
        y += more_v;
      }
      write(static_cast<Index>(r), x, y);
    }
    q = stage_q;
    v = stage_v;
    for (int j = 0; j < s; ++j) {
      q += h * h * method.q_by_a(s, j) * a.middleRows(j * n, n);
      v += h * method.v_by_a(s, j) * a.middleRows(j * n, n);
    }
    for (const Turn& turn : step.turns.at(s)) turn.add_stages(a, n, q);
    if (closing) {
      closing->close(q, v);
      q += shut_q;
      v += shut_v;
    }
    if (method.remembers) {
      const MatrixXd last = a.bottomRows(n);
      alpha0 = method.auxiliary[0] * last + method.auxiliary[1] * a0 + method.auxiliary[2] * alpha0;
      a0 = last;
    }
    finish(k + 1, r);
  }
  return out;
}

}  // namespace

Repeated repeat_switches(const Problem& of, const Tape& tape, const ImplicitOptions& options) {
  Switches steps(of, tape, options);
  Repeated out{Rows(static_cast<Index>(tape.switches.size()), 2 * of.arm->nv()), {}};
  for (const Tape::Switch& from : tape.switches) {
    out.ends.row(static_cast<Index>(out.ways.size())) = steps.end(from);
    out.ways.push_back(steps.way());
  }
  return out;
}

Rows repeat_looks(const Problem& of, const Problem& run, const Tape& tape) {
  const std::vector<Look> looks = looks_of(run, tape);
  Laws laws(run, tape), own(of, tape);
  Rows out(static_cast<Index>(looks.size()), own.width());
  for (std::size_t k = 0; k < looks.size(); ++k) {
    const VectorXd from = laws.memory(looks[k]);
    laws.answer(looks[k], from);
    out.row(static_cast<Index>(k)) = own.answer(looks[k], from);
  }
  return out;
}

std::vector<Trajectory::Tangent> tangents(const Problem& of, const Tape& tape, const ImplicitOptions& options,
                                          const std::vector<Rows>& switches_by_p,
                                          const std::vector<Parameter>& parameters, bool accelerations, int threads) {
  Nears nears(parameters);
  const std::vector<Balance> by_p = balance_slopes(of, parameters, tape, threads);
  return carry(of, tape, options, by_p, switches_by_p, nears, nears.q0(), nears.v0(), {}, accelerations, threads);
}

void state_matrices(const Problem& of, const Tape& tape, const ImplicitOptions& options, MatrixXd& A, MatrixXd& B) {
  const Index n = of.arm->nv();
  MatrixXd q = MatrixXd::Zero(n, 3 * n), v = q, held = q;
  q.leftCols(n).setIdentity();
  v.middleCols(n, n).setIdentity();
  held.rightCols(n).setIdentity();
  Nears none({});
  const auto found = carry(of, tape, options, {}, {}, none, q, v, held, false, 1);
  A.resize(2 * n, 2 * n);
  B.resize(2 * n, n);
  for (Index p = 0; p < 3 * n; ++p) {
    const Trajectory::Tangent& end = found[static_cast<std::size_t>(p)];
    auto column = p < 2 * n ? A.col(p) : B.col(p - 2 * n);
    column << end.q.row(end.q.rows() - 1).transpose(), end.v.row(end.v.rows() - 1).transpose();
  }
}

Adjoint adjoint(const Problem& of, const Tape& tape, const ImplicitOptions& options, const Rows& by_q, const Rows& by_v,
                const Rows& by_a, const Rows& by_tau, int threads, bool rough) {
  refuse_contact_friction(*of.arm, kRuns);
  Ahead slopes(of, tape, by_a.rows() > 0 || by_tau.rows() > 0, threads, rough);
  const Places& places = slopes.places();
  Switches switches(of, tape, options);
  const Index n = places.n, m = places.m;
  const Stages& method = tape.stages;
  const int s = method.count();
  StepEquations step(slopes, *of.arm, tape);
  Adjoint out{VectorXd::Zero(n),
              VectorXd::Zero(n),
              Rows::Zero(tape.points(), n + loop_equations(n, m)),
              Rows::Zero(tape.points(), n),
              Rows::Zero(static_cast<Index>(tape.switches.size()), 2 * n),
              Rows::Zero(static_cast<Index>(tape.switches.size()), n),
              {}};
  LooksBack looks(of, tape);
  // derivatives of the number by the state at the end of the next entry, going back
  VectorXd q = out.q0, v = q, a0 = q, alpha0 = q, x, y, mu, shut_q, shut_v;
  MatrixXd stage;
  Eigen::PartialPivLU<MatrixXd> mass;
  /// Of derivatives by the residual at a place.
  const auto count = [&](Index e, const VectorXd& by) {
    const VectorXd balance = m > 0 ? VectorXd(slopes(e).by_balance.transpose() * by) : by;
    for (Index i = 0; i < n; ++i) {
      if (places.fixed(e, i)) continue;
      out.needed(e, i) += balance[i];
      out.applied(e, i) -= balance[i];
    }
    out.needed.row(e).segment(n, m) += balance.tail(m).transpose();
  };
  /// From derivatives by the accelerations at a place, adds those by q and v there.
  const auto accelerate = [&](Index e, const VectorXd& by, VectorXd& to_q, VectorXd& to_v) {
    const Slopes& at = slopes(e);
    mass.compute(at.M);
    mu = mass.transpose().solve(by);
    mu = -mu;
    for (Index i = 0; i < n; ++i)
      if (places.fixed(e, i)) mu[i] = 0.0;
    to_q += at.K.transpose() * mu;
    to_v += at.C.transpose() * mu;
    count(e, mu);
  };
  /// From derivatives by a row of results, adds those by the state there.
  const auto read = [&](std::size_t row, VectorXd& to_q, VectorXd& to_v) {
    const auto r = static_cast<Index>(row);
    to_q += places.by_turns(std::max<Index>(tape.rows[row].point, 0), by_q.row(r)).transpose();
    to_v += by_v.row(r).transpose();
    if (by_a.rows() == 0 && by_tau.rows() == 0) return;
    const Index e = tape.rows[row].point;
    const Slopes& at = slopes(e);
    VectorXd by = by_a.rows() > 0 ? VectorXd(by_a.row(r)) : VectorXd::Zero(n);
    for (Index i = 0; by_tau.rows() > 0 && i < n; ++i) {
      const double f = by_tau(r, i);
      if (f == 0.0) continue;
      if (places.given(i)) {
        to_q += f * at.K_needed.row(i).transpose();
        to_v += f * at.C_needed.row(i).transpose();
        by += f * at.M_needed.row(i).transpose();
      } else {
        to_q += f * at.K_applied.row(i).transpose();
        to_v += f * at.C_applied.row(i).transpose();
      }
      (places.given(i) ? out.needed : out.applied)(e, i) += f;
      if (m == 0 || !places.given(i)) continue;
      for (Index j = 0; j < n; ++j) {
        if (places.fixed(e, j)) continue;
        out.needed(e, j) += f * at.forces_balance(i, j);
        out.applied(e, j) -= f * at.forces_balance(i, j);
      }
      out.needed.row(e).segment(n, m) += f * at.forces_balance.row(i).tail(m);
    }
    accelerate(e, by, to_q, to_v);
  };
  /// From the derivative by the force that holds a rate at a place, those by the state; returns that by accelerations.
  const auto hold = [&](Index e, Index i, double force) -> VectorXd {
    const Slopes& at = slopes(e);
    v += force * (at.C_needed - at.C_applied).row(i).transpose();
    q += force * (at.K_needed - at.K_applied).row(i).transpose();
    out.needed(e, i) += force;
    out.applied(e, i) -= force;
    return force * at.M_needed.row(i).transpose();
  };
  std::vector<std::pair<VectorXd, VectorXd>> inside;  // derivatives by the state at rows within a step, the last first
  const std::vector<std::size_t> first = rows_of_entries(tape);
  /// Samples behind entry k - 1, or later ones, that come behind a place.
  const auto sample = [&](std::size_t k, Index behind) {
    for (Index e; (e = looks.next(static_cast<Index>(k) - 1, behind)) >= 0;) {
      const VectorXd by = looks.back(out.applied, out.held, places);
      q += by.head(n);
      v += by.segment(n, n);
      accelerate(e, by.tail(n), q, v);
    }
  };
  /// Rows at the end of entry k - 1, and the samples there. @return the first of these rows
  const auto finish = [&](std::size_t k) {
    std::size_t last = first[k + 1];
    for (; last > first[k] && tape.rows[last - 1].v_by_a.size() == 0; --last) {
      sample(k, tape.rows[last - 1].point);
      read(last - 1, q, v);
    }
    sample(k, -1);
    return last;
  };
  const auto counts = [](const Rows& by, std::size_t row) {
    return by.rows() > 0 && !by.row(static_cast<Index>(row)).isZero(0.0);
  };
  std::size_t behind = tape.rows.size();  // no row from here on counts
  while (behind > 0 && !counts(by_q, behind - 1) && !counts(by_v, behind - 1) && !counts(by_a, behind - 1) &&
         !counts(by_tau, behind - 1))
    --behind;
  for (std::size_t k = tape.entries.size(), leaps = tape.leaps.size(); k-- > 0;) {
    const Tape::Entry& entry = tape.entries[k];
    std::size_t last = finish(k + 1);
    if (first[k + 1] >= behind) {  // nor does the state
      if (entry.h == 0.0 && !method.remembers) --leaps;
      continue;
    }
    if (entry.h == 0.0 && !method.remembers) {
      const Saltation& leap = tape.leaps[--leaps];
      const double by_gap = leap.back(v);
      if (leap.tears == 0.0)
        v[leap.of] += by_gap;
      else
        accelerate(entry.point, hold(entry.point, leap.of, by_gap), q, v);
      continue;
    }
    if (entry.h == 0.0) {
      a0 += alpha0;
      accelerate(entry.point, a0, q, v);
      a0.setZero();
      alpha0.setZero();
      continue;
    }
    const double h = entry.h;
    const auto delay = [&] {
      if (entry.lag == 1.0) return;
      a0 += (1.0 - entry.lag) * alpha0;
      alpha0 *= entry.lag;
    };
    if (entry.point < 0) {
      const auto index = static_cast<Index>(k);
      const Tape::Switch& from = switches.of(index);
      VectorXd end(2 * n);
      end << q, v;
      for (Index i = 0; i < n; ++i)
        if (places.given(i)) end[i] = end[n + i] = 0.0;
      out.switches.row(&from - tape.switches.data()) = end;
      const VectorXd state = switches.slopes(from, true).transpose() * end;
      out.held.row(&from - tape.switches.data()) = state.tail(n);
      q = state.segment(0, n);
      v = state.segment(n, n);
      a0 = state.segment(2 * n, n);
      alpha0 = state.segment(3 * n, n);
      const Index e = place_before(tape, index);
      x.setZero(n);
      for (std::size_t c = 0; c < from.rates.size(); ++c)
        if (const auto row = static_cast<Index>(c); from.sense[row] == 0.0)
          x += hold(e, from.rates[c], state[4 * n + row]);
      delay();
      a0 += x;
      continue;
    }
    inside.clear();
    for (; last > first[k + 1]; --last) {  // rows within
      x.setZero(n);
      y.setZero(n);
      read(last - 1, x, y);
      if (const Index e = tape.rows[last - 1].point; m > 0) {
        const Closing& own = slopes(e).closing;
        out.needed.row(e).tail(2 * (m + n)) += own.follow_back(x, y).transpose();
        own.close_back(x, y);
      }
      inside.emplace_back(x, y);
    }
    step.factor(static_cast<Index>(k), true);
    const Closing* closing = step.closing();
    if (closing) {
      shut_q = q;
      shut_v = v;
      closing->close_back(q, v);
    }
    const VectorXd end = q;
    stage.resize(s * n, 1);
    for (int j = 0; j < s; ++j)
      stage.middleRows(j * n, n) = h * h * method.q_by_a(s, j) * q + h * method.v_by_a(s, j) * v;
    if (method.remembers) {
      stage.bottomRows(n) += a0 + method.auxiliary[0] * alpha0;
      a0 = method.auxiliary[1] * alpha0 + h * h * method.q_by_start(s, 0) * q + h * method.v_by_start(s, 0) * v;
      alpha0 = method.auxiliary[2] * alpha0 + h * h * method.q_by_start(s, 1) * q + h * method.v_by_start(s, 1) * v;
    }
    v += h * q;
    const auto turn_back = [&](const std::vector<Turn>& turns, const VectorXd& by) {
      for (const Turn& turn : turns) turn.give_beginning(by, q, v, a0, alpha0);
    };
    turn_back(step.turns.at(s), end);
    for (const Turn& turn : step.turns.at(s)) turn.give_stages(end, n, stage);
    for (std::size_t r = 0; r < inside.size(); ++r) {
      const Tape::Row& row = tape.rows[last + inside.size() - 1 - r];
      const auto& [by_x, by_y] = inside[r];
      q += by_x;
      v += by_y + h * row.c * by_x;
      for (int j = 0; j < s; ++j) stage.middleRows(j * n, n) += h * h * row.q_by_a[j] * by_x + h * row.v_by_a[j] * by_y;
      const std::vector<Turn> turns = step.turns.at(row);
      turn_back(turns, by_x);
      for (const Turn& turn : turns) turn.give_stages(by_x, n, stage);
    }
    step.solve_transposed(stage);
    for (int i = 0; i < s; ++i) {
      mu = -stage.middleRows(i * n, n);
      for (Index j = 0; j < n; ++j)
        if (places.fixed(entry.point + i, j)) mu[j] = 0.0;
      count(entry.point + i, mu);
      if (closing && method.remembers) {
        shut_q += step.closed_K().transpose() * mu;
        shut_v += step.closed_C().transpose() * mu;
      }
      x.noalias() = step.K(i).transpose() * mu;
      y.noalias() = step.C(i).transpose() * mu;
      q += x;
      v += y + h * method.c[i] * x;
      turn_back(step.turns.at(i), x);
      if (!method.remembers) continue;
      a0 += h * h * method.q_by_start(i, 0) * x + h * method.v_by_start(i, 0) * y;
      alpha0 += h * h * method.q_by_start(i, 1) * x + h * method.v_by_start(i, 1) * y;
    }
    if (closing)
      out.needed.row(step.closing_place(entry)).tail(2 * (m + n)) += closing->follow_back(shut_q, shut_v).transpose();
    for (Index i = 0; !method.remembers && i < n; ++i)
      if (places.fixed(entry.point, i)) v[i] = 0.0;
    delay();
  }
  finish(0);
  out.looks = looks.by_answer;
  for (Index i = 0; i < n; ++i)
    if (places.given(i)) q[i] = v[i] = 0.0;
  out.q0 = places.by_coordinates(0, q.transpose()).transpose();
  out.v0 = v;
  return out;
}

}  // namespace flexarm
