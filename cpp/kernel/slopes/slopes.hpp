// The Jacobians of inverse dynamics, by dual numbers through the recursions of a tree, a segment of a few nodes at a
// time: its rows by its own coordinates and rates, by the motion X of the frame that it sits on, and by the forces F
// where others sit on it: on its end, or on slices of its last beam. Between segments the chain rule remains: dX goes
// outward, dF inward, both by small matrices.
#pragma once

#include "arm/elimination.hpp"
#include "slopes/body_slopes.hpp"

namespace {

/// dtau/dq (nv x nq) and dtau/dv (nv x nv) of inverse dynamics; and of forward dynamics, by M^-1 of the chain.
template <class Sp>
class Slopes {
  using C = Chain<Sp, LaneDual>;
  using One = typename SpaceOf<Sp, double>::type;
  using Value = Chain<One, Pack>;
  using Lin = typename Sp::Lin;
  using Ang = typename Sp::Ang;
  static constexpr int D = kColumns;
  static constexpr int kForce = Sp::linear + Sp::angular;
  static constexpr int kMostMotion = 3 * Sp::angular + Sp::linear;
  static constexpr int kEnough = 2 * D;  ///< own columns of a segment

  /// Nodes in a row. Its matrix has rows of the motion of its seats, of the force where it begins, and of its rates;
  /// columns of its own coordinates and rates, of the motion where it begins, and of the forces on its seats.
  struct Segment {
    int first, end;          ///< nodes
    int parent;              ///< the segment that it sits on, or -1: the world
    int seat;                ///< and which of its seats
    bool on_end;             ///< whether any sits on its end: the first of its seats; then come those on slices
    int seats;               ///< how many
    int child, sibling;      ///< one that sits on it, and the next one on its own parent; -1: none
    int rates, own, inputs;  ///< rows of rates; columns, filled up to multiples of D
    int* rate;               ///< of each row
    int* direction;          ///< of each own column: a coordinate, or nq and a rate; -1: none
    double* matrix;
    double* response;  ///< by the motion where it begins, with all that it carries: rows of force and of rates
    double* moved;     ///< the motion of its seats, D columns
    int stride() const { return own + inputs; }
  };

 public:
  static std::size_t memory(const SlopesOf& of) {
    Arena arena;
    Slopes(of, arena, true);
    return arena.bytes();
  }
  Slopes(const SlopesOf& of, void* memory, bool by_v) : Slopes(of, Arena(memory), by_v) {}

  /// Of inverse dynamics. @param by_v  null where it is not asked for
  /// @param loops  null, or gets those of d^2 g/dt^2 of the rigid rows of loops, by columns of q and v
  void inverse(const double* wrenches, const double* q, const double* v, const double* a, double* by_q, double* by_v,
               double* loops) {
    begin(wrenches, q, v, a);
    move_value(q, v);
    differentiate(a);
    for_columns([&](const int* direction) { put(direction, columns_, 1.0, by_q, by_v); });
    for_columns_by_state(by_v != nullptr, [&](const int* direction) {
      put(direction, columns_, -1.0, by_q, by_v, true);
      if (loops) put_loops(direction, loops);
    });
  }

  /// Of forward dynamics, whose accelerations go into a. @return the outcome
  Outcome forward(const double* wrenches, const double* q, const double* v, const double* tau, double* a, double* by_q,
                  double* by_v, double* by_tau) {
    begin(wrenches, q, v, a);
    move_value(q, v);
    if (layout_.by_state()) value_->by_state->act(*value_, 1.0);
    const bool good = ::forward(*value_, base_, tau, a);
    if (!good) return outcome(*value_, good);
    if (layout_.by_state()) value_->by_state->act(*value_, -1.0);
    for (int k = 0; k < layout_.loop_rows; ++k)
      dual_->by_state->loops.held[k] = LaneDual{} + value_->by_state->loops.reaction[k];
    for (int i = 0; i < nv_; ++i) q_[nq_ + nv_ + i].x = a[i];
    differentiate(a);
    for_columns([&](const int* direction) {
      solve_columns();
      put(direction, columns_, -1.0, by_q, by_v);
    });
    for_columns_by_state(true, [&](const int* direction) {
      solve_columns();
      if (layout_.loops > 0) keep_closed();
      put(direction, columns_, 1.0, by_q, by_v, true);
    });
    for (int first = 0; first < nv_; first += D) {
      int direction[D];
      for (int i = 0; i < nv_ * D; ++i) columns_[i] = 0.0;
      for (int k = 0; k < D; ++k) {
        direction[k] = first + k < nv_ ? first + k : -1;
        if (first + k < nv_) columns_[(first + k) * D + k] = 1.0;
      }
      solve_columns();
      put(direction, columns_, 1.0, by_tau, nullptr);
    }
    return Outcome::good;
  }

