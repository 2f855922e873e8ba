// Steps of a tape that have no equations of their own: in which dry friction holds, lets go or turns a joint, a contact
// meets or lets go, or that were divided.
#pragma once

#include <algorithm>
#include <cmath>

#include "flexarm/kinematics.hpp"
#include "places.hpp"

namespace flexarm {
namespace taped {

/// These steps, taken again.
class Switches {
 public:
  Switches(const Problem& of, const Tape& tape, ImplicitOptions options)
      : of_(of), control_(of.control()), s_(of, control_), tape_(tape), n_(of.arm->nv()), rubs_(rubs(*of.arm)) {
    if (tape.switches.empty()) return;
    options.rtol = std::min(options.rtol, kSolved);
    options.max_iterations = std::max(options.max_iterations, kIterations);
    step_.emplace("implicit", *of.arm, 1.0, options);
  }
  /// The change of state (2 nv) from `reference` and a rate of zero to the end of a step; forces of friction that
  /// slides are this arm's.
  VectorXd end(Tape::Switch from, const VectorXd& reference) {
    way_.clear();
    for (std::size_t c = 0; c < from.rates.size(); ++c)
      for (const Rub& r : rubs_) {
        if (r.rate != from.rates[c]) continue;
        const auto k = static_cast<Index>(c);
        const double sense = from.sense[k];
        if (sense != 0.0) from.before[k] = -sense * r.coulomb;
        way_.push_back(sense != 0.0 ? sense * from.v[r.rate] < 0.0 : std::abs(from.before[k]) > r.stiction);
      }
    s_.q = from.q;
    s_.v = from.v;
    s_.constant_tau = of_.tau;
    if (from.tau.size() > 0) s_.constant_tau += from.tau;
    s_.drive(from.t);
    const Step::Given given = [&](double c) { s_.drive(from.t + c * from.h); };
    solved_ = step_->repeat(from, s_.ws, s_.q, s_.v, s_.tau, given);
    const std::vector<double> went = step_->way();
    way_.insert(way_.end(), went.begin(), went.end());
    VectorXd out(2 * n_), moved(n_);
    displacement(s_.arm, reference, s_.q, moved);
    out << moved, s_.v;
    return out;
  }
  VectorXd end(const Tape::Switch& from) { return end(from, reached(from)); }
  /// Which way friction went in the step of the last end; and of each rate whether its beginning is one that no step
  /// leaves behind: sliding backwards, or held beyond the stiction.
  const std::vector<double>& way() const { return way_; }
  /// Derivatives of that end by q, v, a0 and alpha0 (nv columns each), by the forces before of rates that rub, and, if
  /// `held`, by forces held over the step (nv columns): by differences among steps that go the same way.
  MatrixXd slopes(const Tape::Switch& from, bool held) {
    const auto count = static_cast<Index>(from.rates.size());
    Tape::Switch at = from;
    if (at.tau.size() == 0) at.tau = VectorXd::Zero(n_);
    MatrixXd out(2 * n_, 4 * n_ + count + (held ? n_ : 0));
    const VectorXd reference = reached(from), here = end(at, reference);
    if (!solved_) bad_value("step at t", from.t, "has no derivatives: it could not be solved again, more exactly");
    const std::vector<double> taken = way();
    for (Index k = 0; k < out.cols(); ++k) {
      if (from.parts > 0 && k >= 2 * n_ && k < 4 * n_) {  // what is divided has forgotten a0 and alpha0
        out.col(k).setZero();
        continue;
      }
      const auto which = [&](Tape::Switch& of) -> double& {  // but of q
        if (k >= 4 * n_ + count) return of.tau[k - 4 * n_ - count];
        if (k >= 4 * n_) return of.before[k - 4 * n_];
        VectorXd* parts[] = {&of.v, &of.a0, &of.alpha0};
        return (*parts[k / n_ - 1])[k % n_];
      };
      const auto moved = [&](double change) {
        Tape::Switch other = at;
        if (k < n_)
          displace(s_.arm, at.q, change * VectorXd::Unit(n_, k), other.q);
        else
          which(other) += change;
        return end(other, reference);
      };
      const double size = k < 2 * n_ ? 1.0 : (k < 4 * n_ ? 1.0 / from.h : 1.0) + std::abs(which(at));
      const double whole = (from.parts > 0 ? kFar : kMoved) * size;
      double by = whole;
      for (int smaller = 0; smaller < kSmaller; ++smaller, by *= 0.1) {
        const VectorXd below = moved(-by);
        const bool below_too = way() == taken;
        const VectorXd above = moved(by);
        const bool above_too = way() == taken;
        if (smaller == 0 || (below_too && above_too)) out.col(k) = (above - below) / (2.0 * by);
        if (below_too != above_too) out.col(k) = (above_too ? above - here : here - below) / by;
        if (below_too || above_too) break;
      }
    }
    return out;
  }
  /// The switch of an entry; entries are asked for one after another, either way.
  const Tape::Switch& of(Index entry) const {
    return *std::lower_bound(tape_.switches.begin(), tape_.switches.end(), entry,
                             [](const Tape::Switch& s, Index k) { return s.entry < k; });
  }

 private:
  /// The coordinates to which the run's own step led: the method begins anew behind it.
  VectorXd reached(const Tape::Switch& from) const {
    const Index nq = of_.arm->nq(), place = tape_.entries[static_cast<std::size_t>(from.entry + 1)].point;
    return Eigen::Map<const VectorXd>(tape_.q.data() + place * nq, nq);
  }
  static constexpr double kSolved = 1e-13, kMoved = 1e-7;
  static constexpr double kFar = 1e-5;  // of divided steps: no kinks, but many parts' rounding
  static constexpr int kIterations = 50;
  static constexpr int kSmaller = 3;  // steps of a difference that are tried
  const Problem& of_;
  Control control_;
  System s_;
  const Tape& tape_;
  Index n_;
  std::vector<Rub> rubs_;
  std::vector<double> way_;
  bool solved_ = false;  // the last step
  std::optional<OneStep> step_;
};

}  // namespace taped
}  // namespace flexarm
