// Looks of sampled laws along a tape, once more: their slopes, and derivatives of a number by their answers.
#pragma once

#include "places.hpp"

namespace flexarm {
namespace taped {

/// One look of a law, and the samples of the tape in which it looked and from which on its force acts (none: beyond the
/// last).
struct Look {
  std::size_t law;
  double t;
  std::size_t at, acts;
};

/// The looks of a problem's laws, as Control takes them.
inline std::vector<Look> looks_of(const Problem& of, const Tape& tape) {
  std::vector<Look> out;
  std::vector<long> taken(of.samplers.size(), 0);
  for (std::size_t k = 0; k < tape.samples.size(); ++k)
    for (std::size_t l = 0; l < taken.size(); ++l) {
      const Sampler& s = of.samplers[l];
      for (double t; (t = s.first + static_cast<double>(taken[l]) * s.period) <= tape.samples[k].until; ++taken[l]) {
        std::size_t acts = k;
        while (acts < tape.samples.size() && t + s.delay > tape.samples[acts].until) ++acts;
        out.push_back({l, t, k, acts});
      }
    }
  return out;
}

/// Laws of a problem at the looks of a run. One that is no LinearLaw must not remember.
class Laws {
 public:
  Laws(const Problem& of, const Tape& tape)
      : samplers_(of.samplers), tape_(tape), places_(of, tape), nv_(of.arm->nv()) {
    for (Sampler& s : samplers_)
      if (const LinearLaw* law = linear(s)) most_ = std::max(most_, law->x.size());
  }
  /// How many numbers an answer has: forces (nv), and the largest new memory.
  Index width() const { return nv_ + most_; }
  /// The memory of a look's law.
  VectorXd memory(const Look& look) {
    const LinearLaw* law = linear(samplers_[look.law]);
    return law ? law->x : VectorXd();
  }
  /// A law's answer, from a memory that need not be its own; it goes on from the new memory.
  VectorXd answer(const Look& look, const VectorXd& from) {
    Sampler& s = samplers_[look.law];
    const System& now = places_.move(tape_.samples[look.at].point);
    VectorXd out = VectorXd::Zero(width());
    LinearLaw* law = linear(s);
    if (law) law->x = from;
    VectorXd force(nv_);
    s.law(look.t, now.q, now.v, now.a, force);
    out.head(nv_) = force;
    if (law) out.segment(nv_, law->x.size()) = law->x;
    return out;
  }
  /// Slopes of an answer by the turns (nv), v, a (nv each) and the memory.
  MatrixXd slopes(const Look& look, const VectorXd& from) {
    Sampler& s = samplers_[look.law];
    const Index e = tape_.samples[look.at].point;
    const System& now = places_.move(e);
    MatrixXd out = MatrixXd::Zero(width(), 3 * nv_ + from.size()), by_q;
    if (LinearLaw* law = linear(s)) {
      law->x = from;
      law->sample(look.t, now.q, now.v, now.a);
      const Index n = from.size(), nq = now.q.size(), e_count = law->by_q.rows();
      MatrixXd dx = MatrixXd::Zero(n, nq + nv_ + n), de = MatrixXd::Zero(e_count, dx.cols()), du;
      dx.rightCols(n).setIdentity();
      de.leftCols(nq) = -law->by_q;
      de.middleCols(nq, nv_) = -law->by_v;
      law->slopes(dx, de, du);
      MatrixXd all = MatrixXd::Zero(width(), dx.cols());
      all.topRows(nv_) = law->columns * du;
      all.middleRows(nv_, n) = dx;
      by_q = all.leftCols(nq);
      out.middleCols(nv_, nv_) = all.middleCols(nq, nv_);
      out.rightCols(n) = all.rightCols(n);
    } else {
      VectorXd state[] = {now.q, now.v, now.a};
      MatrixXd by[3];
      VectorXd force(nv_);
      for (int k = 0; k < 3; ++k) {
        by[k] = MatrixXd::Zero(width(), state[k].size());
        for (Index i = 0; i < state[k].size(); ++i) {
          const double here = state[k][i], h = kMoved * (1.0 + std::abs(here));
          for (int j = 0; j < 4; ++j) {
            state[k][i] = here + kSteps[j] * h;
            s.law(look.t, state[0], state[1], state[2], force);
            by[k].col(i).head(nv_) += kWeights[j] / h * force;
          }
          state[k][i] = here;
        }
      }
      by_q = by[0];
      out.middleCols(nv_, nv_) = by[1];
      out.middleCols(2 * nv_, nv_) = by[2];
    }
    out.leftCols(nv_) = places_.by_turns(e, by_q);
    return out;
  }