 private:
  Slopes(const SlopesOf& of, Arena&& arena, bool by_v) : Slopes(of, arena, by_v) {}
  Slopes(const SlopesOf& of, Arena& arena, bool by_v)
      : layout_(of.layout),
        nq_(layout_.nq),
        nv_(layout_.nv),
        motion_((layout_.attitudes ? 3 : 2) * Sp::angular + Sp::linear) {
    dual_ = make_chain<C>(layout_, of.numbers, arena);
    value_ = make_chain<Value>(of.grouped, of.grouped_numbers, arena);
    if (of.remembered && !arena.counts()) {
      dual_->by_state->recall(layout_, of.remembered);
      value_->by_state->recall(layout_, of.remembered);
    }
    if (layout_.loops > 0 && of.held && !arena.counts()) {
      value_->by_state->loops.hold(layout_, [&](int k) { return of.held[k]; });
      dual_->by_state->loops.hold(layout_, [&](int k) { return LaneDual{} + of.held[k]; });
    }
    bodies_ = arena.take_lines<BodySlopes<Sp>>(1);
    BodySlopes<Sp> bodies(of, arena);
    if (bodies_) new (bodies_) BodySlopes<Sp>(bodies);
    q_ = arena.take_lines<LaneDual>(static_cast<std::size_t>(nq_ + 3 * nv_));  // and v, a, tau
    tau_ = arena.take_lines<double>(static_cast<std::size_t>(nv_));
    segment_ = arena.take_lines<Segment>(static_cast<std::size_t>(layout_.nodes));
    for (int first = 0; first < layout_.nodes; ++segments_) {
      int end = first, columns = 0;
      while (end < layout_.nodes) {
        const int more = columns_of(layout_.node[end], by_v);
        if (end > first && !layout_.node[end].coincident && columns + more > kEnough) break;
        const Node& last = layout_.node[end > first ? end - 1 : end];
        if (end > first && (layout_.node[end].branch || last.fork >= 0 || last.slices > 0)) break;
        columns += more;
        ++end;
      }
      lay_out(first, end, columns, by_v, arena);
      first = end;
    }
    columns_ = arena.take_lines<double>(static_cast<std::size_t>(D * nv_));
    forces_ = arena.take_lines<LaneDual>(static_cast<std::size_t>(most_seats_ * kForce));
    carried_ = arena.take_lines<double>(static_cast<std::size_t>(most_seats_ * kForce * D));
    behind_ = arena.take_lines<bool>(static_cast<std::size_t>(segments_));
    solved_ = arena.take_lines<Pack>(static_cast<std::size_t>(2 * nv_));
  }
  static int filled(int columns) { return (columns + D - 1) / D * D; }

  /// visit(direction) for each of a node's.
  template <class Visit>
  static void for_own(const Layout& layout, const Node& node, bool by_v, const Visit& visit) {
    const bool joint = node.kind != Node::fixed && !node.coincident;
    for (int k = 0; k < node.ne; ++k) visit(node.qe + k);
    if (joint)
      for (int k = 0; k < (node.ball ? 4 : 1); ++k) visit(node.q + k);
    if (!by_v) return;
    if (joint)
      for (int k = 0; k < (node.ball ? 3 : 1); ++k) visit(layout.nq + node.v + k);
    for (int k = 0; k < node.ne; ++k) visit(layout.nq + node.ve + k);
  }
  int columns_of(const Node& node, bool by_v) const {
    int columns = 0;
    for_own(layout_, node, by_v, [&](int) { ++columns; });
    return columns;
  }

