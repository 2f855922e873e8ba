// Derivatives of an elastic body by its coordinates q, their rates dq and the angular velocity w of its frame: all
// that the chain asks of it depends on these alone. So it is differentiated once, by the text of its kind, and looked
// up in all directions in which the chain then is.
#pragma once

#include <new>

#include "door/kernels.hpp"
#include "slopes/columns.hpp"
#include "slopes/tangent.hpp"

namespace {

using flexarm::lanes::SlopesOf;

template <class Any>
Any* make_chain(const Layout& layout, const double* numbers, Arena& arena) {
  Any* chain = arena.take_lines<Any>(1);
  arena.take_lines<char>(0);  // a chain's memory begins a line
  const Any made(layout, numbers, arena);
  return chain ? new (chain) Any(made) : nullptr;
}

template <class Sp>
class BodySlopes {
  static constexpr int kAtOnce = 4;  ///< coordinates by which a body is differentiated
  using One = typename SpaceOf<Sp, double>::type;
  using Value = Chain<One, Pack>;
  using Bent = Chain<typename SpaceOf<Sp, Dual<double, double, kAtOnce>>::type, Dual<Pack, Pack, kAtOnce>>;
  using B = typename Bent::S;
  static constexpr int kForce = Sp::linear + Sp::angular;

  /// Numbers of a body: those that rates do not change, and then the others.
  struct Table {
    double *values, *by_q;  ///< of all; rows of ne
    double* by_rates;       ///< rows of the others, by dq and w
    int still, moving;      ///< how many
    bool known;             ///< the former are set in the chain where this is looked up, and have no slopes
  };

 public:
  BodySlopes(const SlopesOf& of, Arena& arena) : layout_(of.layout) {
    const std::size_t most = static_cast<std::size_t>(Bent::most_elastic(layout_));
    bent_ = make_chain<Bent>(of.grouped, of.grouped_numbers, arena);
    q_ = arena.take_lines<B>(2 * most);  // and dq
    work_ = arena.take_lines<double>(2 * most);
    table_ = arena.take_lines<Table>(static_cast<std::size_t>(layout_.nodes));
    for (int i = 0; i < layout_.nodes; ++i) {
      const Table t = table_of(layout_.node[i], arena);
      if (table_) table_[i] = t;
    }
  }

  /// Whether a node has such a body. Others are differentiated with the chain.
  bool has(int i) const { return table_[i].values != nullptr; }

  /// Of the body of node i, which `value` has just bent to q and dq. `dual` and its coordinates from `dual_q` on, and
  /// rates, are those that `look_up` is for.
  void tabulate(int i, const double* constants, const double* q, const double* dq, Value& value, State<Sp>& dual,
                const LaneDual* dual_q, LaneDual* dual_dq) {
    const Node& node = value.layout.node[i];
    State<One>& s = value.state[i];
    Table& t = table_[i];
    t.known = false;
    double* values = t.values;
    for_parts(s, node.ne, [&](const double* x, int n) {
      for (int r = 0; r < n; ++r) *values++ = x[r];
    });
    by_rates(node, t, constants, q, dq, value, s);
    if (node.body == Node::quadratic_beam)
      end_by_rates(node, t, dual.elastic, dual_q, dual_dq, value.numbers + node.end);
    by_coordinates(i, constants, q, dq, s.w);
  }

  /// The body of node i and its end slice. @param bends  whether q has slopes
  void look_up(int i, bool bends, const LaneDual* q, const LaneDual* dq, State<Sp>& s) {
    Table& t = table_[i];
    const LaneDual* w = reinterpret_cast<const LaneDual*>(&s.w);
    const int ne = layout_.node[i].ne;
    const double *value = t.values, *by_q = t.by_q, *by_rates = t.by_rates;
    for_parts(s, ne, [&](LaneDual* x, int n) {
      const bool still = value < t.values + t.still;
      if (still && !bends && t.known) {
        value += n;
        by_q += n * ne;
        return;
      }
      for (int r = 0; r < n; ++r, by_q += ne) {
        LaneDual y = LaneDual{} + *value++;
        for (int k = 0; k < ne && bends; ++k) add_slopes(by_q[k], q[k], y);
        for (int k = 0; k < ne && !still; ++k) add_slopes(*by_rates++, dq[k], y);
        for (int k = 0; k < Sp::angular && !still; ++k) add_slopes(*by_rates++, w[k], y);
        x[r] = y;
      }
    });
    t.known = !bends;
  }

 private:
  Table table_of(const Node& node, Arena& arena) const {
    Table t{nullptr, nullptr, nullptr, 0, 0, false};
    if (!tabulated(node)) return t;
    const int ne = node.ne;
    t.still = static_cast<int>((sizeof(typename One::Rigid) + sizeof(Frame<One>)) / sizeof(double)) + 2 * kForce * ne +
              packed(ne, 0);
    t.moving = 3 * kForce + ne;
    const auto take = [&](int n) { return arena.take_lines<double>(static_cast<std::size_t>(n)); };
    t.values = take(t.still + t.moving);
    t.by_q = take((t.still + t.moving) * ne);
    t.by_rates = take(t.moving * (ne + Sp::angular));
    return t;
  }
  bool tabulated(const Node& node) const {
    if (node.ne == 0) return false;
    if (node.body == Node::quadratic_beam) return true;
    if (node.body != Node::sampled_beam || !(Sp::planar || node.sampled.exact)) return false;
    for (int k = 0; k < node.loads; ++k)  // whose slices are moved where the body was sampled
      if (layout_.load[node.load[k]].place.on == Place::slice) return false;
    return true;
  }

