// The record of a run by fixed steps, for its derivatives.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "flexarm/saltation.hpp"

namespace flexarm {

/// A method's step as its derivatives see it. The equations of motion hold at s stages, whose rates and coordinates are
/// sums of the accelerations a_j there and, of a method that remembers, of a0 and alpha0 at the step's beginning:
///   v_i = v0 + h (sum_j v_by_a_ij a_j + v_by_start_i0 a0 + v_by_start_i1 alpha0)
///   q_i = q0 + h c_i v0 + h^2 (sum_j q_by_a_ij a_j + q_by_start_i0 a0 + q_by_start_i1 alpha0)
/// The row behind the stages is the step's end, where a0 becomes a_s, and alpha0 the sum `auxiliary` of a_s, a0,
/// alpha0.
struct Stages {
  Eigen::VectorXd c;                       ///< (s + 1)
  Eigen::MatrixXd v_by_a, q_by_a;          ///< (s + 1, s)
  Eigen::MatrixXd v_by_start, q_by_start;  ///< (s + 1, 2)
  Eigen::Vector3d auxiliary = {0, 0, 0};
  bool remembers = false;  ///< a0 and alpha0 go on from step to step; else both are nothing
  bool in_turn = false;    ///< each stage depends on those before it alone
  int count() const { return static_cast<int>(c.size()) - 1; }
};

/// The places of a run at which the equations of motion hold, and the order in which its steps met them.
struct Tape {
  /// Of a rate at such a place: it is free; its motion is given, or dry friction holds it, so that its equation does
  /// not count; it is held still, but about to be torn loose (3 or -3); or it slides (1 or -1).
  enum Way : signed char { torn_back = -3, back = -1, free = 0, ahead = 1, held = 2, torn_ahead = 3 };
  struct Entry {
    double h;            ///< length of the step (s); 0: the method begins anew here, or there is a leap
    double lag;          ///< of alpha0 - a0, the part of it at the beginning: 1 but where the step changes
    Eigen::Index point;  ///< its first place
  };
  /// The beginning of a step that was divided, met or left a contact, or in which dry friction came to hold a joint,
  /// let it go, or turned: its entry has no places.
  struct Switch {
    Eigen::Index entry;
    double t, h;                             ///< time and length (s)
    Eigen::VectorXd q, v, a0, alpha0, gain;  ///< state; gain: added to a0 in the first guess of a
    Eigen::VectorXd sense, before;           ///< of each rate that rubs: 1, -1 or 0, held; force of friction
    std::vector<int> rates;                  ///< which these are
    Eigen::VectorXd tau;                     ///< forces held over the step beside the problem's; empty: none
    int parts = 0;                           ///< into which the step was divided; 0: it was not
  };
  /// Controllers have sampled, or let pass a force that was on its way. The state that they saw is a place of its own,
  /// at which the forces are those of before.
  struct Sample {
    Eigen::Index entry, point;  ///< the last entry before it (-1: none); its place
    double until;               ///< all samples due up to this time are done (s)
    Eigen::VectorXd held;       ///< the forces from here on (nv)
  };
  /// A row of the results: the state within, or at the end of, the step of an entry.
  struct Row {
    Eigen::Index entry;              ///< -1: the start
    double c = 1.0;                  ///< part of the step
    Eigen::VectorXd v_by_a, q_by_a;  ///< (s) as of Stages, within a step; empty: at its end
    Eigen::Index point;              ///< place of the row's accelerations; -1: of a rollout, which has none
  };

  /// A place to which loops were closed, at the end of a step or within: by displacement w and rates z, of which
  /// (M + shift) w = G y. Of a method that remembers, the shift is that of its equations, and its stage the place.
  struct Closing {
    Eigen::Index point;
    double by_v, by_q;                           ///< of the shift: rates and coordinates by accelerations
    std::array<Eigen::VectorXd, 2> moves;        ///< w, z (nv); of w, until `complete`, the coordinates (nq)
    std::array<Eigen::VectorXd, 2> forces = {};  ///< y of each, of rigid rows; see `complete`
  };

  /// An event that occurred at time t, on the cubics through two rows; all rows of occurrences are no rows of the
  /// results.
  struct Occurrence {
    std::size_t event;
    double t;
    Eigen::Index before, after;  ///< numbers of the rows
  };

  Stages stages;
  std::vector<double> t, q, v, a;  ///< of all places: times, and nq, nv and nv numbers each
  std::vector<signed char> way;
  std::vector<signed char> sides;  ///< of the limits of laws and motors at all places, see `sides`; empty: none
  std::vector<double> loops;       ///< forces of the rigid rows of loops at all places; empty: none
  std::vector<double> beside;      ///< of a rollout with loops: forces beside the problem's at all places (nv)
  std::vector<Entry> entries;
  std::vector<Row> rows;
  std::vector<Switch> switches;
  std::vector<Saltation> leaps;  ///< between steps, of methods without switches within; the places are those before
  std::vector<Sample> samples;
  std::vector<Closing> closings;
  std::vector<Occurrence> occurrences;
  double now = 0.0;     ///< time at which the step begins that is being taken (s)
  Eigen::VectorXd tau;  ///< forces that are held over it beside the problem's; empty: none

  explicit Tape(Stages of) : stages(std::move(of)) {}

  Eigen::Index points() const { return static_cast<Eigen::Index>(t.size()); }
  /// Forces that controllers hold at a place; null: none.
  const Eigen::VectorXd* held_at(Eigen::Index place) const {
    const auto next = std::lower_bound(samples.begin(), samples.end(), place,
                                       [](const Sample& s, Eigen::Index e) { return s.point < e; });
    return next == samples.begin() ? nullptr : &(next - 1)->held;
  }
  /// Adds the end of a step, of a method whose stages are others, that was closed from q and v before.
  void close(double at, const Eigen::VectorXd& q_at, const Eigen::VectorXd& v_at, const Eigen::VectorXd& a_at,
             double by_q, const Eigen::VectorXd& q_before, const Eigen::VectorXd& v_before) {
    closings.push_back({add(at, q_at, v_at, a_at), 0.0, by_q, {q_at - q_before, v_at - v_before}});
  }
  const Closing* closing_at(Eigen::Index place) const {
    const auto at = std::lower_bound(closings.begin(), closings.end(), place,
                                     [](const Closing& c, Eigen::Index e) { return c.point < e; });
    return at != closings.end() && at->point == place ? &*at : nullptr;
  }
  /// Adds a place, of free rates, except those that rub or are given. @return its number
  template <class Q, class V, class A>
  Eigen::Index add(double at, const Q& q_at, const V& v_at, const A& a_at) {
    t.push_back(at);
    q.insert(q.end(), q_at.begin(), q_at.end());
    v.insert(v.end(), v_at.begin(), v_at.end());
    a.insert(a.end(), a_at.begin(), a_at.end());
    way.resize(v.size(), free);
    return points() - 1;
  }
  /// Forgets the step that was added last.
  void take_back() {
    const auto left = static_cast<std::size_t>(entries.back().point), nq = q.size() / t.size(),
               nv = v.size() / t.size();
    entries.pop_back();
    t.resize(left);
    q.resize(left * nq);
    for (auto* x : {&v, &a}) x->resize(left * nv);
    way.resize(left * nv);
    if (!closings.empty() && closings.back().point >= points()) closings.pop_back();
  }
  /// Contacts of the place that was added last (nv).
  signed char* last_ways() { return way.data() + way.size() - (v.size() / t.size()); }
};

}  // namespace flexarm