  void lay_out(int first, int end, int columns, bool by_v, Arena& arena) {
    Segment s{first, end, -1, 0, false, 0, -1, -1, 0, filled(columns), 0, nullptr, nullptr, nullptr, nullptr, nullptr};
    const Node& last = layout_.node[end - 1];
    s.on_end = last.fork >= 0 || (end < layout_.nodes && !layout_.node[end].branch);
    s.seats = s.on_end + last.slices;
    if (s.seats > most_seats_) most_seats_ = s.seats;
    for (int i = first; i < end; ++i) s.rates += layout_.node[i].ne + (layout_.node[i].kind != Node::fixed);
    const int sits_on = layout_.node[first].parent;
    s.inputs = filled((sits_on >= 0 ? motion_ : 0) + s.seats * kForce);
    s.rate = arena.take_lines<int>(static_cast<std::size_t>(s.rates));
    s.direction = arena.take_lines<int>(static_cast<std::size_t>(s.own));
    s.matrix = arena.take_lines<double>(static_cast<std::size_t>((s.seats * motion_ + kForce + s.rates) * s.stride()));
    s.response = arena.take_lines<double>(static_cast<std::size_t>((kForce + s.rates) * s.inputs));
    s.moved = arena.take_lines<double>(static_cast<std::size_t>(s.seats * motion_ * D));
    if (!s.rate) return;  // counting
    for (int k = 0; k < segments_; ++k)
      if (segment_[k].end - 1 == sits_on) s.parent = k;
    if (s.parent >= 0) {
      const Node& under = layout_.node[sits_on];
      for (int k = 0; k < under.slices; ++k)
        if (under.slice[k] == layout_.node[first].seat) s.seat = segment_[s.parent].on_end + k;
      s.sibling = segment_[s.parent].child;
      segment_[s.parent].child = segments_;
    }
    int row = 0, column = 0;
    for (int i = first; i < end; ++i) {
      const Node& node = layout_.node[i];
      if (node.kind != Node::fixed) s.rate[row++] = node.v;
      for (int k = 0; k < node.ne; ++k) s.rate[row++] = node.ve + k;
      for_own(layout_, node, by_v, [&](int direction) { s.direction[column++] = direction; });
    }
    while (column < s.own) s.direction[column++] = -1;
    segment_[segments_] = s;
  }

  // --- Values. ---

  void begin(const double* wrenches, const double* q0, const double* v0, const double* a0) {
    for (int i = 0; i < 6 * layout_.loads; ++i) {
      value_->wrench[i] = wrenches[i];
      dual_->wrench[i] = LaneDual{} + wrenches[i];
    }
    const auto set = [](const double* from, int n, LaneDual* to) {
      for (int i = 0; i < n; ++i) to[i] = LaneDual{} + from[i];
    };
    set(q0, nq_, q_);
    set(v0, nv_, q_ + nq_);
    set(a0, nv_, q_ + nq_ + nv_);
    base_ = value_->base();
  }

  /// The chain's values, and tables of its elastic bodies. Forces by state do not act yet: they go from one segment to
  /// another, and are differentiated by themselves.
  void move_value(const double* q, const double* v) {
    turn_hinges(value_->layout, 0, layout_.nodes, q, value_->state, value_->scratch);
    typename One::Ang w = One::zero_angular();
    typename One::Rot attitude = One::turn(0, 0.0, 1.0);
    for (int i = 0; i < layout_.nodes; ++i) {
      if (layout_.node[i].branch) value_->start_branch(i, w, attitude);
      value_->template move_node<true, true>(
          i, q, v, w, attitude, [&](const Node& node, const double* constants, const typename One::Lin& gravity) {
            value_->template bend_body<true>(node, constants, gravity, q + node.qe, v + node.ve, value_->state[i]);
            if (bodies_->has(i)) bodies_->tabulate(i, constants, q + node.qe, v + node.ve, *value_);
          });
    }
    if (layout_.by_state()) value_->by_state->find(*value_, q, v);
  }

  /// Whether one of D directions is an elastic coordinate of a node.
  bool bends(const Node& node, const int* direction) const {
    for (int k = 0; k < D; ++k)
      if (direction[k] >= node.qe && direction[k] < node.qe + node.ne) return true;
    return false;
  }

  // --- The ends of a segment. ---

