// Joints that close loops of a tree: equations g(q) = 0 between the joint's frames on two places, a and b. Their forces
// are G y, G^T = dg/dq. Rigid, y follows from d^2 g/dt^2 = 0 by a small matrix, C = G^T (M + shift)^-1 G, of which the
// recursions give the columns; compliant, y is a spring and damper, whose slopes stand in that matrix, too.
#pragma once

#include "arm/pulls.hpp"
#include "door/records.hpp"
#include "wide/small.hpp"

namespace {

using flexarm::lanes::LoopJoint;
using flexarm::lanes::LoopRow;
using flexarm::lanes::Shift;
using flexarm::lanes::TiedPoint;

constexpr double kEased = 1e-11;     // of C's diagonal, added to it, as rows may depend on others
constexpr double kFaint = 1e-3;      // parts of the largest of that diagonal, added to each: a row that hardly moves is
                                     // eased by more than the rounding of the others
constexpr int kUneased = 2;          // refinements that take it off again
constexpr double kProjected = 1e-8;  // the same where states are moved onto loops: none is moved far in directions in
                                     // which the arm is nearly singular
constexpr double kNearly = 1e-7;     // of the arm's size, or rad: a gap

template <class C>
struct Loops {
  using Sp = typename C::Space;
  using S = typename C::S;
  using In = Space<S>;
  using L3 = typename In::Lin;
  static constexpr int W = Lanes<S>::width;

  struct Side {
    Frame<In> at;  ///< the joint's frame, in the world
    Motion<In> u, a;
    Slice<Sp> slice;  ///< of the place
    L3 origin;        ///< of that slice, in the world
  };
  struct Row {
    S g, rate, second;  ///< g and its derivatives by time
    S force;            ///< y: of a compliant joint; of a rigid one, that which is held
    S stiffness, damping;
    S nearly;  ///< |g| below which it counts as nearly closed
    bool soft;
  };

  const TiedPoint* tied;
  Side* side;  ///< two of each loop
  Row* row;
  Pull<Sp>* pull;  ///< two of each row
  S* held;         ///< of each rigid row: its force, where it is known from outside or from iterations before
  S* reaction;     ///< of each row: its force, where accelerations were found last
  S* change;       ///< of each row: of its force, by the last `correct`
  S *G, *solved;   ///< by columns of nv; (M + shift)^-1 G
  S *matrix, *eased;
  typename C::Wide* turn;  ///< scratch: 2 of each row, and right-hand sides

  static int scratch(const Layout& layout) { return layout.loops > 0 ? 2 * (layout.loop_rows + layout.nv) : 0; }
  void lay_out(const Layout& layout, int most_elastic, typename C::Wide* wide, Arena& arena) {
    turn = wide;
    tied = layout.tied + layout.strut_points + 2 * layout.contacts;
    const int n = layout.loop_rows;
    arena.take(2 * layout.loops, side);
    arena.take(n, row);
    arena.take(2 * n, pull);
    arena.take_zeros(n, held, reaction, change);
    arena.take(n, eased);
    arena.take(n * layout.nv, G, solved);
    arena.take(n * n, matrix);
    for (int k = 0; k < 2 * layout.loops; ++k) {
      Motion<Sp>* none;
      arena.take(most_elastic, arena.counts() ? none : side[k].slice.J);
    }
    for (int k = 0; k < 2 * n; ++k) {
      S* none;
      arena.take(most_elastic, arena.counts() ? none : pull[k].on_beam);
    }
  }

  /// visit(loop, its row, number of the row among all).
  template <class Visit>
  static void for_rows(const Layout& layout, const Visit& visit) {
    int n = 0;
    for (int k = 0; k < layout.loops; ++k)
      for (int i = 0; i < layout.loop[k].rows; ++i) visit(k, layout.loop[k].row[i], n++);
  }

