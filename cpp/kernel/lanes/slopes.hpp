// The Jacobians of inverse dynamics, by dual numbers through the recursions of a chain, a segment of a few nodes at a
// time: its rows by its own coordinates and rates, by the motion X of the frame that it sits on, and by what its end
// carries, F. Between segments the chain rule remains: dX goes outward, dF inward, both by small matrices.
#pragma once

#include <new>

#include "lanes/elimination.hpp"
#include "lanes/tangent.hpp"

namespace {

/// Hands out memory in lines of the cache; from nowhere, it counts.
class Room {
 public:
  explicit Room(void* at) : begin_(static_cast<char*>(at)) {}
  template <class T>
  T* take(std::size_t count) {
    const std::size_t at = used_;
    used_ += (count * sizeof(T) + 63) / 64 * 64;
    return begin_ ? reinterpret_cast<T*>(begin_ + at) : nullptr;
  }
  std::size_t used() const { return used_; }

 private:
  char* begin_;
  std::size_t used_ = 0;
};

/// Columns are taken as many at a time as a dual number has directions.
constexpr int kTogetherColumns = kDirections;

/// out = add + A B, of so many rows of A, n columns of A, and kTogetherColumns of B. Strides are of rows.
inline void add_product(const double* add, int add_stride, const double* A, int A_stride, const double* B, int B_stride,
                        int rows, int n, double* out, int out_stride) {
  constexpr int W = FLEXARM_WIDTH, R = 4;
  const auto some = [&](auto count, int r, int column) {
    constexpr int C = decltype(count)::value;
    Pack sum[C];
#pragma GCC unroll 4
    for (int k = 0; k < C; ++k) sum[k] = add ? Lanes<Pack>::load(add + (r + k) * add_stride + column) : Pack{};
    for (int j = 0; j < n; ++j) {
      const Pack b = Lanes<Pack>::load(B + j * B_stride + column);
#pragma GCC unroll 4
      for (int k = 0; k < C; ++k) sum[k] += A[(r + k) * A_stride + j] * b;
    }
#pragma GCC unroll 4
    for (int k = 0; k < C; ++k) Lanes<Pack>::store(out + (r + k) * out_stride + column, sum[k]);
  };
  for (int column = 0; column < kTogetherColumns; column += W) {
    int r = 0;
    for (; r + R <= rows; r += R) some(sampled::Count<R>{}, r, column);
    for (; r < rows; ++r) some(sampled::Count<1>{}, r, column);
  }
}

using flexarm::lanes::SlopesOf;

constexpr int kBending = 4;  // elastic coordinates by which a body is differentiated at once

/// dtau/dq (nv x nq) and dtau/dv (nv x nv) of inverse dynamics; and of forward dynamics, by M^-1 of the chain.
template <class Sp>
class Slopes {
  using C = Chain<Sp, LaneDual>;
  using One = typename SpaceOf<Sp, double>::type;
  using Value = Chain<One, Pack>;
  using Bent = Chain<typename SpaceOf<Sp, Dual<double, double, kBending>>::type, Dual<Pack, Pack, kBending>>;
  using Lin = typename Sp::Lin;
  using Ang = typename Sp::Ang;
  static constexpr int D = kTogetherColumns;
  static constexpr int kForce = Sp::linear + Sp::angular;
  static constexpr int kMostMotion = 3 * Sp::angular + Sp::linear;
  static constexpr int kEnough = 2 * D;  ///< own columns of a segment

  /// Nodes in a row. Its matrix has rows of the motion of its end, of the force where it begins, and of its rates;
  /// columns of its own coordinates and rates, of the motion where it begins, and of the force on its end.
  struct Segment {
    int first, end;          ///< nodes
    int rates, own, inputs;  ///< rows of rates; columns, filled up to multiples of D
    int* rate;               ///< of each row
    int* direction;          ///< of each own column: a coordinate, or nq and a rate; -1: none
    double* matrix;
    double* response;  ///< by the motion where it begins, with all that follows: rows of force and of rates
    int stride() const { return own + inputs; }
  };

