// The equations of a step along a tape, in small changes.
#pragma once

#include <Eigen/LU>

#include "turns.hpp"

namespace flexarm {
namespace taped {

/// The equations of a step, in changes: of its stages, N da = rhs.
class StepEquations {
 public:
  StepEquations(Ahead& slopes, const Arm& arm, const Tape& tape)
      : turns(arm, tape),
        ahead_(slopes),
        n_(slopes.places().n),
        tape_(tape),
        of_(tape.stages),
        s_(of_.count()),
        slopes_(of_.count()) {}

  Turns turns;  ///< in the step that was factored last

  /// @param back  whether the places are asked for backwards
  void factor(Index number, bool back) {
    const Tape::Entry& entry = tape_.entries[static_cast<std::size_t>(number)];
    turns.go_to(number);
    const Index n = n_;
    if (closes() && back) closing_ = ahead_(closing_place(entry)).closing;
    for (int i = 0; i < s_; ++i) {
      const Slopes& at = ahead_(back ? entry.point + s_ - 1 - i : entry.point + i);
      Stage& stage = slopes_[back ? s_ - 1 - i : i];
      stage.M = at.M;
      stage.C = at.C;
      stage.K = at.K;
    }
    h_ = entry.h;
    if (closes() && !back) closing_ = ahead_(closing_place(entry)).closing;
    if (closes() && of_.remembers) {  // of one stage, at the step's end
      closed_C_ = slopes_[0].C;
      closed_K_ = slopes_[0].K;
      closing_.put_before(slopes_[0].C, slopes_[0].K);
    }
    if (of_.in_turn) {
      for (int i = 0; i < s_; ++i) slopes_[i].lu.compute(slopes_[i].M);
      return;
    }
    newton_.resize(s_ * n, s_ * n);
    for (int i = 0; i < s_; ++i)
      for (int j = 0; j < s_; ++j) newton_.block(i * n, j * n, n, n) = coupling(i, j);
    lu_.compute(newton_);
  }
  bool closes() const { return ahead_.places().m > 0; }
  /// The place to which loops are closed: the last stage's own, or one of its own behind it.
  Index closing_place(const Tape::Entry& entry) const { return entry.point + (of_.remembers ? s_ - 1 : s_); }
  /// N x = rhs in place.
  void solve(MatrixXd& x) const {
    if (!of_.in_turn) {
      x = lu_.solve(x);
      return;
    }
    for (int i = 0; i < s_; ++i) {
      for (int j = 0; j < i; ++j)
        if (coupled(i, j)) rows(x, i) -= coupling(i, j) * rows(x, j);
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
        if (coupled(i, j)) rows(x, j) -= coupling(i, j).transpose() * rows(x, i);
    }
  }
  /// Slopes by the state at a stage, of arms with loops by that before it is closed.
  const MatrixXd& C(int i) const { return slopes_[i].C; }
  const MatrixXd& K(int i) const { return slopes_[i].K; }
  /// Of the step that was factored last: how the loops are closed behind it, or null; slopes by the closed state.
  const Closing* closing() const { return closes() ? &closing_ : nullptr; }
  const MatrixXd& closed_C() const { return closed_C_; }
  const MatrixXd& closed_K() const { return closed_K_; }

 private:
  struct Stage {
    MatrixXd M, C, K;
    Eigen::PartialPivLU<MatrixXd> lu = {};
  };
  Eigen::Block<MatrixXd> rows(MatrixXd& x, int i) const { return x.block(i * n_, 0, n_, x.cols()); }
  bool coupled(int i, int j) const {
    return of_.v_by_a(i, j) != 0.0 || of_.q_by_a(i, j) != 0.0 || !turns.at(i).empty();
  }
  /// Of the residual at stage i, by the accelerations of stage j.
  MatrixXd coupling(int i, int j) const {
    MatrixXd out = h_ * of_.v_by_a(i, j) * slopes_[i].C + h_ * h_ * of_.q_by_a(i, j) * slopes_[i].K;
    if (i == j) out += slopes_[i].M;
    for (const Turn& turn : turns.at(i))
      out.middleCols<3>(turn.rate) += slopes_[i].K.middleCols<3>(turn.rate) * turn.by_a[static_cast<std::size_t>(j)];
    return out;
  }

  Ahead& ahead_;
  Index n_;
  const Tape& tape_;
  const Stages& of_;
  int s_;
  double h_ = 0.0;
  std::vector<Stage> slopes_;
  MatrixXd newton_, closed_C_, closed_K_;
  Eigen::PartialPivLU<MatrixXd> lu_;
  Closing closing_;
};

}  // namespace taped
}  // namespace flexarm
