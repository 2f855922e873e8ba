#include "flexarm/run_derivatives.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "arrays.hpp"
#include "flexarm/check.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/derivatives.hpp"
#include "flexarm/dry_friction.hpp"
#include "lanes/single.hpp"
#include "system.hpp"

namespace flexarm {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Rows = Trajectory::Rows;

namespace {

/// Slopes by accelerations, rates and coordinates at a place.
struct Slopes {
  MatrixXd M, C, K;  ///< of the residual, needed - applied; of what does not count the acceleration itself
  MatrixXd M_needed, C_needed, K_needed, C_applied, K_applied;
};

/// The problem at the places of a tape.
class Places {
 public:
  Places(const Driven& of, const Tape& tape)
      : n(of.arm.nv()),
        tape_(tape),
        s_(of.arm, of.drives, of.loads, of.tau, of.control),
        loads_(of.loads),
        rubs_(rubs(of.arm)) {
    for (std::size_t k = 0; k < of.arm.size(); ++k)
      if (of.arm.link(k).joint().has_ball())
        bad_value("link[" + std::to_string(k) + "].joint", "a ball", "derivatives of a run know no quaternions");
  }

  /// Forces at place e: see Balance. Moves the workspace there.
  void balance(Index e, Eigen::Ref<VectorXd> needed, Eigen::Ref<VectorXd> applied) {
    move(e);
    inverse_dynamics(s_.arm, s_.ws, s_.q, s_.v, s_.a);
    inverse_ = s_.ws.tau;
    add_feedback(s_.ws.feedback, s_.q, s_.v, 1.0, inverse_);  // which the workspace has taken off
    balance(e, inverse_, needed, applied);
  }
  /// The same where the workspace is, of inverse dynamics without feedback.
  void balance(Index e, const VectorXd& inverse, Eigen::Ref<VectorXd> needed, Eigen::Ref<VectorXd> applied) {
    add_feedback(s_.ws.feedback, s_.q, s_.v, 1.0, s_.tau);
    needed = inverse;
    applied = s_.tau;
    for (const Rub& r : rubs_) {
      const bool given = s_.ws.prescribed[static_cast<std::size_t>(r.rate)];
      const int is = contact(e, r.rate);
      const double v = s_.v[r.rate], way = given ? (v > 0.0) - (v < 0.0) : is == Tape::held ? 0.0 : is;
      needed[r.rate] += r.coulomb * way;
    }
  }