 public:
  static std::size_t memory(const SlopesOf& of) {
    Room room(nullptr);
    Slopes(of, room, true);
    return room.used();
  }
  Slopes(const SlopesOf& of, void* memory, bool by_v) : Slopes(of, Room(memory), by_v) {}

  /// Of inverse dynamics. @param by_v  null where it is not asked for
  void inverse(const double* wrenches, const double* q, const double* v, const double* a, double* by_q, double* by_v) {
    begin(wrenches, q, v, a);
    move_value(q, v);
    differentiate(a);
    for_columns([&](const int* direction) { put(direction, columns_, 1.0, by_q, by_v); });
  }

  /// Of forward dynamics, whose accelerations go into a. @return what became of it
  Outcome forward(const double* wrenches, const double* q, const double* v, const double* tau, double* a, double* by_q,
                  double* by_v, double* by_tau) {
    begin(wrenches, q, v, a);
    move_value(q, v);
    const bool good = inward<true, true, true>(*value_, tau, a, Shift{});
    outward<true>(*value_, base_, a);
    if (!good) return outcome(*value_, good);
    for (int i = 0; i < nv_; ++i) q_[nq_ + nv_ + i].x = a[i];
    differentiate(a);
    for_columns([&](const int* direction) {
      solve_columns();
      put(direction, columns_, -1.0, by_q, by_v);
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
  Slopes(const SlopesOf& of, Room&& room, bool by_v) : Slopes(of, room, by_v) {}
  Slopes(const SlopesOf& of, Room& room, bool by_v)
      : layout_(of.layout),
        nq_(layout_.nq),
        nv_(layout_.nv),
        motion_((layout_.attitudes ? 3 : 2) * Sp::angular + Sp::linear) {
    dual_ = make<C>(layout_, of.numbers, room);
    value_ = make<Value>(of.grouped, of.grouped_numbers, room);
    bent_ = make<Bent>(of.grouped, of.grouped_numbers, room);
    bent_q_ = room.take<typename Bent::S>(2 * C::most_elastic(layout_));
    q_ = room.take<LaneDual>(static_cast<std::size_t>(nq_ + 3 * nv_));  // and v, a, tau
    tau_ = room.take<double>(static_cast<std::size_t>(nv_));
    table_ = room.take<Table>(static_cast<std::size_t>(layout_.nodes));
    still_ = room.take<bool>(static_cast<std::size_t>(layout_.nodes));
    work_ = room.take<double>(2 * C::most_elastic(layout_));
    for (int i = 0; i < layout_.nodes; ++i) {
      const Table t = table_of(layout_, layout_.node[i], room);
      if (!table_) continue;
      table_[i] = t;
      still_[i] = false;
    }
    segment_ = room.take<Segment>(static_cast<std::size_t>(layout_.nodes));
    for (int first = 0; first < layout_.nodes; ++segments_) {
      int end = first, columns = 0;
      while (end < layout_.nodes) {
        const int more = columns_of(layout_.node[end], by_v);
        if (end > first && !layout_.node[end].coincident && columns + more > kEnough) break;
        columns += more;
        ++end;
      }
      lay_out(first, end, columns, by_v, room);
      first = end;
    }
    columns_ = room.take<double>(static_cast<std::size_t>(D * nv_));
    solved_ = room.take<Pack>(static_cast<std::size_t>(2 * nv_));
  }
  template <class Any>
  static Any* make(const Layout& layout, const double* numbers, Room& room) {
    Any* chain = room.take<Any>(1);
    void* memory = room.take<char>(Any::memory_needed(layout));
    return chain ? new (chain) Any(layout, numbers, memory) : nullptr;
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

  void lay_out(int first, int end, int columns, bool by_v, Room& room) {
    Segment s{first, end, 0, filled(columns), 0, nullptr, nullptr, nullptr, nullptr};
    for (int i = first; i < end; ++i) s.rates += layout_.node[i].ne + (layout_.node[i].kind != Node::fixed);
    s.inputs = filled((first > 0 ? motion_ : 0) + (end < layout_.nodes ? kForce : 0));
    s.rate = room.take<int>(static_cast<std::size_t>(s.rates));
    s.direction = room.take<int>(static_cast<std::size_t>(s.own));
    s.matrix = room.take<double>(static_cast<std::size_t>((motion_ + kForce + s.rates) * s.stride()));
    s.response = room.take<double>(static_cast<std::size_t>((kForce + s.rates) * s.inputs));
    if (!s.rate) return;  // counting
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
    const double* p = value_->numbers;
    base_ = One::read(p);
    for (int i = 0; i < layout_.nodes; ++i) still_[i] = false;
  }

  /// The chain's values, and what rates change of its elastic bodies.
  void move_value(const double* q, const double* v) {
    turn_hinges(value_->layout, 0, layout_.nodes, q, value_->state, value_->scratch);
    typename One::Ang w = One::zero_angular();
    typename One::Rot attitude = One::turn(0, 0.0, 1.0);
    for (int i = 0; i < layout_.nodes; ++i)
      value_->template move_node<true, true>(
          i, q, v, w, attitude, [&](const Node& node, const double* constants, const typename One::Lin& gravity) {
            value_->template bend_body<true>(node, constants, gravity, q + node.qe, v + node.ve, value_->state[i]);
            if (!table_[i].at) return;
            tabulate(i, constants, q + node.qe, v + node.ve);
            bend_slowly(i, constants, q + node.qe, v + node.ve);
          });
  }

  // --- What its elastic coordinates q change of a body: everything. ---

  /// visit(numbers, count) for what does not depend on rates, and then for f, n, e and the end's u_dot, u_bias, turning
  /// and turn_bias.
  template <class Any, class Visit>
  static void for_parts(State<Any>& s, int ne, const Visit& visit) {
    using T = typename Any::Scalar;
    const auto put = [&](auto& x, int count) {
      visit(reinterpret_cast<T*>(&x), count * static_cast<int>(sizeof(x) / sizeof(T)));
    };
    Elastic<Any>& e = s.elastic;
    put(s.body, 1);
    put(e.end.R, 1);
    put(e.end.x, 1);
    put(*e.end.J_linear, ne);
    put(*e.end.J_angular, ne);
    put(*e.M_linear, ne);
    put(*e.M_angular, ne);
    put(*e.M, packed(ne, 0));
    put(s.body_f, 1);
    put(s.body_n, 1);
    put(*e.e, ne);
    put(e.end.u_dot, 1);
    put(e.end.u_bias, 1);
    put(e.end.turning, 1);
    put(e.end.turn_bias, 1);
  }
  static int still_parts(int ne) {
    return static_cast<int>((sizeof(typename One::Rigid) + sizeof(typename One::Rot) + sizeof(typename One::Lin)) /
                            sizeof(double)) +
           2 * kForce * ne + packed(ne, 0);
  }

  /// By dual numbers through the body, points in the lanes, so many directions at a time.
  void bend_slowly(int i, const double* constants, const double* q0, const double* dq0) {
    using B = typename Bent::S;
    const Node& node = bent_->layout.node[i];
    auto& s = bent_->state[i];
    const int ne = node.ne;
    B *q = bent_q_, *dq = q + ne;
    for (int k = 0; k < ne; ++k) {
      q[k] = B{} + q0[k];
      dq[k] = B{} + dq0[k];
    }
    for (int k = 0; k < Sp::angular; ++k)
      reinterpret_cast<B*>(&s.w)[k] = B{} + reinterpret_cast<const double*>(&value_->state[i].w)[k];
    for (int first = 0; first < ne; first += kBending) {
      const int count = ne - first < kBending ? ne - first : kBending;
      for (int k = 0; k < count; ++k) q[first + k].d[k] = 1.0;
      bent_->template bend_body<true>(node, constants, Bent::Space::zero(), q, dq, s);
      for (int k = 0; k < count; ++k) q[first + k].d[k] = 0.0;
      double* row = table_[i].by_q + first;
      for_parts(s, ne, [&](const B* x, int n) {
        for (int r = 0; r < n; ++r, row += ne)
          for (int k = 0; k < count; ++k) row[k] = x[r].d[k];
      });
    }
  }

  // --- What an elastic body's rates dq and angular velocity w change, as long as it is where it is: its forces, which
  // are quadratic in both, and how they move its end. ---

  /// Rows of f, n, e and the end's u_dot, u_bias, turning and turn_bias; columns by dq and w.
  struct Table {
    double *at, *by_q, *values;  ///< the latter two: of all parts of the body
    int rows, columns;
  };
  static bool has_table(const Layout& layout, const Node& node) {
    if (node.ne == 0) return false;
    if (node.body == Node::quadratic) return true;
    if (node.body != Node::sampled || !(Sp::planar || node.exact)) return false;
    for (int k = 0; k < node.loads; ++k)  // slices are moved where the body was sampled
      if (layout.load[node.load[k]].place.on == Place::slice) return false;
    return true;
  }
  static Table table_of(const Layout& layout, const Node& node, Room& room) {
    Table t{nullptr, nullptr, nullptr, 0, 0};
    if (!has_table(layout, node)) return t;
    t.rows = kForce + node.ne + 2 * kForce;
    t.columns = node.ne + Sp::angular;
    t.at = room.take<double>(static_cast<std::size_t>(t.rows * t.columns));
    t.values = room.take<double>(static_cast<std::size_t>(still_parts(node.ne) + t.rows));
    t.by_q = room.take<double>(static_cast<std::size_t>((still_parts(node.ne) + t.rows) * node.ne));
    return t;
  }
  /// What a table has rows of.
  template <class Any>
  struct Moved {
    typename Any::Lin f;
    typename Any::Ang n;
    typename Any::Lin u_dot, u_bias;
    typename Any::Ang turning, turn_bias;
    static Moved of(const typename Any::Lin& f, const typename Any::Ang& n, const Slice<Any>& end) {
      return {f, n, end.u_dot, end.u_bias, end.turning, end.turn_bias};
    }
  };
  /// visit(row, number) for f, n and e, and for those of the end.
  template <class Any, class Visit>
  static void for_rows(Moved<Any>& moved, typename Any::Scalar* e, int ne, const Visit& visit) {
    typename Any::Scalar* x = reinterpret_cast<typename Any::Scalar*>(&moved);
    for (int k = 0; k < kForce; ++k) visit(k, x[k]);
    for (int k = 0; k < ne; ++k) visit(kForce + k, e[k]);
    for (int k = 0; k < 2 * kForce; ++k) visit(kForce + ne + k, x[kForce + k]);
  }

  static double trace(const Space<double>::Sym& J) { return J.xx + J.yy + J.zz; }
  static double trace(const Plane<double>::Sym& J) { return J.zz; }
  /// By central differences, which are exact of what is quadratic, over steps of as much kinetic energy as there is.
  void tabulate(int i, const double* constants, const double* q, const double* dq) {
    const Node& node = value_->layout.node[i];
    const Table& t = table_[i];
    auto& s = value_->state[i];
    const int ne = node.ne;
    const auto put = [&](int column, double factor, Moved<One> moved, double* e) {
      for_rows<One>(moved, e, ne, [&](int r, double x) { t.at[r * t.columns + column] += factor * x; });
    };
    for (int k = 0; k < t.rows * t.columns; ++k) t.at[k] = 0.0;
    double* value = t.values;
    for_parts(s, ne, [&](const double* x, int n) {
      for (int r = 0; r < n; ++r) *value++ = x[r];
    });
    double *rates = work_, *e = rates + ne;
    typename One::Ang w = s.w;
    for (int k = 0; k < ne; ++k) rates[k] = dq[k];
    const double J = trace(s.body.J);
    double energy = J * One::dot(w, w);
    for (int k = 0; k < ne; ++k) energy += s.elastic.M[packed(k, k)] * dq[k] * dq[k];
    Elastic<One> moved = s.elastic;
    moved.e = e;
    for (int column = 0; column < ne + Sp::angular; ++column) {
      double& x = column < ne ? rates[column] : reinterpret_cast<double*>(&w)[column - ne];
      const double at = x, step2 = energy / (column < ne ? s.elastic.M[packed(column, column)] : J);
      const double step = step2 > 1e-200 && step2 < 1e200 ? __builtin_sqrt(step2) : 1.0;
      for (double sign = 1.0; sign > -2.0; sign -= 2.0) {
        typename One::Lin f;
        typename One::Ang n;
        x = at + sign * step;
        value_->bend_again(node, constants, q, rates, w, f, n, moved);
        put(column, sign * 0.5 / step, Moved<One>::of(f, n, moved.end), e);
      }
      x = at;
    }
    if (node.body == Node::quadratic) tabulate_end(i);
    if (!node.damped) return;
    for (int k = 0; k < ne; ++k) {
      for (int j = 0; j < ne; ++j) rates[j] = e[j] = 0.0;
      rates[k] = 1.0;
      add_elastic_forces(node, s.elastic.constants, e, rates, e);
      for (int j = 0; j < ne; ++j) t.at[(kForce + j) * t.columns + k] += e[j];
    }
  }
  /// The end of a quadratic body, whose slices do not need its points.
  void tabulate_end(int i) {
    const Node& node = layout_.node[i];
    const Table& t = table_[i];
    Elastic<Sp>& e = dual_->state[i].elastic;
    LaneDual* dq = q_ + nq_ + node.ve;
    for_directions(dq, node.ne, [&](int first, int count) {
      move_slice(node, dual_->numbers + node.end, q_ + node.qe, dq, e.end);
      Moved<Sp> moved = Moved<Sp>::of(Sp::zero(), Sp::zero_angular(), e.end);
      for_rows<Sp>(moved, nullptr, 0, [&](int r, const LaneDual& x) {
        if (r >= kForce)
          for (int k = 0; k < count; ++k) t.at[(r + node.ne) * t.columns + first + k] = slope_of(x, k);
      });
    });
  }
  static void add_slopes(double factor, const LaneDual& from, LaneDual& to) {
    for (int k = 0; k < kDirections / FLEXARM_WIDTH; ++k) to.d[k] += factor * from.d[k];
  }
  /// The body of node i and its end slice, from what was tabulated; what rates do not change is set already where it is
  /// `still`.
  void look_up(int i, bool bends, const LaneDual* q, const LaneDual* dq) {
    const Node& node = layout_.node[i];
    const Table& t = table_[i];
    State<Sp>& s = dual_->state[i];
    const LaneDual* w = reinterpret_cast<const LaneDual*>(&s.w);
    const int ne = node.ne, parts = still_parts(ne);
    const double *values = t.values, *by_q = t.by_q, *row = t.at;
    int part = 0;
    for_parts(s, ne, [&](LaneDual* x, int n) {
      if (part < parts && !bends && still_[i]) {
        part += n;
        return;
      }
      for (int r = 0; r < n; ++r, ++part) {
        LaneDual y = LaneDual{} + values[part];
        if (bends)
          for (int k = 0; k < ne; ++k) add_slopes(by_q[part * ne + k], q[k], y);
        if (part >= parts) {
          for (int k = 0; k < ne; ++k) add_slopes(row[k], dq[k], y);
          for (int k = 0; k < Sp::angular; ++k) add_slopes(row[ne + k], w[k], y);
          row += t.columns;
        }
        x[r] = y;
      }
    });
    still_[i] = !bends;
  }
  /// Whether one of D directions is an elastic coordinate of a node.
  bool bends(const Node& node, const int* direction) const {
    for (int k = 0; k < D; ++k)
      if (direction[k] >= node.qe && direction[k] < node.qe + node.ne) return true;
    return false;
  }

  // --- The ends of a segment. ---

  /// Numbers that move independently: the motion where a segment begins, and the force on its end.
  struct Ends {
    Ang w;
    Lin a;
    Ang dw;
    Ang turn;  ///< of the frame, from where it stands
    Lin f;
    Ang n;
  };
  Ends ends_of(const Segment& s) const {
    Ends e;
    LaneDual* at = reinterpret_cast<LaneDual*>(&e);
    const auto put = [&](const auto& x) {
      const double* p = reinterpret_cast<const double*>(&x);
      for (std::size_t k = 0; k < sizeof(x) / sizeof(double); ++k) *at++ = LaneDual{} + p[k];
    };
    typename One::Lin a = base_, f = One::zero();
    typename One::Ang w = One::zero_angular(), dw = w, n = w;
    if (s.first > 0) {
      const auto& before = value_->state[s.first - 1];
      const bool bent = layout_.node[s.first - 1].ne > 0;
      w = bent ? before.end_w : before.w;
      a = bent ? before.end_a : before.a;
      dw = bent ? before.end_dw : before.dw;
    }
    if (s.end < layout_.nodes) {
      f = value_->state[s.end].f;
      n = value_->state[s.end].n;
      value_->carry_inward(s.end, f, n);
    }
    put(w);
    put(a);
    put(dw);
    put(One::zero_angular());
    put(f);
    put(n);
    return e;
  }
  /// How the frame stands where a segment begins.
  typename Sp::Rot attitude_of(const Segment& s, const Ang& turn) const {
    typename One::Rot R = One::turn(0, 0.0, 1.0);
    if (s.first > 0) {
      const auto& before = value_->state[s.first - 1];
      R = before.attitude;
      if (layout_.node[s.first - 1].ne > 0) R = One::times(R, before.elastic.end.R);
    }
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
    for (int k = segments_; k-- > 1;) respond(k);
  }

  void differentiate(const Segment& s) {
    Ends ends = ends_of(s);
    LaneDual* const inputs = reinterpret_cast<LaneDual*>(&ends);
    const int from = s.first > 0 ? 0 : motion_, to = motion_ + (s.end < layout_.nodes ? kForce : 0);
    const auto input = [&](int k) {  // without attitudes no turn is asked for
      return inputs + (k < motion_ ? k : k - motion_ + kMostMotion);
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
      const LaneDual* p = reinterpret_cast<const LaneDual*>(&x);
      for (std::size_t k = 0; k < sizeof(x) / sizeof(LaneDual); ++k) put(p[k]);
    };
    const LaneDual *q = q_, *v = q + nq_, *x = v + nv_;
    LaneDual* tau = q_ + nq_ + 2 * nv_;
    turn_hinges(layout_, s.first, s.end, q, dual_->state, dual_->scratch);
    Ang w = ends.w, dw = ends.dw;
    Lin a = ends.a, f = ends.f;
    Ang n = ends.n;
    typename Sp::Rot attitude{};
    if (layout_.attitudes) attitude = attitude_of(s, ends.turn);
    for (int i = s.first; i < s.end; ++i)
      dual_->template move_node<true, true>(
          i, q, v, w, attitude, [&](const Node& node, const double* constants, const Lin& gravity) {
            if (table_[i].at)
              look_up(i, first < s.own && bends(node, s.direction + first), q + node.qe, v + node.ve);
            else
              dual_->template bend_body<true>(node, constants, gravity, q + node.qe, v + node.ve, dual_->state[i]);
          });
    for (int i = s.first; i < s.end; ++i) dual_->accelerate_node(i, x, a, dw);
    put_all(w);
    put_all(a);
    put_all(dw);
    if (layout_.attitudes) put_all(turn_of(attitude));
    for (int i = s.end; i-- > s.first;) {
      dual_->force_node(i, x, f, n, tau);
      if (i > 0) dual_->carry_inward(i, f, n);
    }
    put_all(f);
    put_all(n);
    for (int k = 0; k < s.rates; ++k) put(tau[s.rate[k]]);
  }

  // --- The chain rule. ---

  const double* force_rows(const Segment& s) const { return s.matrix + motion_ * s.stride(); }
  /// Columns by the force on its end.
  static int by_force(const Segment& s, int motion) { return s.own + (s.first > 0 ? motion : 0); }

  /// Of segment k and all that follows it, by the motion where it begins.
  void respond(int k) {
    const Segment& s = segment_[k];
    const double* rows = force_rows(s);
    for (int column = 0; column < s.inputs; column += D) {
      double* out = s.response + column;
      if (k + 1 == segments_) {
        add_product(rows + s.own + column, s.stride(), rows, 0, rows, 0, kForce + s.rates, 0, out, s.inputs);
        continue;
      }
      const Segment& next = segment_[k + 1];
      alignas(64) double force[kForce * D];
      add_product(nullptr, 0, next.response, next.inputs, s.matrix + s.own + column, s.stride(), kForce, motion_, force,
                  D);
      add_product(rows + s.own + column, s.stride(), rows + by_force(s, motion_), s.stride(), force, D,
                  kForce + s.rates, kForce, out, s.inputs);
    }
  }

  /// All rows of segment k's own columns from `first` on, D to a row.
  void chain_rule(int k, int first, double* out) const {
    alignas(64) double X[2][kMostMotion * D], F[2][kForce * D];
    const Segment& own = segment_[k];
    const double* carried = nullptr;  // the change of the force on its end
    if (k + 1 < segments_) {
      const Segment& next = segment_[k + 1];
      add_product(nullptr, 0, next.response, next.inputs, own.matrix + first, own.stride(), kForce, motion_, F[1], D);
      carried = F[1];
      const double* x = own.matrix + first;
      int stride = own.stride(), turn = 0;
      for (int i = k + 1; i < segments_; ++i) {
        const Segment& s = segment_[i];
        put_rates(s, nullptr, 0, s.response + kForce * s.inputs, s.inputs, x, stride, motion_, out);
        if (i + 1 == segments_) break;
        add_product(nullptr, 0, s.matrix + s.own, s.stride(), x, stride, motion_, motion_, X[turn], D);
        x = X[turn];
        stride = D;
        turn = 1 - turn;
      }
    }
    const double* rows = force_rows(own);
    const int force = by_force(own, motion_);
    const int n = carried ? kForce : 0;
    put_rates(own, rows + kForce * own.stride() + first, own.stride(), rows + kForce * own.stride() + force,
              own.stride(), carried, D, n, out);
    add_product(rows + first, own.stride(), rows + force, own.stride(), carried, D, kForce, n, F[0], D);
    for (int i = k, turn = 0; i-- > 0; turn = 1 - turn) {
      const Segment& s = segment_[i];
      const double* G = force_rows(s) + by_force(s, motion_);
      put_rates(s, nullptr, 0, G + kForce * s.stride(), s.stride(), F[turn], D, kForce, out);
      add_product(nullptr, 0, G, s.stride(), F[turn], D, kForce, kForce, F[1 - turn], D);
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
  void put(const int* direction, const double* columns, double factor, double* by_q, double* by_v) const {
    for (int k = 0; k < D; ++k) {
      if (direction[k] < 0) continue;
      double* column = direction[k] < nq_ ? by_q + direction[k] * nv_ : by_v + (direction[k] - nq_) * nv_;
      for (int i = 0; i < nv_; ++i) column[i] = factor * columns[i * D + k];
    }
  }

  const Layout& layout_;
  int nq_, nv_;
  int motion_;  ///< numbers of X: angular velocity, acceleration, angular acceleration, and the turn if it is asked for
  C* dual_;
  Value* value_;
  Bent* bent_;
  typename Bent::S* bent_q_;
  LaneDual* q_;
  double* tau_;
  Table* table_;  ///< of each node
  bool* still_;   ///< of each node: what coordinates change of its body is set in the dual chain, and does not change
  double* work_;
  Segment* segment_;
  int segments_ = 0;
  double* columns_;  ///< D columns of all rates
  Pack* solved_;
  typename One::Lin base_{};
};

}  // namespace