  /// Forces of the rigid rows, of their numbers, from now on.
  template <class Forces>
  void hold(const Layout& layout, const Forces& forces) {
    int rigid = 0;
    for_rows(layout, [&](int k, const LoopRow& r, int n) {
      if (layout.loop[k].rigid(r)) held[n] = forces(rigid++);
    });
  }
  /// All rows, where the chain has moved to q and v.
  void find(C& chain, const Places<Sp>& places, const S* q, const S* v) {
    const Layout& layout = chain.layout;
    for (int k = 0; k < layout.loops; ++k) {
      stand(chain, places, tied[2 * k], q, v, side[2 * k]);
      stand(chain, places, tied[2 * k + 1], q, v, side[2 * k + 1]);
    }
    for_rows(layout, [&](int k, const LoopRow& r, int n) {
      const double* p = layout.tied_numbers + layout.loop[k].numbers * W;
      const auto law = read<records::LoopLaw<S>>(p);
      const Side &a = side[2 * k], &b = side[2 * k + 1];
      const L3 d = b.at.r - a.at.r, e = In::axis(a.at.R, r.i);
      Row& x = row[n];
      S on_a[6], on_b[6];
      x.soft = layout.loop[k].soft[r.turns];
      if (r.turns) {
        const L3 f = In::axis(b.at.R, r.j), couple = In::cross(f, e);
        x.g = In::dot(e, f);
        x.rate = In::dot(b.u.angular - a.u.angular, couple);
        put(In::zero(), couple, on_b);
        put(In::zero(), number<S>(-1.0) * couple, on_a);
      } else {
        x.g = In::dot(e, d);
        x.rate = In::dot(e, b.u.linear - a.u.linear - In::cross(a.u.angular, d));
        put(e, In::cross(b.at.r - b.origin, e), on_b);
        put(number<S>(-1.0) * e, In::cross(e, b.at.r - a.origin), on_a);
      }
      x.nearly = r.turns ? number<S>(kNearly) : kNearly * law.size;
      x.stiffness = r.turns ? law.angular_stiffness : law.stiffness;
      x.damping = r.turns ? law.angular_damping : law.damping;
      x.force = x.soft ? number<S>(-1.0) * (x.stiffness * x.g + x.damping * x.rate) : held[n];
      for (int s = 0; s < 2; ++s)
        if (const Place& place = tied[2 * k + s].place; place.node >= 0)
          pull_slice(layout, places, place, side[2 * k + s].slice, read_wrench(Sp{}, layout, s == 0 ? on_a : on_b),
                     pull[2 * n + s]);
    });
  }
  /// Adds `part` of the forces that are known to those that bodies need.
  void act(C& chain, double part) const {
    for_pulls(chain.layout,
              [&](int n, const Place& place, const Pull<Sp>& p) { add_pull(chain, place, p, -part * row[n].force); });
  }
  /// d^2 g/dt^2, after the chain has accelerated by x. @param base  acceleration of the world
  void accelerate(const C& chain, const Places<Sp>& places, const typename C::Lin& base, const S* x) {
    const Layout& layout = chain.layout;
    for (int k = 0; k < 2 * layout.loops; ++k) side[k].a = acceleration(chain, places, tied[k].place, side[k], base, x);
    for_rows(layout, [&](int k, const LoopRow& r, int n) {
      const Side &a = side[2 * k], &b = side[2 * k + 1];
      const L3 e = In::axis(a.at.R, r.i), turned = In::cross(a.u.angular, e);
      if (r.turns) {
        const L3 f = In::axis(b.at.R, r.j);
        row[n].second =
            In::dot(b.a.angular - a.a.angular, In::cross(f, e)) +
            In::dot(b.u.angular - a.u.angular, In::cross(In::cross(b.u.angular, f), e) + In::cross(f, turned));
      } else {
        const L3 d = b.at.r - a.at.r;
        row[n].second = In::dot(e, b.a.linear - a.a.linear) + 2.0 * In::dot(turned, b.u.linear - a.u.linear) +
                        In::dot(In::cross(a.a.angular, e) + In::cross(a.u.angular, turned), d);
      }
    });
  }

