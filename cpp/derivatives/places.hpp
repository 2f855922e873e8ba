// A problem at the places of a tape: forces, and their slopes.
#pragma once

#include <algorithm>
#include <atomic>
#include <exception>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "arrays.hpp"
#include "closure.hpp"
#include "flexarm/check.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/derivatives.hpp"
#include "flexarm/run_derivatives.hpp"
#include "setup/single.hpp"
#include "system.hpp"

namespace flexarm {
namespace taped {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Rows = Trajectory::Rows;

/// Slopes by accelerations, rates and coordinates at a place.
struct Slopes {
  MatrixXd M, C, K;  ///< of the residual, needed - applied; of a rate that does not count, of its acceleration
  MatrixXd M_needed, C_needed, K_needed, C_applied, K_applied;
  // Of an arm with closed loops, whose residual is that of its accelerations on the loops; else empty.
  MatrixXd by_balance;      ///< of that residual, by [needed - applied; d^2 g/dt^2] (n, n + m)
  MatrixXd forces_balance;  ///< of the forces that are needed, by the same
  Closing closing;          ///< at the end of a step
};

/// Rigid rows of an arm's loops, and the equations that they add to those of a balance (Balance).
inline Index loop_rows(const Arm& arm) { return lanes::KernelArm::of(arm).layout().rigid_rows; }
inline Index loop_equations(Index rates, Index rows) { return rows > 0 ? 3 * rows + 2 * rates : 0; }

/// The problem at the places of a tape.
class Places {
 public:
  Places(const Problem& of, const Tape& tape)
      : n(of.arm->nv()),
        m(taped::loop_rows(*of.arm)),
        tape_(tape),
        tau_(of.tau),
        control_(of.control()),
        s_(of, control_),
        loads_(of.loads),
        rubs_(rubs(*of.arm)) {
    if (!rubs_.empty()) refuse_balls(*of.arm, "derivatives of a run with dry friction");
  }

  /// Forces at place e, where the workspace is, of inverse dynamics without feedback: see Balance.
  void balance(Index e, const VectorXd& inverse, Eigen::Ref<VectorXd> needed, Eigen::Ref<VectorXd> applied) {
    if (static_cast<Index>(tape_.sides.size()) != tape_.points() * limits())
      bad_value("torque_limit or limit", limits(), "has no derivative where the run has none");
    add_on_sides(s_.ws.feedback, s_.ws.limits, tape_.sides.data() + e * limits(), s_.q, s_.v, s_.tau);
    needed = inverse;
    applied = s_.tau;
    for (const Rub& r : rubs_) {
      const bool given = s_.ws.prescribed[static_cast<std::size_t>(r.rate)];
      const int is = way(e, r.rate);
      const double v = s_.v[r.rate], way = given ? (v > 0.0) - (v < 0.0) : is == Tape::held ? 0.0 : (is > 0) - (is < 0);
      needed[r.rate] += (std::abs(is) < Tape::held ? r.coulomb : r.stiction) * way;
    }
  }
  /// The balance at place e, with the equations of loops (Balance).
  void balance(Index e, VectorXd& needed, VectorXd& applied) {
    move(e);
    balance_here(e, needed.head(n), applied);
    if (m == 0) return;
    found_.resize(3, m);
    s_.ws.chain().loop_rows(found_.data(), nullptr);
    needed.segment(n, 3 * m) << found_.row(2).transpose(), found_.row(0).transpose(), found_.row(1).transpose();
    needed.tail(2 * n).setZero();
    if (const Tape::Closing* closing = tape_.closing_at(e)) needed.tail(2 * n) = moves_balance(*closing);
  }

  /// Forces of the loops' rigid rows at place e: those that balance it.
  Eigen::RowVectorXd find_loops(Index e) {
    VectorXd needed(n), applied(n);
    move(e);
    balance_here(e, needed, applied);
    return force_of(e, needed - applied).transpose();
  }
  /// And of the moves that closed them there.
  void find_closing(Tape::Closing& at) {
    if (at.moves[0].size() != n) at.moves[0] = inverse_rates(at.point) * at.moves[0];
    const VectorXd missing = moves_balance(at);
    rest(at.point);
    s_.ws.chain_to_move().move(s_.q.data(), s_.v.data());
    at.forces = {force_of(at.point, missing.head(n)), force_of(at.point, missing.tail(n))};
  }