  /// Numbers that move independently: the motion where a segment begins, and in `forces_` the forces on its seats.
  struct Ends {
    Ang w;
    Motion<Sp> a;
    Ang turn;  ///< of the frame, from where it stands
  };
  Ends ends_of(const Segment& s) const {
    Ends e;
    LaneDual* at = view<LaneDual>(&e);
    const auto put = [&](const auto& x) {
      const double* p = view<const double>(&x);
      for (std::size_t k = 0; k < sizeof(x) / sizeof(double); ++k) *at++ = LaneDual{} + p[k];
    };
    typename One::Ang w = One::zero_angular();
    typename One::Rot attitude;
    value_->start_branch(s.first, w, attitude);
    put(w);
    put(value_->seat_acceleration(s.first, base_));
    put(One::zero_angular());
    at = forces_;
    for (int seat = 0; seat < s.seats; ++seat) {
      Force<One> force = Force<One>::zero();
      for (int k = s.child; k >= 0; k = segment_[k].sibling)
        if (const int i = segment_[k].first; segment_[k].seat == seat)
          force += value_->to_parent(i, value_->state[i].force);
      put(force);
    }
    return e;
  }
  /// How the frame stands where a segment begins.
  typename Sp::Rot attitude_of(const Segment& s, const Ang& turn) const {
    typename One::Ang w;
    typename One::Rot R;
    value_->start_branch(s.first, w, R);
    return Sp::times(constant(R), small_turn(turn));
  }
  static Space<LaneDual>::Rot constant(const Space<double>::Rot& R) {
    const auto c = [](double x) { return LaneDual{} + x; };
    return {c(R.xx), c(R.xy), c(R.xz), c(R.yx), c(R.yy), c(R.yz), c(R.zx), c(R.zy), c(R.zz)};
  }
  static Plane<LaneDual>::Rot constant(const Plane<double>::Rot& R) { return {LaneDual{} + R.c, LaneDual{} + R.s}; }
  static Space<LaneDual>::Rot small_turn(const Space<LaneDual>::Ang& t) {
    const LaneDual one = number<LaneDual>(1.0);
    return {one, -t.z, t.y, t.z, one, -t.x, -t.y, t.x, one};
  }
  static Plane<LaneDual>::Rot small_turn(const Plane<LaneDual>::Ang& t) { return {number<LaneDual>(1.0), t.z}; }
  /// The small turn that R's slopes are, in its axes.
  static Space<LaneDual>::Ang turn_of(const Space<LaneDual>::Rot& R) {
    const auto along = [&](int i, int j) {
      const auto to = Space<LaneDual>::axis(R, i), of = Space<LaneDual>::axis(R, j);
      return to.x.x * of.x + to.y.x * of.y + to.z.x * of.z;
    };
    return {along(2, 1), along(0, 2), along(1, 0)};
  }
  static Plane<LaneDual>::Ang turn_of(const Plane<LaneDual>::Rot& R) { return {R.c.x * R.s - R.s.x * R.c}; }

  // --- Derivatives of a segment. ---

  /// Of all segments, where the chain is.
  void differentiate(const double* a) {
    value_->forces(base_, a, tau_);
    for (int k = 0; k < segments_; ++k) differentiate(segment_[k]);
    for (int k = segments_; k-- > 0;)
      if (segment_[k].parent >= 0) respond(k);
  }

  void differentiate(const Segment& s) {
    Ends ends = ends_of(s);
    LaneDual* const inputs = view<LaneDual>(&ends);
    const int from = s.parent >= 0 ? 0 : motion_, to = motion_ + s.seats * kForce;
    const auto input = [&](int k) {  // without attitudes no turn is asked for
      return k < motion_ ? inputs + k : forces_ + (k - motion_);
    };
    const auto number_of = [&](int column) -> LaneDual* {
      if (column < s.own) return s.direction[column] < 0 ? nullptr : q_ + s.direction[column];
      const int k = column - s.own + from;
      return k < to ? input(k) : nullptr;
    };
    for (int first = 0; first < s.stride(); first += D) {
      const auto seed = [&](double slope) {
        for (int k = 0; k < D; ++k)
          if (LaneDual* x = number_of(first + k)) x->d[k / FLEXARM_WIDTH][k % FLEXARM_WIDTH] = slope;
      };
      seed(1.0);
      sweep(s, first, ends);
      seed(0.0);
    }
  }