  /// visit(numbers, count) for the numbers of a body that rates do not change, and then for the others.
  template <class Any, class Visit>
  static void for_parts(State<Any>& s, int ne, const Visit& visit) {
    using T = typename Any::Scalar;
    Elastic<Any>& e = s.elastic;
    pass<T>(s.body, 1, visit);
    pass<T>(e.end.frame, 1, visit);
    pass<T>(*e.end.J, ne, visit);
    pass<T>(*e.M_er, ne, visit);
    pass<T>(*e.M, packed(ne, 0), visit);
    for_moving(s.body_force, e, ne, visit);
  }
  template <class Any, class Visit>
  static void for_moving(Force<Any>& F, Elastic<Any>& e, int ne, const Visit& visit) {
    using T = typename Any::Scalar;
    pass<T>(F, 1, visit);
    pass<T>(*e.e, ne, visit);
    pass<T>(e.end.rate, 1, visit);
    pass<T>(e.end.bias, 1, visit);
  }
  template <class T, class X, class Visit>
  static void pass(X& x, int count, const Visit& visit) {
    visit(reinterpret_cast<T*>(&x), count * static_cast<int>(sizeof(x) / sizeof(T)));
  }

  // --- By rates: forces are quadratic in them. ---

  static double trace(const Space<double>::Sym& J) { return J.xx + J.yy + J.zz; }
  static double trace(const Plane<double>::Sym& J) { return J.zz; }

  /// By central differences, which are exact for quadratic functions, over steps of as much kinetic energy as there is.
  void by_rates(const Node& node, const Table& t, const double* constants, const double* q, const double* dq,
                Value& value, const State<One>& s) {
    const int ne = node.ne, columns = ne + Sp::angular;
    double *rates = work_, *e = rates + ne;
    for (int k = 0; k < ne; ++k) rates[k] = dq[k];
    typename One::Ang w = s.w;
    const double J = trace(s.body.J);
    double energy = J * One::dot(w, w);
    for (int k = 0; k < ne; ++k) energy += s.elastic.M[packed(k, k)] * dq[k] * dq[k];
    Elastic<One> moved = s.elastic;
    moved.e = e;
    for (int k = 0; k < t.moving * columns; ++k) t.by_rates[k] = 0.0;
    for (int column = 0; column < columns; ++column) {
      double& x = column < ne ? rates[column] : reinterpret_cast<double*>(&w)[column - ne];
      const double at = x, square = energy / (column < ne ? s.elastic.M[packed(column, column)] : J);
      const double step = square > 1e-200 && square < 1e200 ? __builtin_sqrt(square) : 1.0;
      for (int side = 1; side >= -1; side -= 2) {
        Force<One> F;
        x = at + side * step;
        value.bend_again(node, constants, q, rates, w, F, moved);
        double* to = t.by_rates + column;
        for_moving(F, moved, ne, [&](const double* number, int count) {
          for (int r = 0; r < count; ++r, to += columns) *to += (0.5 * side / step) * number[r];
        });
      }
      x = at;
    }
    if (!node.damped) return;
    for (int k = 0; k < ne; ++k) {
      for (int j = 0; j < ne; ++j) rates[j] = e[j] = 0.0;
      rates[k] = 1.0;
      add_elastic_forces(node, s.elastic.constants, e, rates, e);  // of damping; of stiffness, none
      for (int j = 0; j < ne; ++j) t.by_rates[(kForce + j) * columns + k] += e[j];
    }
  }
  /// The end of a quadratic body, which is moved without its points.
  void end_by_rates(const Node& node, const Table& t, Elastic<Sp>& e, const LaneDual* q, LaneDual* dq,
                    const double* numbers) {
    const int columns = node.ne + Sp::angular;
    for_directions(dq, node.ne, [&](int first, int count) {
      move_slice(node, numbers, q, dq, e.end);
      Force<Sp> F = Force<Sp>::zero();
      double *to = t.by_rates + first, *of_end = to + (kForce + node.ne) * columns;
      for_moving(F, e, node.ne, [&](const LaneDual* x, int numbers_of) {
        for (int r = 0; r < numbers_of; ++r, to += columns)
          for (int k = 0; k < count && to >= of_end; ++k) to[k] = slope_of(x[r], k);
      });
    });
  }

  // --- By coordinates: everything, points in the lanes, some directions at a time. ---

  void by_coordinates(int i, const double* constants, const double* q0, const double* dq0, const typename One::Ang& w) {
    const Node& node = bent_->layout.node[i];
    State<typename Bent::Space>& s = bent_->state[i];
    const int ne = node.ne;
    B *q = q_, *dq = q + ne;
    for (int k = 0; k < ne; ++k) {
      q[k] = B{} + q0[k];
      dq[k] = B{} + dq0[k];
    }
    for (int k = 0; k < Sp::angular; ++k) reinterpret_cast<B*>(&s.w)[k] = B{} + reinterpret_cast<const double*>(&w)[k];
    for (int first = 0; first < ne; first += kAtOnce) {
      const int count = ne - first < kAtOnce ? ne - first : kAtOnce;
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

  const Layout& layout_;
  Bent* bent_;
  B* q_;
  double* work_;
  Table* table_;
};

}  // namespace