  /// Sides of the limits at place e.
  void find_sides(Index e, signed char* out) {
    move(e);
    sides(s_.ws.feedback, s_.ws.limits, s_.q, s_.v, out);
  }
  /// How many they are.
  Index limits() const { return static_cast<Index>(s_.ws.feedback.size() + s_.ws.limits.size()); }

  /// @param whole  whether more than M, C and K are asked for
  void differentiate(Index e, bool whole, Slopes& out) {
    move(e);
    if (!made_) made_.emplace(s_.arm, flexarm::places(loads_));
    InverseDerivatives& slopes = *made_;
    for (std::size_t k = 0; k < s_.ws.loads.size(); ++k) slopes.set_wrench(k, s_.ws.loads[k].wrench);
    if (m > 0) slopes.recall(s_.ws);
    slopes(s_.arm, s_.q, s_.v, s_.a);
    out.K = slopes.dq;
    out.C = slopes.dv;
    add_feedback_slopes(s_.ws.feedback, s_.ws.limits, s_.q, s_.v, out.K, out.C);
    composite_mass_matrix(s_.arm, s_.ws, s_.q);
    out.M = s_.ws.M;
    if (balls()) out.K = by_turns(e, out.K);
    if (whole) {
      out.K_needed = by_turns(e, slopes.dq);
      out.C_needed = slopes.dv;
      out.K_applied = out.K_needed - out.K;
      out.C_applied = slopes.dv - out.C;
      out.M_needed = s_.ws.M;
    }
    for (Index i = 0; i < n; ++i)
      if (fixed(e, i)) {
        out.M.row(i).setZero();
        out.K.row(i).setZero();
        out.C.row(i).setZero();
        out.M(i, i) = 1.0;
      }
    if (m > 0) constrain(e, whole, out);
  }
  /// The part of changes of forces (nv rows) that motors at place e give: nothing at a limit.
  MatrixXd given_out(Index e, const MatrixXd& forces) const {
    MatrixXd out = forces;
    const std::vector<AppliedLimit>& all = s_.ws.limits;
    const signed char* side = tape_.sides.data() + (e + 1) * limits() - static_cast<Index>(all.size());
    for (const AppliedLimit& l : all)
      if (*side++) out.row(l.rate).setZero();
    return out;
  }
  /// Whether the equation of a rate does not count at a place: it is given, or held.
  bool fixed(Index e, Index i) const { return given(i) || std::abs(way(e, i)) >= Tape::held; }
  bool given(Index i) const { return s_.ws.prescribed[static_cast<std::size_t>(i)]; }

  /// Moves the workspace to place e.
  const System& move(Index e) {
    const auto at = [&](const std::vector<double>& x) { return Eigen::Map<const VectorXd>(x.data() + e * n, n); };
    s_.q = q(e);
    s_.v = at(tape_.v);
    s_.a = at(tape_.a);
    s_.constant_tau = tau_;
    if (const VectorXd* held = tape_.held_at(e)) s_.constant_tau += *held;
    if (!tape_.beside.empty()) s_.constant_tau += Eigen::Map<const VectorXd>(tape_.beside.data() + e * n, n);
    if (!tape_.loops.empty()) s_.ws.loop_forces.assign(tape_.loops.begin() + e * m, tape_.loops.begin() + (e + 1) * m);
    s_.drive(tape_.t[static_cast<std::size_t>(e)]);
    return s_;
  }

  /// Small changes of the coordinates at a place from those of a ball's turn, in the axes that turn (nv rows), and
  /// these from those of the coordinates.
  MatrixXd in_q(Index e, const MatrixXd& turns) const { return balls() ? rate_matrix(e) * turns : turns; }
  MatrixXd in_turns(Index e, const MatrixXd& x) const { return balls() ? inverse_rates(e) * x : x; }
  /// Derivatives by the coordinates (columns) to those by the turns, and back.
  MatrixXd by_turns(Index e, const MatrixXd& by_q) const { return balls() ? by_q * rate_matrix(e) : by_q; }
  MatrixXd by_coordinates(Index e, const MatrixXd& by_u) const { return balls() ? by_u * inverse_rates(e) : by_u; }

  const Index n, m;  ///< rates, and rigid rows of loops