  /// @param whole  whether more than M, C and K are asked for
  void differentiate(Index e, bool whole, Slopes& out) {
    move(e);
    if (!made_) made_.emplace(s_.arm, flexarm::places(loads_));
    InverseDerivatives& slopes = *made_;
    for (std::size_t k = 0; k < s_.ws.loads.size(); ++k) slopes.set_wrench(k, s_.ws.loads[k].wrench);
    slopes(s_.arm, s_.q, s_.v, s_.a);
    out.K = slopes.dq;
    out.C = slopes.dv;
    add_feedback_slopes(s_.ws.feedback, s_.q, s_.v, out.K, out.C);
    composite_mass_matrix(s_.arm, s_.ws, s_.q);
    out.M = s_.ws.M;
    if (whole) {
      out.K_needed = slopes.dq;
      out.C_needed = slopes.dv;
      out.K_applied = slopes.dq - out.K;
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
  }
  /// Whether the equation of a rate does not count at a place: it is given, or held.
  bool fixed(Index e, Index i) const { return given(i) || contact(e, i) == Tape::held; }
  bool given(Index i) const { return s_.ws.prescribed[static_cast<std::size_t>(i)]; }

  /// Moves the workspace to place e.
  const System& move(Index e) {
    const auto at = [&](const std::vector<double>& x) { return Eigen::Map<const VectorXd>(x.data() + e * n, n); };
    s_.q = at(tape_.q);
    s_.v = at(tape_.v);
    s_.a = at(tape_.a);
    s_.drive(tape_.t[static_cast<std::size_t>(e)]);
    return s_;
  }

  const Index n;

 private:
  int contact(Index e, Index i) const { return tape_.contact[static_cast<std::size_t>(e * n + i)]; }

  const Tape& tape_;
  System s_;
  const std::vector<LoadDrive>& loads_;
  VectorXd inverse_;
  std::optional<InverseDerivatives> made_;  // when first asked for: what is only balanced needs none
  std::vector<Rub> rubs_;
};

/// Problems of one structure at the places of a tape, their inverse dynamics side by side in the lanes of a pack.
class SideBySide {
 public:
  /// As many of those from `first` on as are alike and fit.
  SideBySide(const std::vector<Driven>& all, std::size_t first, const Tape& tape) : kernels_(lanes::best_kernels()) {
    std::vector<std::unique_ptr<lanes::KernelArm>> arms;
    std::vector<const lanes::KernelArm*> them;
    for (std::size_t k = first; k < all.size() && k < first + static_cast<std::size_t>(kernels_.width); ++k) {
      const Arm& arm = all[k].arm;
      arms.push_back(std::make_unique<lanes::KernelArm>(lanes::KernelArm::of(arm).loaded(arm, places(all[k].loads))));
      if (!arms.back()->like(*arms.front())) break;
      them.push_back(arms.back().get());
      at_.push_back(std::make_unique<Places>(all[k], tape));
    }
    n_ = at_.front()->n;
    loads_ = static_cast<Index>(all[first].loads.size());
    if (at_.size() == 1) return;
    packed_ = std::make_unique<lanes::KernelArm>(
        lanes::KernelArm::side_by_side(them, kernels_.width, std::vector<bool>(static_cast<std::size_t>(n_), false)));
    memory_ = lanes::Memory(kernels_.side_memory(packed_->layout()));
    numbers_ = lanes::Memory(static_cast<std::size_t>((4 * n_ + 6 * loads_) * kernels_.width) * sizeof(double));
    tau_.resize(n_);
  }
  std::size_t size() const { return at_.size(); }
  /// take(k, needed, applied) of each problem; see Balance.
  template <class Take>
  void operator()(Index e, VectorXd& needed, VectorXd& applied, const Take& take) {
    if (at_.size() == 1) {
      at_.front()->balance(e, needed, applied);
      take(0, needed, applied);
      return;
    }
    const Index w = kernels_.width;
    double *q = static_cast<double*>(numbers_.get()), *v = q + n_ * w, *a = v + n_ * w, *tau = a + n_ * w,
           *wrenches = tau + n_ * w;
    for (Index l = 0; l < w; ++l) {  // lanes beyond the last repeat it
      const System& s = at_[std::min(static_cast<std::size_t>(l), at_.size() - 1)]->move(e);
      for (Index i = 0; i < n_; ++i) {
        q[i * w + l] = s.q[i];
        v[i * w + l] = s.v[i];
        a[i * w + l] = s.a[i];
      }
      for (Index i = 0; i < 6 * loads_; ++i)
        wrenches[i * w + l] = s.ws.loads[static_cast<std::size_t>(i / 6)].wrench[i % 6];
    }
    kernels_.inverse_side_by_side(packed_->layout(), packed_->numbers().data(), memory_.get(), wrenches, q, v, a, tau);
    for (std::size_t k = 0; k < at_.size(); ++k) {
      for (Index i = 0; i < n_; ++i) tau_[i] = tau[i * w + static_cast<Index>(k)];
      at_[k]->balance(e, tau_, needed, applied);
      take(k, needed, applied);
    }
  }