  /// Columns from `first` on, of which the slopes are set.
  void sweep(const Segment& s, int first, const Ends& ends) {
    double* row = s.matrix + first;
    const auto put = [&](const LaneDual& x) {
      __builtin_memcpy(row, x.d, sizeof(x.d));
      row += s.stride();
    };
    const auto put_all = [&](const auto& x) {
      const LaneDual* p = view<const LaneDual>(&x);
      for (std::size_t k = 0; k < sizeof(x) / sizeof(LaneDual); ++k) put(p[k]);
    };
    const LaneDual *q = q_, *v = q + nq_, *x = v + nv_;
    LaneDual* tau = q_ + nq_ + 2 * nv_;
    turn_hinges(layout_, s.first, s.end, q, dual_->state, dual_->scratch);
    Ang w = ends.w;
    Motion<Sp> a = ends.a;
    const Force<Sp>* force = view<Force<Sp>>(forces_);
    Force<Sp> F = s.on_end ? *force++ : Force<Sp>::zero();
    const Node& last = layout_.node[s.end - 1];
    for (int k = 0; k < last.slices; ++k) dual_->fork[last.slice[k]].template force<Sp>() = *force++;
    typename Sp::Rot attitude{};
    if (layout_.attitudes) attitude = attitude_of(s, ends.turn);
    for (int i = s.first; i < s.end; ++i)
      dual_->template move_node<true, true>(
          i, q, v, w, attitude, [&](const Node& node, const double* constants, const Lin& gravity) {
            bend(i, first < s.own && bends(node, s.direction + first), node, constants, gravity, q, v);
          });
    for (int i = s.first; i < s.end; ++i) dual_->accelerate_node(i, x, a);
    const auto put_motion = [&](const Ang& turning, const Motion<Sp>& acceleration, const typename Sp::Rot& stands) {
      put_all(turning);
      put_all(acceleration);
      if (layout_.attitudes) put_all(turn_of(stands));
    };
    if (s.on_end) put_motion(w, a, attitude);
    dual_->for_slices(last, [&](const auto& f) {
      if (layout_.attitudes) attitude = Sp::times(dual_->state[s.end - 1].attitude, f.slice.frame.R);
      put_motion(f.w, f.a, attitude);
    });
    for (int i = s.end; i-- > s.first;) {
      dual_->force_node(i, x, F, tau);
      if (layout_.node[i].parent >= 0) F = dual_->to_parent(i, F);
    }
    put_all(F);
    for (int k = 0; k < s.rates; ++k) put(tau[s.rate[k]]);
  }

  // --- The chain rule. ---

  const double* force_rows(const Segment& s) const { return s.matrix + s.seats * motion_ * s.stride(); }
  /// Columns by the forces on its seats.
  static int by_force(const Segment& s, int motion) { return s.own + (s.parent >= 0 ? motion : 0); }

  /// Of segment k and all that it carries, by the motion where it begins.
  void respond(int k) {
    const Segment& s = segment_[k];
    const double* rows = force_rows(s);
    for (int column = 0; column < s.inputs; column += D) {
      double* out = s.response + column;
      if (s.seats == 0) {
        add_product(rows + s.own + column, s.stride(), rows, 0, rows, 0, kForce + s.rates, 0, out, s.inputs);
        continue;
      }
      carry(k, s.matrix + s.own + column, s.stride(), carried_);
      add_product(rows + s.own + column, s.stride(), rows + by_force(s, motion_), s.stride(), carried_, D,
                  kForce + s.rates, s.seats * kForce, out, s.inputs);
    }
  }

  /// The forces on the seats of segment k, by the motion x there: of all that sits on it.
  void carry(int k, const double* x, int stride, double* forces) const {
    for (int i = 0; i < segment_[k].seats * kForce * D; ++i) forces[i] = 0.0;
    for (int i = segment_[k].child; i >= 0; i = segment_[i].sibling) {
      const Segment& s = segment_[i];
      double* force = forces + s.seat * kForce * D;
      add_product(force, D, s.response, s.inputs, x + s.seat * motion_ * stride, stride, kForce, motion_, force, D);
    }
  }