 private:
  /// Where the state is.
  void balance_here(Index e, Eigen::Ref<VectorXd> needed, Eigen::Ref<VectorXd> applied) {
    s_.ws.chain_to_move().inverse(s_.q.data(), s_.v.data(), s_.a.data(), s_.ws.tau.data());
    balance(e, s_.ws.tau, needed, applied);
  }
  /// Moves the workspace to place e, at rest without accelerations and forces of loops.
  void rest(Index e) {
    move(e);
    s_.v.setZero();
    s_.a.setZero();
    std::fill(s_.ws.loop_forces.begin(), s_.ws.loop_forces.end(), 0.0);
  }
  /// From rest along the k-th move that closed a step, with the step's shift. @return by how much
  double shift(Index e, const Tape::Closing& by, int k) {
    constexpr double kPart = 1e-3;  // of accelerations of the motion: squares of rates are nothing then
    const VectorXd& w = by.moves[k];
    const double most = w.lpNorm<Eigen::Infinity>();
    if (most == 0.0) return 0.0;
    const Eigen::Map<const VectorXd> a(tape_.a.data() + e * n, n);
    const double scale = kPart * (1.0 + a.lpNorm<Eigen::Infinity>()) / most;
    s_.q += in_q(e, scale * by.by_q * w);
    s_.v += scale * by.by_v * w;
    s_.a += scale * w;
    for (Index r = 0; r < by.forces[k].size(); ++r)
      s_.ws.loop_forces[static_cast<std::size_t>(r)] += scale * by.forces[k][r];
    return scale;
  }
  /// (M + shift) w - G y of both moves.
  VectorXd moves_balance(const Tape::Closing& by) {
    VectorXd needed(n), applied(n), here(n), out(2 * n);
    rest(by.point);
    balance_here(by.point, needed, applied);
    here = needed - applied;
    for (int k = 0; k < 2; ++k) {
      rest(by.point);
      const double scale = shift(by.point, by, k);
      balance_here(by.point, needed, applied);
      VectorXd part = (needed - applied - here) * (scale > 0.0 ? 1.0 / scale : 0.0);
      clear_fixed(by.point, part);  // no move of theirs
      out.segment(k * n, n) = part;
    }
    return out;
  }
  /// Forces of the loops that are nearest to these, where the chain is.
  VectorXd force_of(Index e, VectorXd missing) {
    MatrixXd G(n, m);
    found_.resize(3, m);
    s_.ws.chain().loop_rows(found_.data(), G.data());
    clear_fixed(e, G);
    clear_fixed(e, missing);
    return G.completeOrthogonalDecomposition().solve(missing);
  }
  template <class M>
  void clear_fixed(Index e, M& x) const {
    for (Index i = 0; i < n; ++i)
      if (fixed(e, i)) x.row(i).setZero();
  }
  /// Slopes of the tree and of its loops become those of accelerations on the loops.
  void constrain(Index e, bool whole, Slopes& out) {
    OpenSlopes open;
    open.M = out.M;
    open.C = out.C;
    open.K = out.K;
    open.second_by_q = by_turns(e, made_->loops.leftCols(s_.arm.nq()));
    open.second_by_v = made_->loops.rightCols(n);
    (*made_)(s_.arm, s_.q, VectorXd::Zero(n), s_.v, false);  // at rest d^2 g/dt^2 is G^T a
    open.rate_by_q = by_turns(e, made_->loops.leftCols(s_.arm.nq()));
    open.G.resize(n, m);
    found_.resize(3, m);
    s_.ws.chain_to_move().move(s_.q.data(), s_.v.data());
    s_.ws.chain().loop_rows(found_.data(), open.G.data());
    open.G_free = open.G;
    clear_fixed(e, open.G_free);
    if (const Tape::Closing* at = tape_.closing_at(e)) {
      const auto slopes = [&](bool by_v) {
        made_->recall(s_.ws);
        (*made_)(s_.arm, s_.q, s_.v, s_.a, by_v);
      };
      rest(e);
      slopes(true);
      const MatrixXd here = made_->dq;
      MatrixXd K0 = here, C0 = made_->dv, by_q[2];
      add_feedback_slopes(s_.ws.feedback, s_.ws.limits, s_.q, s_.v, K0, C0);
      K0 = at->by_v * C0 + at->by_q * by_turns(e, K0);
      clear_fixed(e, K0);
      for (int k = 0; k < 2; ++k) {
        rest(e);
        const double scale = shift(e, *at, k);
        slopes(false);
        by_q[k] = by_turns(e, (made_->dq - here) * (scale > 0.0 ? 1.0 / scale : 0.0));
        clear_fixed(e, by_q[k]);
      }
      out.closing = Closing(open, open.M + K0, by_q[0], by_q[1]);
      move(e);
    }
    const Constrained changes(open);
    const MatrixXd C = below(open.C, open.second_by_v), K = below(open.K, open.second_by_q);
    out.by_balance = changes.accelerations;
    out.M.setIdentity();
    out.C.noalias() = out.by_balance * C;
    out.K.noalias() = out.by_balance * K;
    if (!whole) return;
    out.forces_balance.noalias() = open.G * changes.forces;
    out.C_needed += out.forces_balance * C;
    out.K_needed += out.forces_balance * K;
  }
  bool balls() const { return s_.arm.nq() != n; }
  Eigen::Map<const VectorXd> q(Index e) const { return {tape_.q.data() + e * s_.arm.nq(), s_.arm.nq()}; }
  MatrixXd rate_matrix(Index e) const {
    MatrixXd by_q(s_.arm.nq(), s_.arm.nq()), by_v(s_.arm.nq(), n);
    coordinate_rate_jacobians(s_.arm, q(e), s_.v, by_q, by_v);
    return by_v;
  }
  MatrixXd inverse_rates(Index e) const {
    const MatrixXd E = rate_matrix(e);  // whose columns are at right angles
    return E.colwise().squaredNorm().cwiseInverse().asDiagonal() * E.transpose();
  }
  int way(Index e, Index i) const { return tape_.way[static_cast<std::size_t>(e * n + i)]; }