 private:
  static constexpr double kMoved = 3e-4, kSteps[] = {-2.0, -1.0, 1.0, 2.0},
                          kWeights[] = {1.0 / 12.0, -2.0 / 3.0, 2.0 / 3.0, -1.0 / 12.0};
  static LinearLaw* linear(Sampler& s) { return s.law.target<LinearLaw>(); }
  std::vector<Sampler> samplers_;
  const Tape& tape_;
  Places places_;
  Index nv_, most_ = 0;
};

/// Derivatives of a number by the answers of sampled laws, going back through the samples of a tape.
class LooksBack {
 public:
  LooksBack(const Problem& of, const Tape& tape)
      : tape_(tape),
        looks_(looks_of(of, tape)),
        laws_(of, tape),
        nv_(of.arm->nv()),
        until_(tape.points()),
        left_(tape.samples.size()),
        switches_(tape.switches.size()),
        last_(looks_.size()),
        by_force_(of.samplers.size(), VectorXd::Zero(nv_)),
        by_memory_(of.samplers.size()) {
    by_answer = Rows::Zero(static_cast<Index>(looks_.size()), laws_.width());
    for (const Look& look : looks_) {
      from_.push_back(laws_.memory(look));
      laws_.answer(look, from_.back());
      by_memory_[look.law].setZero(from_.back().size());
      acting_.push_back(acting_.size());
    }
    std::stable_sort(acting_.begin(), acting_.end(),
                     [this](std::size_t i, std::size_t j) { return looks_[i].acts < looks_[j].acts; });
  }
  Rows by_answer;  ///< of each look

  /// The place of the next sample, if that is behind a place and no earlier than an entry; or -1.
  Index next(Index entry, Index place) const {
    if (left_ == 0) return -1;
    const Tape::Sample& s = tape_.samples[left_ - 1];
    return s.entry >= entry && s.point > place ? s.point : -1;
  }
  /// Goes back through it. @param applied, held  of the adjoint so far
  /// @return derivatives by the turns, v and a there (nv each)
  VectorXd back(const Rows& applied, const Rows& held, const Places& places) {
    const Tape::Sample& now = tape_.samples[--left_];
    VectorXd force = VectorXd::Zero(nv_), out = VectorXd::Zero(3 * nv_);
    for (; until_ > now.point + 1; --until_) force += places.given_out(until_ - 1, applied.row(until_ - 1).transpose());
    for (; switches_ > 0 && tape_.switches[switches_ - 1].entry > now.entry; --switches_)
      force += held.row(static_cast<Index>(switches_) - 1).transpose();
    for (VectorXd& by : by_force_) by += force;
    for (; !acting_.empty() && looks_[acting_.back()].acts >= left_; acting_.pop_back()) {
      if (looks_[acting_.back()].acts > left_) continue;     // beyond the run
      VectorXd& by = by_force_[looks_[acting_.back()].law];  // the last of a law has acted from here on
      by_answer.row(static_cast<Index>(acting_.back())).head(nv_) = by;
      by.setZero();
    }
    for (; last_ > 0 && looks_[last_ - 1].at == left_; --last_) {
      const Look& look = looks_[last_ - 1];
      auto by = by_answer.row(static_cast<Index>(last_) - 1);
      VectorXd& memory = by_memory_[look.law];
      by.segment(nv_, memory.size()) = memory;
      const VectorXd found = laws_.slopes(look, from_[last_ - 1]).transpose() * by.transpose();
      out += found.head(3 * nv_);
      memory = found.tail(memory.size());
    }
    return out;
  }

 private:
  const Tape& tape_;
  std::vector<Look> looks_;
  std::vector<VectorXd> from_;  // memories before each
  Laws laws_;
  Index nv_, until_;
  std::size_t left_, switches_, last_;
  std::vector<std::size_t> acting_;             // looks, as their forces begin to act
  std::vector<VectorXd> by_force_, by_memory_;  // of each law
};

}  // namespace taped
}  // namespace flexarm