  /// All rows of segment k's own columns from `first` on, D to a row.
  void chain_rule(int k, int first, double* out) const {
    alignas(64) double F[2][kForce * D];
    const Segment& own = segment_[k];
    for (int i = 0; layout_.branched && i < nv_ * D; ++i) out[i] = 0.0;  // of other branches
    for (int i = k + 1; i < segments_; ++i) {                            // of those that it carries
      const Segment& s = segment_[i];
      behind_[i] = s.parent == k || (s.parent > k && behind_[s.parent]);
      if (!behind_[i]) continue;
      const int stride = s.parent == k ? own.stride() : D;
      const double* x = (s.parent == k ? own.matrix + first : segment_[s.parent].moved) + s.seat * motion_ * stride;
      put_rates(s, nullptr, 0, s.response + kForce * s.inputs, s.inputs, x, stride, motion_, out);
      add_product(nullptr, 0, s.matrix + s.own, s.stride(), x, stride, s.seats * motion_, motion_, s.moved, D);
    }
    carry(k, own.matrix + first, own.stride(), carried_);  // the change of the forces on its seats
    const double* rows = force_rows(own);
    const int force = by_force(own, motion_);
    const int n = own.seats * kForce;
    put_rates(own, rows + kForce * own.stride() + first, own.stride(), rows + kForce * own.stride() + force,
              own.stride(), carried_, D, n, out);
    add_product(rows + first, own.stride(), rows + force, own.stride(), carried_, D, kForce, n, F[0], D);
    for (int i = own.parent, seat = own.seat, turn = 0; i >= 0; seat = segment_[i].seat, i = segment_[i].parent) {
      const Segment& s = segment_[i];
      const double* G = force_rows(s) + by_force(s, motion_) + seat * kForce;
      put_rates(s, nullptr, 0, G + kForce * s.stride(), s.stride(), F[turn], D, kForce, out);
      add_product(nullptr, 0, G, s.stride(), F[turn], D, kForce, kForce, F[1 - turn], D);
      turn = 1 - turn;
    }
  }
  /// The rows of a segment's rates, which are consecutive within each node.
  static void put_rates(const Segment& s, const double* add, int add_stride, const double* A, int A_stride,
                        const double* B, int B_stride, int n, double* out) {
    for (int r = 0, count = 0; r < s.rates; r += count) {
      for (count = 1; r + count < s.rates && s.rate[r + count] == s.rate[r] + count;) ++count;
      add_product(add ? add + r * add_stride : nullptr, add_stride, A + r * A_stride, A_stride, B, B_stride, count, n,
                  out + s.rate[r] * D, D);
    }
  }

  /// Calls visit(directions) with D columns at a time in `columns_`.
  template <class Visit>
  void for_columns(const Visit& visit) {
    for (int k = 0; k < segments_; ++k)
      for (int first = 0; first < segment_[k].own; first += D) {
        chain_rule(k, first, columns_);
        visit(segment_[k].direction + first);
      }
  }
  /// The same of the generalised forces by state, G f.
  template <class Visit>
  void for_columns_by_state(bool by_v, const Visit& visit) {
    if (!layout_.by_state()) return;
    const int all = nq_ + (by_v ? nv_ : 0);
    ByState<C>& forces = *dual_->by_state;
    const LaneDual* v = q_ + nq_;
    for (int first = 0; first < all; first += D) {
      int direction[D];
      for (int k = 0; k < D; ++k) direction[k] = first + k < all ? first + k : -1;
      const auto seed = [&](double slope) {
        for (int k = 0; k < D && first + k < all; ++k) q_[first + k].d[k / FLEXARM_WIDTH][k % FLEXARM_WIDTH] = slope;
      };
      seed(1.0);
      move_dual(direction);
      forces.find(*dual_, q_, v);
      forces.gather(*dual_);
      if (layout_.loops > 0) {
        const Lin base = dual_->base();
        dual_->accelerate(base, v + nv_);
        forces.loops.accelerate(*dual_, forces.places, base, v + nv_);
        forces.loops.gather(*dual_);
      }
      for (int i = 0; i < nv_; ++i) {
        LaneDual sum{};
        for (int k = 0; k < forces.columns(layout_); ++k) sum += forces.force[k] * forces.G[k * nv_ + i];
        for (int k = 0; k < layout_.loop_rows; ++k) sum += forces.loops.row[k].force * forces.loops.G[k * nv_ + i];
        __builtin_memcpy(columns_ + i * D, sum.d, sizeof(sum.d));
      }
      seed(0.0);
      visit(direction);
    }
  }
  /// All frames, without forces.
  void move_dual(const int* direction) {
    const LaneDual *q = q_, *v = q + nq_;
    turn_hinges(layout_, 0, layout_.nodes, q, dual_->state, dual_->scratch);
    Ang w = Sp::zero_angular();
    typename Sp::Rot attitude = Sp::turn(0, LaneDual{}, number<LaneDual>(1.0));
    for (int i = 0; i < layout_.nodes; ++i) {
      if (layout_.node[i].branch) dual_->start_branch(i, w, attitude);
      dual_->template move_node<true, false>(i, q, v, w, attitude,
                                             [&](const Node& node, const double* constants, const Lin& gravity) {
                                               bend(i, bends(node, direction), node, constants, gravity, q, v);
                                             });
    }
  }
  void bend(int i, bool bends, const Node& node, const double* constants, const Lin& gravity, const LaneDual* q,
            const LaneDual* v) {
    if (bodies_->has(i))
      bodies_->look_up(i, bends, q + node.qe, v + node.ve, dual_->state[i]);
    else
      dual_->template bend_body<true>(node, constants, gravity, q + node.qe, v + node.ve, dual_->state[i]);
  }