  const Tape& tape_;
  const VectorXd tau_;
  Control control_;
  System s_;
  const std::vector<LoadDrive>& loads_;
  std::optional<InverseDerivatives> made_;  // when first asked for: a balance needs none
  std::vector<Rub> rubs_;
  Eigen::Matrix3Xd found_;
};

/// Of each place of a tape the one whose slopes are its own, too: itself or, of a row, the stage beside it that has the
/// same state. Their accelerations are equal but for the error of a step's iteration.
inline std::vector<Index> shared_places(const Tape& tape) {
  constexpr double kSameTime = 1e-12, kSame = 1e-5;  // of the time, of the largest acceleration
  const Index count = tape.points();
  std::vector<Index> out(static_cast<std::size_t>(count));
  for (Index e = 0; e < count; ++e) out[static_cast<std::size_t>(e)] = e;
  std::vector<bool> row(out.size(), false);
  for (const Tape::Row& r : tape.rows)
    if (r.point >= 0) row[static_cast<std::size_t>(r.point)] = !tape.closing_at(r.point);
  const auto same = [&](const auto& x, Index e, Index f) {
    const Index n = static_cast<Index>(x.size()) / count;
    return std::equal(x.begin() + e * n, x.begin() + (e + 1) * n, x.begin() + f * n);
  };
  const auto alike = [&](Index e, Index f) {
    if (f < 0 || f >= count || row[static_cast<std::size_t>(f)]) return false;
    const double t = tape.t[static_cast<std::size_t>(e)], other = tape.t[static_cast<std::size_t>(f)];
    if (std::abs(t - other) > kSameTime * std::max(1.0, std::abs(t)) || tape.held_at(e) != tape.held_at(f))
      return false;
    if (!same(tape.q, e, f) || !same(tape.v, e, f) || !same(tape.way, e, f) || !same(tape.sides, e, f)) return false;
    const Index n = static_cast<Index>(tape.a.size()) / count;
    const Eigen::Map<const VectorXd> a(tape.a.data() + e * n, n), b(tape.a.data() + f * n, n);
    return (a - b).lpNorm<Eigen::Infinity>() <= kSame * a.lpNorm<Eigen::Infinity>();
  };
  for (Index e = 0; e < count; ++e)
    if (row[static_cast<std::size_t>(e)])
      for (const Index f : {e - 1, e + 1})
        if (alike(e, f)) out[static_cast<std::size_t>(e)] = f;
  return out;
}

/// The place whose forces hold the held rates when a step begins: the one that the method was at before.
inline Index place_before(const Tape& tape, Index entry) {
  const Tape::Entry& last = tape.entries[static_cast<std::size_t>(entry - 1)];
  return last.point + (last.h == 0.0 ? 0 : tape.stages.count() - 1);
}

/// Slopes at the places of a tape, asked for one after another, either way: made by several threads, some ahead.
class Ahead {
 public:
  /// @param rows  whether the places of rows are asked for
  /// @param rough  whether slopes of a step's inner stages stand for those of the stages beside them
  Ahead(const Problem& of, const Tape& tape, bool rows, int threads, bool rough = false)
      : shared_(shared_places(tape)),
        asked_(static_cast<std::size_t>(tape.points()), 1),
        kept_(static_cast<std::size_t>(threads > 1              ? threads * std::max(kFewest, kRates / of.arm->nv())
                                       : loop_rows(*of.arm) > 0 ? tape.stages.count() + 1  // are asked for twice
                                                                : 1)) {
    for (const Tape::Row& row : tape.rows) {
      if (row.point < 0) continue;
      asked_[static_cast<std::size_t>(row.point)] = tape.closing_at(row.point) ? 1 : 0;
      if (rows) asked_[static_cast<std::size_t>(shared_[static_cast<std::size_t>(row.point)])] = 2;
    }
    for (std::size_t k = 0, leap = 0; !tape.leaps.empty() && k < tape.entries.size(); ++k)
      if (tape.entries[k].h == 0.0 && tape.leaps[leap++].tears != 0.0)
        asked_[static_cast<std::size_t>(tape.entries[k].point)] = 2;
    for (const Tape::Switch& s : tape.switches) asked_[static_cast<std::size_t>(place_before(tape, s.entry))] = 2;
    if (rough && loop_rows(*of.arm) == 0) share_stages(tape);
    for (int k = 0; k < threads; ++k) places_.push_back(std::make_unique<Places>(of, tape));
  }
  const Slopes& operator()(Index at) {
    const Index e = shared_[static_cast<std::size_t>(at)];
    const auto count = static_cast<Index>(kept_.size());
    if (e < first_ || e >= last_) {
      const bool back = e < first_;
      first_ = back ? std::max<Index>(0, e + 1 - count) : e;
      last_ = back ? e + 1 : std::min(e + count, static_cast<Index>(asked_.size()));
      make();
    }
    return kept_[static_cast<std::size_t>(e - first_)];
  }
  Places& places() { return *places_.front(); }