 private:
  const lanes::Kernels& kernels_;
  std::vector<std::unique_ptr<Places>> at_;
  std::unique_ptr<lanes::KernelArm> packed_;
  lanes::Memory memory_, numbers_;
  Index n_ = 0, loads_ = 0;
  VectorXd tau_;
};

/// The place whose forces hold what is held when a step begins: the one that the method was at before.
Index place_before(const Tape& tape, Index entry) {
  const Tape::Entry& last = tape.entries[static_cast<std::size_t>(entry - 1)];
  return last.point + (last.h == 0.0 ? 0 : tape.stages.count() - 1);
}

/// Slopes at the places of a tape, asked for one after another, either way: made by several threads, some ahead.
class Ahead {
 public:
  /// @param rows  whether the places of rows are asked for
  Ahead(const Driven& of, const Tape& tape, bool rows, int threads)
      : asked_(static_cast<std::size_t>(tape.points()), 1),
        kept_(static_cast<std::size_t>(threads > 1 ? threads * std::max(kFewest, kRates / of.arm.nv()) : 1)) {
    for (const Tape::Row& row : tape.rows)
      if (row.point >= 0) asked_[static_cast<std::size_t>(row.point)] = rows ? 2 : 0;
    for (const Tape::Switch& s : tape.switches) asked_[static_cast<std::size_t>(place_before(tape, s.entry))] = 2;
    for (int k = 0; k < threads; ++k) places_.push_back(std::make_unique<Places>(of, tape));
  }
  const Slopes& operator()(Index e) {
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
  static constexpr int kFewest = 16, kRates = 4096;  // places that a thread makes at a time, and their rates

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
  std::vector<char> asked_;
  std::vector<Slopes> kept_;
  Index first_ = std::numeric_limits<Index>::max(), last_ = first_;
};

/// The equations of a step, in changes: of its stages, N da = rhs.
class StepEquations {
 public:
  StepEquations(Ahead& slopes, const Stages& of)
      : ahead_(slopes), n_(slopes.places().n), of_(of), s_(of.count()), slopes_(of.count()) {}

  /// @param back  whether the places are asked for backwards
  void factor(const Tape::Entry& entry, bool back) {
    const Index n = n_;
    for (int i = 0; i < s_; ++i) {
      const Slopes& at = ahead_(back ? entry.point + s_ - 1 - i : entry.point + i);
      Stage& stage = slopes_[back ? s_ - 1 - i : i];
      stage.M = at.M;
      stage.C = at.C;
      stage.K = at.K;
    }
    h_ = entry.h;
    if (of_.in_turn) {
      for (int i = 0; i < s_; ++i) slopes_[i].lu.compute(slopes_[i].M);
      return;
    }
    newton_.resize(s_ * n, s_ * n);
    for (int i = 0; i < s_; ++i)
      for (int j = 0; j < s_; ++j) newton_.block(i * n, j * n, n, n) = coupling(i, j);
    lu_.compute(newton_);
  }
  /// N x = rhs in place.
  void solve(MatrixXd& x) const {
    if (!of_.in_turn) {
      x = lu_.solve(x);
      return;
    }
    for (int i = 0; i < s_; ++i) {
      for (int j = 0; j < i; ++j)
        if (of_.v_by_a(i, j) != 0.0 || of_.q_by_a(i, j) != 0.0) rows(x, i) -= coupling(i, j) * rows(x, j);
      rows(x, i) = slopes_[i].lu.solve(MatrixXd(rows(x, i)));
    }
  }
  /// N^T x = rhs in place.
  void solve_transposed(MatrixXd& x) const {
    if (!of_.in_turn) {
      x = lu_.transpose().solve(x);
      return;
    }
    for (int i = s_; i-- > 0;) {
      rows(x, i) = slopes_[i].lu.transpose().solve(MatrixXd(rows(x, i)));
      for (int j = 0; j < i; ++j)
        if (of_.v_by_a(i, j) != 0.0 || of_.q_by_a(i, j) != 0.0) rows(x, j) -= coupling(i, j).transpose() * rows(x, i);
    }
  }
  const MatrixXd& C(int i) const { return slopes_[i].C; }
  const MatrixXd& K(int i) const { return slopes_[i].K; }