  /// G, where the rows were found.
  void gather(const C& chain) {
    const int nv = chain.layout.nv;
    for (int i = 0; i < chain.layout.loop_rows * nv; ++i) G[i] = S{};
    for_pulls(chain.layout,
              [&](int n, const Place& place, const Pull<Sp>& p) { gather_pull(chain, place, p, G + n * nv); });
  }
  /// C, of M + shift; solve(r, x) is that of the tree. Without a shift, compliant joints have no part in it.
  /// @param part  of its diagonal, by which rigid rows give way
  template <class Solve>
  void factor(const C& chain, const Shift& shift, double part, const Solve& solve) {
    const int n = chain.layout.loop_rows, nv = chain.layout.nv;
    gather(chain);
    solve_columns(n, nv, solve);
    const bool free = idle(shift);
    for (int j = 0; j < n; ++j) {
      S* column = view<S>(turn);
      times_columns(G, nv, n, solved + j * nv, column);
      for (int i = 0; i < n; ++i) matrix[i * n + j] = column[i];
    }
    S most{};
    for (int k = 0; k < n; ++k) most = Lanes<S>::larger(most, matrix[k * n + k]);
    for (int k = 0; k < n; ++k) {
      S& own = matrix[k * n + k];
      eased[k] = row[k].soft ? S{} : part * (own + kFaint * most);
      eased[k] = Lanes<S>::select(most > 0.0, eased[k], number<S>(1.0));  // where nothing free moves any
      if (row[k].soft && !free)
        own += 1.0 / (shift.stiffness * row[k].stiffness + shift.damping * row[k].damping);
      else
        own += eased[k];
      for (int i = 0; i < n && row[k].soft && free; ++i) matrix[i * n + k] = matrix[k * n + i] = S{};
      if (row[k].soft && free) own = number<S>(1.0);
    }
    without_soft = free;
    factor_small(matrix, n);
  }
  /// x = (M + shift)^-1 r of the tree becomes that of the closed loops, where d^2 g/dt^2 = 0.
  template <class V>
  void close(const Layout& layout, V* x) const {
    const int n = layout.loop_rows, nv = layout.nv;
    V* y = view<V>(turn);
    times_columns(G, nv, n, x, y);
    solve(n, y);
    for (int k = 0; k < n; ++k)
      for (int i = 0; i < nv; ++i) x[i] -= solved[k * nv + i] * y[k];
  }
  /// The same for a step of Newton's iteration: where accelerations change by x, d^2 g/dt^2 as found becomes zero. The
  /// residual r loses the forces that the loops take.
  void correct(const Layout& layout, S* r, S* x) {
    const int n = layout.loop_rows, nv = layout.nv;
    S *y = view<S>(turn), *taken = y + n;
    times_columns(G, nv, n, x, y);
    for (int k = 0; k < n; ++k) {
      taken[k] = y[k];
      if (!row[k].soft) y[k] += row[k].second + eased[k] * held[k];  // as much as the forces allow, where rows depend
    }
    ease(n, y);
    ease(n, taken);
    for (int k = 0; k < n; ++k) {
      change[k] = -y[k];
      for (int i = 0; i < nv; ++i) {
        x[i] -= solved[k * nv + i] * y[k];
        if (!row[k].soft) r[i] -= G[k * nv + i] * taken[k];
      }
    }
  }
  /// Adds the last change to the held forces, of arms that are `open`. `let_go` sets these to zero.
  template <class Mask>
  void hold_change(const Layout& layout, const Mask& open) {
    for (int k = 0; k < layout.loop_rows; ++k)
      if (!row[k].soft) held[k] += Lanes<S>::select(open, change[k], S{});
  }
  void let_go(const Layout& layout) {
    for (int k = 0; k < layout.loop_rows; ++k) held[k] = S{};
  }
  /// Adds to x accelerations of which d^2 g/dt^2, as found, becomes zero.
  void close_accelerations(const Layout& layout, S* x) const {
    add_closing<true>(layout, [](const Row& one) { return one.second; }, x);
  }
  /// A displacement w of which g becomes zero, and rates z of which dg/dt does; they are zero before. Beside them,
  /// accelerations that make d^2 g/dt^2 zero move the coordinates by so many times them, and the rates.
  /// @return the square of its size in the norm of M + shift
  S close_places(const Layout& layout, S* w, double by_accelerations = 0.0) const {
    add_closing<false>(layout, [&](const Row& one) { return one.g - by_accelerations * one.second; }, w);
    return size(layout, w);
  }
  S close_rates(const Layout& layout, S* z, double by_accelerations = 0.0) const {
    add_closing<false>(layout, [&](const Row& one) { return one.rate - by_accelerations * one.second; }, z);
    return size(layout, z);
  }
  /// Where every rigid row is so nearly closed that one more correction leaves rounding.
  typename Lanes<S>::Mask closed(const Layout& layout) const {
    auto all = Lanes<S>::everywhere(true);
    for_rows(layout, [&](int, const LoopRow&, int n) {
      if (!row[n].soft) all = all & (Lanes<S>::size(row[n].g) < row[n].nearly);
    });
    return all;
  }
  /// Accelerations x of the tree become those of the closed loops, after `accelerate` and `factor`.
  void constrain(const Layout& layout, S* x) {
    close_accelerations(layout, x);
    const S* y = view<const S>(turn);
    for (int k = 0; k < layout.loop_rows; ++k) reaction[k] = row[k].force + y[k];
  }
  /// Adds `sign` times G times the forces with which rigid rows hold.
  void add_held(const Layout& layout, double sign, S* r) const {
    for (int k = 0; k < layout.loop_rows; ++k)
      for (int i = 0; i < layout.nv && !row[k].soft; ++i) r[i] += sign * (G[k * layout.nv + i] * held[k]);
  }
  /// The forces of rows for a residual that only they can have left, of which x = (M + shift)^-1 r of the tree; G times
  /// them, beyond those with which they hold, into r.
  void react(const Layout& layout, S* r, const S* x) {
    const int n = layout.loop_rows, nv = layout.nv;
    S* y = view<S>(turn);
    times_columns(G, nv, n, x, y);
    solve(n, y);
    for (int i = 0; i < nv; ++i) r[i] = S{};
    add_held(layout, -1.0, r);
    for (int k = 0; k < n; ++k) {
      reaction[k] = row[k].soft ? row[k].force : y[k];
      for (int i = 0; i < nv; ++i) r[i] += G[k * nv + i] * y[k];
    }
  }
  /// Adds G times the changes of the forces of compliant joints where the coordinates change by x.
  void add_stiffness(const Layout& layout, const S* x, S* out) const {
    const int n = layout.loop_rows, nv = layout.nv;
    S* y = view<S>(turn);
    times_columns(G, nv, n, x, y);
    for (int k = 0; k < n; ++k)
      for (int i = 0; i < nv && row[k].soft; ++i) out[i] += (row[k].stiffness * y[k]) * G[k * nv + i];
  }
  /// Of each loop: force and moment on b about the joint's frame there, in the world.
  template <class T>
  void put_forces(const Layout& layout, T* out) const {
    for (int i = 0; i < 6 * layout.loops; ++i) out[i] = T{};
    for_rows(layout, [&](int k, const LoopRow& r, int n) {
      const L3 e = In::axis(side[2 * k].at.R, r.i);
      const L3 f = reaction[n] * (r.turns ? In::cross(In::axis(side[2 * k + 1].at.R, r.j), e) : e);
      T* to = out + 6 * k + (r.turns ? 3 : 0);
      to[0] += f.x;
      to[1] += f.y;
      to[2] += f.z;
    });
  }