 private:
  static constexpr int kFewest = 16, kRates = 1024;  // places that a thread makes at a time, and their rates

  /// Of the stages of each step, the two in the middle stand for those before and behind them, which differ from them
  /// by as much, to either side; where friction and limits are the same.
  void share_stages(const Tape& tape) {
    const int s = tape.stages.count();
    const auto same = [&](const std::vector<signed char>& x, Index e, Index f) {
      const auto n = static_cast<Index>(x.size()) / tape.points();
      return std::equal(x.begin() + e * n, x.begin() + (e + 1) * n, x.begin() + f * n);
    };
    for (const Tape::Entry& entry : tape.entries)
      for (int i = 0; entry.h > 0.0 && entry.point >= 0 && i < s; ++i) {
        const Index e = entry.point + i, f = entry.point + (i < s / 2 ? (s - 1) / 2 : s / 2);
        if (e == f || asked_[static_cast<std::size_t>(e)] != 1 || !same(tape.way, e, f) || !same(tape.sides, e, f))
          continue;
        shared_[static_cast<std::size_t>(e)] = f;
        asked_[static_cast<std::size_t>(e)] = 0;
      }
  }
  void make() {
    std::exception_ptr wrong;
    std::mutex lock;
    std::atomic<Index> next{first_};
    const auto work = [&](Places& at) {
      try {
        for (Index e; (e = next++) < last_;)
          if (const char how = asked_[static_cast<std::size_t>(e)]; how > 0)
            at.differentiate(e, how > 1, kept_[static_cast<std::size_t>(e - first_)]);
      } catch (...) {
        const std::lock_guard<std::mutex> mine(lock);
        wrong = std::current_exception();
      }
    };
    std::vector<std::thread> others;
    for (std::size_t k = 1; k < places_.size(); ++k) others.emplace_back(work, std::ref(*places_[k]));
    work(*places_.front());
    for (std::thread& t : others) t.join();
    if (wrong) std::rethrow_exception(wrong);
  }

  std::vector<std::unique_ptr<Places>> places_;
  std::vector<Index> shared_;
  std::vector<char> asked_;
  std::vector<Slopes> kept_;
  Index first_ = std::numeric_limits<Index>::max(), last_ = first_;
};

}  // namespace taped
}  // namespace flexarm