 private:
  struct Stage {
    MatrixXd M, C, K;
    Eigen::PartialPivLU<MatrixXd> lu = {};
  };
  Eigen::Block<MatrixXd> rows(MatrixXd& x, int i) const { return x.block(i * n_, 0, n_, x.cols()); }
  /// Of the residual at stage i, by the accelerations of stage j.
  MatrixXd coupling(int i, int j) const {
    MatrixXd out = h_ * of_.v_by_a(i, j) * slopes_[i].C + h_ * h_ * of_.q_by_a(i, j) * slopes_[i].K;
    if (i == j) out += slopes_[i].M;
    return out;
  }

  Ahead& ahead_;
  Index n_;
  const Stages& of_;
  int s_;
  double h_ = 0.0;
  std::vector<Stage> slopes_;
  MatrixXd newton_;
  Eigen::PartialPivLU<MatrixXd> lu_;
};

/// Steps in which dry friction switches, taken again.
class Switches {
 public:
  Switches(const Driven& of, const Tape& tape, ImplicitOptions options)
      : tau_(of.tau),
        own_(of.tau),
        s_(of.arm, of.drives, of.loads, tau_, of.control),
        tape_(tape),
        n_(of.arm.nv()),
        rubs_(rubs(of.arm)) {
    if (tape.switches.empty()) return;
    options.rtol = std::min(options.rtol, kSolved);
    step_.emplace("implicit", of.arm, 1.0, options);
  }
  /// The state that a step leads to; forces of friction that slides are this arm's.
  VectorXd end(Tape::Switch from) {
    for (std::size_t c = 0; c < from.rates.size(); ++c)
      for (const Rub& r : rubs_)
        if (const auto k = static_cast<Index>(c); r.rate == from.rates[c] && from.sense[k] != 0.0)
          from.before[k] = -from.sense[k] * r.coulomb;
    s_.q = from.q;
    s_.v = from.v;
    tau_ = own_;
    if (from.tau.size() > 0) tau_ += from.tau;
    s_.drive(from.t);
    const Step::Given given = [&](double c) { s_.drive(from.t + c * from.h); };
    step_->repeat(from, s_.ws, s_.q, s_.v, s_.tau, given);
    VectorXd out(2 * n_);
    out << s_.q, s_.v;
    return out;
  }
  /// Derivatives of that end by q, v, a0 and alpha0 (nv columns each), by the forces before, of what rubs, and, if
  /// `held`, by forces held over the step (nv columns).
  MatrixXd slopes(const Tape::Switch& from, bool held) {
    const auto count = static_cast<Index>(from.rates.size());
    Tape::Switch at = from;
    if (at.tau.size() == 0) at.tau = VectorXd::Zero(n_);
    MatrixXd out(2 * n_, 4 * n_ + count + (held ? n_ : 0));
    const double sizes[] = {kMoved, kMoved, kMoved / from.h, kMoved / from.h};
    for (Index k = 0; k < out.cols(); ++k) {
      const auto which = [&](Tape::Switch& of) -> double& {
        if (k >= 4 * n_ + count) return of.tau[k - 4 * n_ - count];
        if (k >= 4 * n_) return of.before[k - 4 * n_];
        VectorXd* parts[] = {&of.q, &of.v, &of.a0, &of.alpha0};
        return (*parts[k / n_])[k % n_];
      };
      const double by = k >= 4 * n_ ? kMoved * (1.0 + std::abs(which(at))) : sizes[k / n_];
      Tape::Switch less = at, more = at;
      which(less) -= by;
      which(more) += by;
      out.col(k) = (end(more) - end(less)) / (2.0 * by);
    }
    return out;
  }
  /// The switch of an entry; entries are asked for one after another, either way.
  const Tape::Switch& of(Index entry) const {
    return *std::lower_bound(tape_.switches.begin(), tape_.switches.end(), entry,
                             [](const Tape::Switch& s, Index k) { return s.entry < k; });
  }