 private:
  bool without_soft;  ///< whether compliant joints have no part in the matrix

  static bool idle(const Shift& shift) { return shift.stiffness == 0.0 && shift.damping == 0.0; }
  static void put(const L3& force, const L3& moment, S* out) {
    const S all[6] = {force.x, force.y, force.z, moment.x, moment.y, moment.z};
    for (int i = 0; i < 6; ++i) out[i] = all[i];
  }
  template <class Visit>
  void for_pulls(const Layout& layout, const Visit& visit) const {
    for_rows(layout, [&](int k, const LoopRow&, int n) {
      for (int s = 0; s < 2; ++s)
        if (const Place& place = tied[2 * k + s].place; place.node >= 0) visit(n, place, pull[2 * n + s]);
    });
  }
  void stand(C& chain, const Places<Sp>& places, const TiedPoint& at, const S* q, const S* v, Side& out) const {
    const Layout& layout = chain.layout;
    const double* p = layout.tied_numbers + at.numbers * W;
    const S height = next<S>(p);
    const auto joint = read<records::Seat<In>>(p);
    Stand<S> on = Stand<S>::world();
    if (at.place.node >= 0) {
      const Slice<Sp>& slice = chain.slice_of(at.place, p, q, v);
      out.slice.frame = slice.frame;
      out.slice.rate = slice.rate;
      out.slice.bias = slice.bias;
      for (int k = 0; at.place.on == Place::slice && k < layout.node[at.place.node].ne; ++k)
        out.slice.J[k] = slice.J[k];
      on = stand_of(layout, moving(places, at.place), slice, height);
    }
    const L3 offset = In::rotate(on.frame.R, joint.r);
    out.at = {In::times(on.frame.R, joint.R), on.frame.r + offset};
    out.u = {on.u.linear + In::cross(on.u.angular, offset), on.u.angular};
    out.origin = on.frame.r;
  }
  /// Of the joint's frame (Eq. 45, 46, 86), in the world.
  static Motion<In> acceleration(const C& chain, const Places<Sp>& places, const Place& place, const Side& of,
                                 const typename C::Lin& base, const S* x) {
    const Layout& layout = chain.layout;
    Motion<Sp> sum{base, Sp::zero_angular()};
    S out[kAsked];
    if (place.node >= 0) {
      const State<Sp>& s = chain.state[place.node];
      const int first = layout.node[place.node].ve;
      const bool end = C::on_end(layout, place);
      sum = of.slice.frame.shift(end ? s.end_a : s.a) + C::convective(of.slice, end ? s.end_w : s.w) + of.slice.bias;
      for (int k = 0; place.on == Place::slice && k < layout.node[place.node].ne; ++k)
        sum += x[first + k] * of.slice.J[k];
      sum = moving(places, place).in_world(sum);
    }
    put_world(layout, Moving<Sp>::world().at, sum, S{}, out);
    const L3 linear{out[12], out[13], out[14]}, angular{out[15], out[16], out[17]}, offset = of.at.r - of.origin;
    return {linear + In::cross(angular, offset) + In::cross(of.u.angular, In::cross(of.u.angular, offset)), angular};
  }