  void put_loops(const int* direction, double* out) const {
    for (int k = 0; k < D && direction[k] >= 0; ++k) {
      double* to = out + direction[k] * layout_.rigid_rows;
      for (int n = 0; n < layout_.loop_rows; ++n)
        if (const auto& row = dual_->by_state->loops.row[n]; !row.soft) *to++ = slope_of(row.second, k);
    }
  }
  /// Adds to the columns by state the changes of accelerations that keep the loops closed where d^2 g/dt^2 changes.
  void keep_closed() {
    auto& values = value_->by_state->loops;
    for (int k = 0; k < D; ++k) {
      double* x = tau_;
      for (int i = 0; i < nv_; ++i) x[i] = columns_[i * D + k];
      for (int n = 0; n < layout_.loop_rows; ++n)
        values.row[n].second = slope_of(dual_->by_state->loops.row[n].second, k);
      values.close_accelerations(value_->layout, x);
      for (int i = 0; i < nv_; ++i) columns_[i * D + k] = x[i];
    }
  }

  /// Those of M^-1 times them, by the chain's factors, as many as a pack has lanes at a time.
  void solve_columns() {
    constexpr int W = FLEXARM_WIDTH;
    Pack *r = solved_, *x = r + nv_;
    for (double* first = columns_; first < columns_ + D; first += W) {
      for (int i = 0; i < nv_; ++i) r[i] = Lanes<Pack>::load(first + i * D);
      ::solve(*value_, r, x);
      for (int i = 0; i < nv_; ++i) Lanes<Pack>::store(first + i * D, x[i]);
    }
  }
  void put(const int* direction, const double* columns, double factor, double* by_q, double* by_v,
           bool add = false) const {
    for (int k = 0; k < D; ++k) {
      if (direction[k] < 0) continue;
      double* column = direction[k] < nq_ ? by_q + direction[k] * nv_ : by_v + (direction[k] - nq_) * nv_;
      for (int i = 0; i < nv_; ++i) column[i] = factor * columns[i * D + k] + (add ? column[i] : 0.0);
    }
  }

  const Layout& layout_;
  int nq_, nv_;
  int motion_;  ///< numbers of X: angular velocity, acceleration, angular acceleration, and the turn if it is asked for
  C* dual_;
  Value* value_;
  BodySlopes<Sp>* bodies_;
  LaneDual* q_;
  double* tau_;
  Segment* segment_;
  int segments_ = 0;
  double* columns_;  ///< D columns of all rates
  Pack* solved_;
  int most_seats_ = 0;  ///< of a segment
  LaneDual* forces_;    ///< on the seats of the one at hand
  double* carried_;     ///< their change, D columns
  bool* behind_;        ///< of each segment: whether the one at hand carries it
  typename One::Lin base_{};
};

}  // namespace
