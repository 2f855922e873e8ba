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
  static constexpr int kAtOnce = kFew;  ///< coordinates by which a body is differentiated
  using One = typename SpaceOf<Sp, double>::type;
  using Value = Chain<One, Pack>;
  using Bent = Chain<typename SpaceOf<Sp, Few>::type, FewPacks>;
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
    table_ = arena.take_lines<Table>(static_cast<std::size_t>(layout_.nodes));
    for (int i = 0; i < layout_.nodes; ++i) {
      const Table t = table_of(layout_.node[i], arena);
      if (table_) table_[i] = t;
    }
  }

  /// Whether a node has such a body. Others are differentiated with the chain.
  bool has(int i) const { return table_[i].values != nullptr; }

  /// Of the body of node i, which `value` has just bent to q and dq.
  void tabulate(int i, const double* constants, const double* q, const double* dq, Value& value) {
    const Node& node = value.layout.node[i];
    State<One>& s = value.state[i];
    Table& t = table_[i];
    t.known = false;
    double* values = t.values;
    for_parts(s, node.ne, [&](const double* x, int n) {
      for (int r = 0; r < n; ++r) *values++ = x[r];
    });
    by_coordinates(i, constants, q, dq, s.w);
    by_rates(node, t, dq, s);
  }

  /// The body of node i and its end slice. @param bends  whether q has slopes
  void look_up(int i, bool bends, const LaneDual* q, const LaneDual* dq, State<Sp>& s) {
    Table& t = table_[i];
    const LaneDual* w = view<const LaneDual>(&s.w);
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
    if (node.ne == 0 || node.slices > 0) return false;  // the table has no slice but the end
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
    visit(view<T>(&x), count * static_cast<int>(sizeof(x) / sizeof(T)));
  }

  // --- By rates: forces are those of a kinetic energy, whose inertias are in the table. ---

  /// The slope of a body's part, whose numbers begin at a row, by coordinate k.
  template <class X>
  static X slope_at(const Table& t, int ne, int row, int k) {
    X out;
    double* to = view<double>(&out);
    for (std::size_t r = 0; r < sizeof(X) / sizeof(double); ++r) to[r] = t.by_q[(row + static_cast<int>(r)) * ne + k];
    return out;
  }
  /// Of a slice or an inertia X of each coordinate, as a sum over dq: by dq_k of the sum's rate.
  template <class X>
  static X by_rate(const Table& t, int ne, int row, const double* dq, int k) {
    X out = X::zero();
    for (int j = 0; j < ne; ++j)
      out += dq[j] * (slope_at<X>(t, ne, row + k * kForce, j) + slope_at<X>(t, ne, row + j * kForce, k));
    return out;
  }

  /// Of Lagrange's equations of the energy of M, w and dq, the link's origin at rest. That M and the forces, which
  /// kernels find from slices, are of one energy is shown by tests against duals of the latter.
  void by_rates(const Node& node, const Table& t, const double* dq, const State<One>& s) {
    using Rigid = typename One::Rigid;
    using Ang = typename One::Ang;
    const int ne = node.ne, columns = ne + Sp::angular;
    const int of_J = static_cast<int>((sizeof(Rigid) + sizeof(Frame<One>)) / sizeof(double));
    const int of_M_er = of_J + kForce * ne, of_M = of_M_er + kForce * ne;
    const Ang& w = s.w;
    const double* turning = view<const double>(&w);
    for (int k = 0; k < t.moving * columns; ++k) t.by_rates[k] = 0.0;
    const auto put = [&](int row, int column, const auto& x) {
      const double* from = view<const double>(&x);
      for (std::size_t r = 0; r < sizeof(x) / sizeof(double); ++r)
        t.by_rates[(row + static_cast<int>(r)) * columns + column] = from[r];
    };
    double* e = t.by_rates + kForce * columns;  // rows of coordinates' forces
    const int of_rate = kForce + ne, of_bias = of_rate + kForce;

    // of a coordinate's momentum p_k, by coordinates: dp_k/dq_m of de_k/d(dq_m), and less dp_m/dq_k
    const auto add_momentum = [&](int k, double rate, const double* by_q) {
      for (int m = 0; m < ne; ++m) {
        e[k * columns + m] += rate * by_q[m];
        e[m * columns + k] -= rate * by_q[m];
      }
    };
    const double* row = t.by_q + of_M * ne;
    for (int k = 0; k < ne; ++k)
      for (int j = 0; j <= k; ++j, row += ne) {
        double M_rate = 0.0;
        for (int m = 0; m < ne; ++m) M_rate += row[m] * dq[m];
        if (node.damped) M_rate += s.elastic.constants[packed(ne, 0) + packed(k, j)];
        e[k * columns + j] += M_rate;
        add_momentum(k, dq[j], row);
        if (j == k) continue;
        e[j * columns + k] += M_rate;
        add_momentum(j, dq[k], row);
      }
    Rigid rate = One::no_body();  // of the body, and of its angular momentum without w
    Force<One> momentum = Force<One>::zero();
    for (int k = 0; k < ne; ++k) {
      const int mine = of_M_er + k * kForce;
      for (int a = 0; a < Sp::angular; ++a) add_momentum(k, turning[a], t.by_q + (mine + Sp::linear + a) * ne);
      momentum += dq[k] * s.elastic.M_er[k];
      const Rigid by_q = slope_at<Rigid>(t, ne, 0, k);
      One::add(rate, {0.0, dq[k] * by_q.c, One::scaled(dq[k], by_q.J)});
      Force<One> F = by_rate<Force<One>>(t, ne, of_M_er, dq, k);
      const Ang turned = One::apply(by_q.J, w);
      F.force += 2.0 * One::cross(w, s.elastic.M_er[k].force);
      F.moment += turned + One::cross(w, s.elastic.M_er[k].moment);
      put(0, k, F);
      Ang by_w = -1.0 * turned;  // of e_k
      for (int j = 0; j < ne; ++j)
        by_w += dq[j] * (slope_at<Force<One>>(t, ne, mine, j).moment -
                         slope_at<Force<One>>(t, ne, of_M_er + j * kForce, k).moment);
      for (int a = 0; a < Sp::angular; ++a) e[k * columns + ne + a] = view<const double>(&by_w)[a];
      put(of_rate, k, s.elastic.end.J[k]);
      put(of_bias, k, by_rate<Motion<One>>(t, ne, of_J, dq, k));
    }
    const Ang spin = One::apply(s.body.J, w) + momentum.moment;
    for (int a = 0; a < Sp::angular; ++a) {
      Ang about = One::zero_angular();
      view<double>(&about)[a] = 1.0;
      put(0, ne + a,
          Force<One>{One::cross(about, One::cross(w, s.body.c)) + One::cross(w, One::cross(about, s.body.c)) +
                         2.0 * One::cross(about, momentum.force),
                     One::apply(rate.J, about) + One::cross(about, spin) + One::cross(w, One::apply(s.body.J, about))});
    }
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
    for (int k = 0; k < Sp::angular; ++k) view<B>(&s.w)[k] = B{} + view<const double>(&w)[k];
    for (int first = 0; first < ne; first += kAtOnce) {
      const int count = ne - first < kAtOnce ? ne - first : kAtOnce;
      for (int k = 0; k < count; ++k) q[first + k].d[0].v[k] = 1.0;
      bent_->template bend_body<true>(node, constants, Bent::Space::zero(), q, dq, s);
      for (int k = 0; k < count; ++k) q[first + k].d[0].v[k] = 0.0;
      double* row = table_[i].by_q + first;
      for_parts(s, ne, [&](const B* x, int n) {
        for (int r = 0; r < n; ++r, row += ne)
          for (int k = 0; k < count; ++k) row[k] = x[r].d[0].v[k];
      });
    }
  }

  const Layout& layout_;
  Bent* bent_;
  B* q_;
  Table* table_;
};

}  // namespace