  /// (M + shift)^-1 G, of one arm as many columns at a time as a pack has lanes.
  template <class Solve>
  void solve_columns(int n, int nv, const Solve& solve) {
    using V = typename C::Wide;
    constexpr int kAtOnce = static_cast<int>(sizeof(V) / sizeof(S));
    V *r = turn + 2 * n, *x = r + nv;
    for (int first = 0; first < n; first += kAtOnce) {
      S* to = view<S>(r);
      for (int i = 0; i < nv; ++i)
        for (int l = 0; l < kAtOnce; ++l) *to++ = first + l < n ? G[(first + l) * nv + i] : S{};
      solve(static_cast<const V*>(r), x);
      const S* from = view<const S>(x);
      for (int i = 0; i < nv; ++i)
        for (int l = 0; l < kAtOnce; ++l, ++from)
          if (first + l < n) solved[(first + l) * nv + i] = *from;
    }
  }

  /// y = C^-1 y, of the matrix that is eased.
  template <class V>
  void ease(int n, V* y) const {
    for (int k = 0; k < n && without_soft; ++k)
      if (row[k].soft) y[k] = V{};
    solve_small(matrix, n, y);
  }
  /// y = C^-1 y
  template <class V>
  void solve(int n, V* y) const {
    V* more = view<V>(turn) + n;
    ease(n, y);
    for (int k = 0; k < n; ++k) more[k] = y[k];
    for (int round = 0; round < kUneased; ++round) {
      for (int k = 0; k < n; ++k) more[k] = eased[k] * more[k];
      solve_small(matrix, n, more);
      for (int k = 0; k < n; ++k) y[k] += more[k];
    }
  }
  /// Adds to x the change that makes of(row) of the rigid ones zero. `turn` has the forces, C^-1 of it.
  template <bool exact, class Of>
  void add_closing(const Layout& layout, const Of& of, S* x) const {
    const int n = layout.loop_rows, nv = layout.nv;
    S* y = view<S>(turn);
    for (int k = 0; k < n; ++k) y[k] = row[k].soft ? S{} : -of(row[k]);
    exact ? solve(n, y) : ease(n, y);
    for (int k = 0; k < n; ++k)
      for (int i = 0; i < nv; ++i) x[i] += y[k] * solved[k * nv + i];
  }
  /// x^T (M + shift) x of the x that `add_closing` has just made of zero, whose forces are still in `turn`.
  S size(const Layout& layout, const S* x) const {
    const int n = layout.loop_rows;
    S *y = view<S>(turn), *moved = y + n, sum{};
    times_columns(G, layout.nv, n, x, moved);
    for (int k = 0; k < n; ++k) sum += y[k] * moved[k];
    return sum;
  }
};

}  // namespace