 private:
  static constexpr double kSolved = 1e-13, kMoved = 1e-7;
  VectorXd tau_;  // of the step
  const VectorXd& own_;
  System s_;
  const Tape& tape_;
  Index n_;
  std::vector<Rub> rubs_;
  std::optional<OneStep> step_;
};

/// Column p: of the parameter p, its derivative of needed - applied at place e, and zero where that does not count.
void residual_by(const std::vector<Balance>& by_p, Index e, const Places& at, MatrixXd& out) {
  out.resize(at.n, static_cast<Index>(by_p.size()));
  for (std::size_t p = 0; p < by_p.size(); ++p)
    out.col(static_cast<Index>(p)) = (by_p[p].needed.row(e) - by_p[p].applied.row(e)).transpose();
  for (Index i = 0; i < at.n; ++i)
    if (at.fixed(e, i)) out.row(i).setZero();
}

/// First row of `tape.rows` of each entry, from that of the start (entry -1) on; and one behind.
std::vector<std::size_t> rows_of_entries(const Tape& tape) {
  std::vector<std::size_t> first(tape.entries.size() + 2, tape.rows.size());
  for (std::size_t r = tape.rows.size(); r-- > 0;) first[static_cast<std::size_t>(tape.rows[r].entry + 1)] = r;
  for (std::size_t k = first.size() - 1; k-- > 0;) first[k] = std::min(first[k], first[k + 1]);
  return first;
}

}  // namespace

Balance balance(const Driven& of, const Tape& tape) {
  Places at(of, tape);
  Balance out{Rows(tape.points(), at.n), Rows(tape.points(), at.n)};
  VectorXd needed(at.n), applied(at.n);
  for (Index e = 0; e < tape.points(); ++e) {
    at.balance(e, needed, applied);
    out.needed.row(e) = needed;
    out.applied.row(e) = applied;
  }
  return out;
}

VectorXd weigh(const std::vector<Driven>& problems, const Tape& tape, const Rows& needed, const Rows& applied,
               int threads) {
  VectorXd out = VectorXd::Zero(static_cast<Index>(problems.size()));
  std::exception_ptr wrong;
  std::mutex lock;
  std::size_t next = 0;
  const auto group = [&]() -> std::pair<std::size_t, std::unique_ptr<SideBySide>> {
    const std::lock_guard<std::mutex> mine(lock);
    const std::size_t first = next;
    if (first == problems.size()) return {first, nullptr};
    auto found = std::make_unique<SideBySide>(problems, first, tape);
    next += found->size();
    return {first, std::move(found)};
  };
  const auto work = [&] {
    try {
      for (;;) {
        const auto [first, side] = group();
        if (!side) return;
        const auto from = static_cast<Index>(first);
        VectorXd need(needed.cols()), apply(needed.cols());
        for (Index e = 0; e < tape.points(); ++e) {
          if (needed.row(e).isZero(0.0) && applied.row(e).isZero(0.0)) continue;  // of a row that is not asked for
          (*side)(e, need, apply, [&, at = from](std::size_t k, const VectorXd& x, const VectorXd& y) {
            out[at + static_cast<Index>(k)] += needed.row(e).dot(x) + applied.row(e).dot(y);
          });
        }
      }
    } catch (...) {
      const std::lock_guard<std::mutex> mine(lock);
      wrong = std::current_exception();
      next = problems.size();
    }
  };
  const std::size_t groups = problems.size() / static_cast<std::size_t>(lanes::best_kernels().width) + 1;
  std::vector<std::thread> others;
  for (std::size_t k = 1; k < std::min(static_cast<std::size_t>(threads), groups); ++k) others.emplace_back(work);
  work();
  for (std::thread& t : others) t.join();
  if (wrong) std::rethrow_exception(wrong);
  return out;
}

Rows repeat_switches(const Driven& of, const Tape& tape, const ImplicitOptions& options) {
  Switches steps(of, tape, options);
  Rows out(static_cast<Index>(tape.switches.size()), 2 * of.arm.nv());
  Index k = 0;
  for (const Tape::Switch& from : tape.switches) out.row(k++) = steps.end(from);
  return out;
}

std::vector<Trajectory::Tangent> tangents(const Driven& of, const Tape& tape, const ImplicitOptions& options,
                                          const std::vector<Balance>& by_p, const std::vector<Rows>& switches_by_p,
                                          const Rows& q0, const Rows& v0, bool accelerations, int threads) {
  Ahead slopes(of, tape, accelerations, threads);
  const Places& places = slopes.places();
  Switches switches(of, tape, options);
  const Index n = places.n, np = q0.rows();
  const Stages& method = tape.stages;
  const int s = method.count();
  StepEquations step(slopes, method);
  const auto count = static_cast<Index>(tape.rows.size());
  const Rows rows(count, n), others(accelerations ? count : 0, n);
  std::vector<Trajectory::Tangent> out(static_cast<std::size_t>(np), {rows, rows, others, others, {}});
  MatrixXd q = q0.transpose(), v = v0.transpose(), a0 = MatrixXd::Zero(n, np), alpha0 = a0, a, by, stage_q, stage_v;
  for (Index i = 0; i < n; ++i)
    if (places.given(i)) {
      q.row(i).setZero();  // what a parameter makes of a motion is in the balance
      v.row(i).setZero();
    }
  const auto accelerate = [&](Index e, const MatrixXd& x, const MatrixXd& y) -> MatrixXd {
    const Slopes& at = slopes(e);
    residual_by(by_p, e, places, by);
    by += at.K * x + at.C * y;
    return -Eigen::PartialPivLU<MatrixXd>(at.M).solve(by);
  };
  const auto write = [&](Index row, const MatrixXd& x, const MatrixXd& y) {
    const Index e = tape.rows[static_cast<std::size_t>(row)].point;
    MatrixXd z, f;
    if (accelerations) {
      z = accelerate(e, x, y);
      const Slopes& at = slopes(e);
      f = at.K_applied * x + at.C_applied * y;
      for (Index i = 0; i < n; ++i)
        if (places.given(i)) f.row(i) = at.K_needed.row(i) * x + at.C_needed.row(i) * y + at.M_needed.row(i) * z;
    }
    for (Index p = 0; p < np; ++p) {
      const auto k = static_cast<std::size_t>(p);
      out[k].q.row(row) = x.col(p);
      out[k].v.row(row) = y.col(p);
      if (!accelerations) continue;
      out[k].a.row(row) = z.col(p);
      for (Index i = 0; i < n; ++i)
        out[k].tau(row, i) = f(i, p) + (places.given(i) ? by_p[k].needed(e, i) : by_p[k].applied(e, i));
    }
  };
  const std::vector<std::size_t> first = rows_of_entries(tape);
  for (std::size_t r = first[0]; r < first[1]; ++r) write(static_cast<Index>(r), q, v);
  for (std::size_t k = 0; k < tape.entries.size(); ++k) {
    const Tape::Entry& entry = tape.entries[k];
    if (entry.h == 0.0) {
      a0 = alpha0 = accelerate(entry.point, q, v);
      for (std::size_t r = first[k + 1]; r < first[k + 2]; ++r) write(static_cast<Index>(r), q, v);
      continue;
    }
    const double h = entry.h;
    if (entry.lag != 1.0) alpha0 = a0 + entry.lag * (alpha0 - a0);
    if (entry.point < 0) {
      const auto index = static_cast<Index>(k);
      const Tape::Switch& from = switches.of(index);
      const auto number = &from - tape.switches.data();
      const auto count_rubs = static_cast<Index>(from.rates.size());
      MatrixXd state = MatrixXd::Zero(4 * n + count_rubs, np);
      state.topRows(4 * n) << q, v, a0, alpha0;
      const Index e = place_before(tape, index);
      const Slopes& at = slopes(e);
      for (Index c = 0; c < count_rubs; ++c) {
        const Index i = from.rates[static_cast<std::size_t>(c)];
        if (from.sense[c] != 0.0) continue;
        state.row(4 * n + c) =
            at.M_needed.row(i) * a0 + (at.C_needed - at.C_applied).row(i) * v + (at.K_needed - at.K_applied).row(i) * q;
        for (Index p = 0; p < np; ++p) {
          const Balance& by_one = by_p[static_cast<std::size_t>(p)];
          state(4 * n + c, p) += by_one.needed(e, i) - by_one.applied(e, i);
        }
      }
      MatrixXd end = switches.slopes(from, false) * state;
      for (Index p = 0; p < np; ++p) end.col(p) += switches_by_p[static_cast<std::size_t>(p)].row(number).transpose();
      for (Index i = 0; i < n; ++i)
        if (places.given(i)) {
          end.row(i).setZero();
          end.row(n + i).setZero();
        }
      q = end.topRows(n);
      v = end.bottomRows(n);
      for (std::size_t r = first[k + 1]; r < first[k + 2]; ++r) write(static_cast<Index>(r), q, v);
      continue;
    }
    step.factor(entry, false);
    a.resize(s * n, np);
    for (int i = 0; i <= s; ++i) {
      stage_q = q + h * method.c[i] * v;
      stage_v = v;
      if (method.remembers) {
        stage_q += h * h * (method.q_by_start(i, 0) * a0 + method.q_by_start(i, 1) * alpha0);
        stage_v += h * (method.v_by_start(i, 0) * a0 + method.v_by_start(i, 1) * alpha0);
      }
      if (i == s) break;
      residual_by(by_p, entry.point + i, places, by);
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
      write(static_cast<Index>(r), x, y);
    }
    q = stage_q;
    v = stage_v;
    for (int j = 0; j < s; ++j) {
      q += h * h * method.q_by_a(s, j) * a.middleRows(j * n, n);
      v += h * method.v_by_a(s, j) * a.middleRows(j * n, n);
    }
    if (method.remembers) {
      const MatrixXd last = a.bottomRows(n);
      alpha0 = method.auxiliary[0] * last + method.auxiliary[1] * a0 + method.auxiliary[2] * alpha0;
      a0 = last;
    }
    for (; r < first[k + 2]; ++r) write(static_cast<Index>(r), q, v);
  }
  return out;
}

Adjoint adjoint(const Driven& of, const Tape& tape, const ImplicitOptions& options, const Rows& by_q, const Rows& by_v,
                const Rows& by_a, const Rows& by_tau, int threads) {
  Ahead slopes(of, tape, by_a.rows() > 0 || by_tau.rows() > 0, threads);
  const Places& places = slopes.places();
  Switches switches(of, tape, options);
  const Index n = places.n;
  const Stages& method = tape.stages;
  const int s = method.count();
  StepEquations step(slopes, method);
  Adjoint out{VectorXd::Zero(n),
              VectorXd::Zero(n),
              Rows::Zero(tape.points(), n),
              Rows::Zero(tape.points(), n),
              Rows::Zero(static_cast<Index>(tape.switches.size()), 2 * n),
              Rows::Zero(static_cast<Index>(tape.switches.size()), n)};
  // derivatives of the number by the state at the end of what comes next, going back
  VectorXd q = out.q0, v = q, a0 = q, alpha0 = q, x, y, mu;
  MatrixXd stage;
  Eigen::PartialPivLU<MatrixXd> mass;
  const auto count = [&](Index e, Index i, double force) {  // of the residual, where it counts
    if (places.fixed(e, i)) return;
    out.needed(e, i) += force;
    out.applied(e, i) -= force;
  };
  /// What the accelerations at a place mean for q and v there.
  const auto accelerate = [&](Index e, const VectorXd& by, VectorXd& to_q, VectorXd& to_v) {
    const Slopes& at = slopes(e);
    mass.compute(at.M);
    mu = mass.transpose().solve(by);
    mu = -mu;
    for (Index i = 0; i < n; ++i)
      if (places.fixed(e, i)) mu[i] = 0.0;
    to_q += at.K.transpose() * mu;
    to_v += at.C.transpose() * mu;
    for (Index i = 0; i < n; ++i) count(e, i, mu[i]);
  };
  /// Adds what a row of results means for the state there.
  const auto read = [&](std::size_t row, VectorXd& to_q, VectorXd& to_v) {
    const auto r = static_cast<Index>(row);
    to_q += by_q.row(r).transpose();
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
    }
    accelerate(e, by, to_q, to_v);
  };
  const std::vector<std::size_t> first = rows_of_entries(tape);
  for (std::size_t k = tape.entries.size(); k-- > 0;) {
    const Tape::Entry& entry = tape.entries[k];
    std::size_t last = first[k + 2];
    for (; last > first[k + 1] && tape.rows[last - 1].v_by_a.size() == 0; --last) read(last - 1, q, v);
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
      const Slopes& at = slopes(e);
      x.setZero(n);
      for (std::size_t c = 0; c < from.rates.size(); ++c) {
        const double f = state[4 * n + static_cast<Index>(c)];
        const Index i = from.rates[c];
        if (from.sense[static_cast<Index>(c)] != 0.0) continue;
        x += f * at.M_needed.row(i).transpose();
        v += f * (at.C_needed - at.C_applied).row(i).transpose();
        q += f * (at.K_needed - at.K_applied).row(i).transpose();
        out.needed(e, i) += f;
        out.applied(e, i) -= f;
      }
      delay();
      a0 += x;
      continue;
    }
    step.factor(entry, true);
    stage.resize(s * n, 1);
    for (int j = 0; j < s; ++j)
      stage.middleRows(j * n, n) = h * h * method.q_by_a(s, j) * q + h * method.v_by_a(s, j) * v;
    if (method.remembers) {
      stage.bottomRows(n) += a0 + method.auxiliary[0] * alpha0;
      a0 = method.auxiliary[1] * alpha0 + h * h * method.q_by_start(s, 0) * q + h * method.v_by_start(s, 0) * v;
      alpha0 = method.auxiliary[2] * alpha0 + h * h * method.q_by_start(s, 1) * q + h * method.v_by_start(s, 1) * v;
    }
    v += h * q;
    for (; last > first[k + 1]; --last) {  // rows within
      const Tape::Row& row = tape.rows[last - 1];
      x.setZero(n);
      y.setZero(n);
      read(last - 1, x, y);
      q += x;
      v += y + h * row.c * x;
      for (int j = 0; j < s; ++j) stage.middleRows(j * n, n) += h * h * row.q_by_a[j] * x + h * row.v_by_a[j] * y;
    }
    step.solve_transposed(stage);
    for (int i = 0; i < s; ++i) {
      mu = -stage.middleRows(i * n, n);
      for (Index j = 0; j < n; ++j)
        if (places.fixed(entry.point + i, j)) mu[j] = 0.0;
      for (Index j = 0; j < n; ++j) count(entry.point + i, j, mu[j]);
      x.noalias() = step.K(i).transpose() * mu;
      y.noalias() = step.C(i).transpose() * mu;
      q += x;
      v += y + h * method.c[i] * x;
      if (!method.remembers) continue;
      a0 += h * h * method.q_by_start(i, 0) * x + h * method.v_by_start(i, 0) * y;
      alpha0 += h * h * method.q_by_start(i, 1) * x + h * method.v_by_start(i, 1) * y;
    }
    delay();
  }
  for (std::size_t r = first[1]; r-- > first[0];) read(r, q, v);
  for (Index i = 0; i < n; ++i)
    if (places.given(i)) q[i] = v[i] = 0.0;
  out.q0 = q;
  out.v0 = v;
  return out;
}

}  // namespace flexarm
