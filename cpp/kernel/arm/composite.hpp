// The joint-space mass matrix H^T Phi^T M Phi H of Eq. 90, by composite inertias: everything outward of a freedom, held
// rigid, is one rigid body.
#pragma once

#include "arm/chain.hpp"

namespace {

/// Works on a tree of nodes after its `move`.
template <class Sp>
struct Composite {
  using S = typename Sp::Scalar;
  using Ang = typename Sp::Ang;
  using Rigid = typename Sp::Rigid;
  static constexpr int kRows = Sp::linear + Sp::angular;

  int nv;
  /// Of each node in the base's axes, from the origin: the first node that turns, so that no digits are lost where a
  /// base is far away.
  Frame<Sp>* place;
  int *first, *rates;  ///< of each node: the first node of its branch; how many rates there are up to it
  int* column;         ///< of each fork on a slice: the first of H that is its own
  int columns;
  /// kRows of columns: by rate, the motion at the origin of the bodies that it moves, base axes (Eq. 91); and then of
  /// those on slices, by the coordinates that move these.
  S* H;

  Composite(const Layout& layout, Arena& arena) : nv(layout.nv) {
    arena.take(layout.nodes, place);
    arena.take(layout.nodes, first, rates);
    arena.take(layout.forks + layout.forks % 2, column);  // numbers of 8 bytes follow
    columns = nv;
    for (int k = 0; k < layout.forks; ++k) {
      const Place& at = layout.fork[k].place;
      if (!arena.counts()) column[k] = columns;
      if (at.on == Place::slice) columns += layout.node[at.node].ne;
    }
    arena.take(kRows * columns, H);
  }
  Composite(const Layout& layout, Arena&& arena) : Composite(layout, arena) {}

  /// M (nv x nv, symmetric).
  template <class C>
  void run(C& chain, S* M) {
    outward(chain);
    for (long i = 0; chain.layout.branched && i < static_cast<long>(nv) * nv; ++i) M[i] = S{};
    inward(chain, M);
    constexpr int kBlock = 8;  // rows that stay in the cache
    for (int block = 0; block < nv; block += kBlock)
      for (int i = 0; i < nv; ++i)
        for (int j = block > i ? block : i + 1; j < nv && j < block + kBlock; ++j) M[i * nv + j] = M[j * nv + i];
  }

 private:
  void put(int rate, const Motion<Sp>& m) {
    const S* x = view<const S>(&m);
    for (int r = 0; r < kRows; ++r) H[r * columns + rate] = x[r];
  }

  /// The motion at the origin by each rate.
  template <class C>
  void outward(const C& chain) {
    Frame<Sp> at{Sp::turn(0, S{}, number<S>(1.0)), Sp::zero()};
    bool turned = false;
    for (int i = 0; i < chain.layout.nodes; ++i) {
      const Node& node = chain.layout.node[i];
      const State<Sp>& s = chain.state[i];
      first[i] = i == 0 || node.branch ? i : first[i - 1];
      rates[i] = (i == 0 ? 0 : rates[i - 1]) + node.ne + (node.kind != Node::fixed);
      if (node.branch) start_branch(chain, i, at, turned);
      if (!node.coincident) {
        if (turned) at.r += Sp::rotate(at.R, s.frame.r);
        turned = turned || node.kind == Node::revolute || node.ne > 0;
        at.R = node.parent < 0 ? s.frame.R : Sp::times(at.R, s.frame.R);
      }
      place[i] = at;
      if (node.kind == Node::revolute) {
        const Ang w = number<S>(node.sign) * Sp::angular_axis(at.R, node.axis);
        put(node.v, {number<S>(-1.0) * Sp::cross(w, at.r), w});
      } else if (node.kind == Node::prismatic) {
        put(node.v, {number<S>(node.sign) * Sp::axis(at.R, node.axis), Sp::zero_angular()});
      }
      if (node.ne == 0) continue;
      if (node.slices > 0) put_slices(chain, node, at);
      move_on(node, s.elastic.end, node.ve, at);
    }
  }
  template <class C>
  [[gnu::noinline]] void put_slices(const C& chain, const Node& node, const Frame<Sp> at) {
    for (int k = 0; k < node.slices; ++k) {
      Frame<Sp> of = at;
      move_on(node, chain.fork[node.slice[k]].slice, column[node.slice[k]], of);
    }
  }
  /// From a node's frame to a slice of its beam, with the motion by its coordinates.
  void move_on(const Node& node, const Slice<Sp>& to, int to_column, Frame<Sp>& at) {
    at.r += Sp::rotate(at.R, to.frame.r);
    for (int k = 0; k < node.ne; ++k) put(to_column + k, at.to_parent(to.J[k]));
    at.R = Sp::times(at.R, to.frame.R);
  }

  /// Where the branch that begins with node i sits, and whether any node before it turns.
  template <class C>
  void start_branch(const C& chain, int i, Frame<Sp>& at, bool& turned) const {
    const int parent = chain.layout.node[i].parent;
    turned = false;
    at = {Sp::turn(0, S{}, number<S>(1.0)), Sp::zero()};
    if (parent < 0) return;
    for (int k = parent; k >= 0; k = chain.layout.node[k].parent)
      turned = turned || chain.layout.node[k].kind == Node::revolute || chain.layout.node[k].ne > 0;
    const Slice<Sp>* slice = chain.seat_of(chain.layout.node[i]).slice;
    at = slice ? place[parent] * slice->frame : place[parent];
  }

  /// The entries of row `rate` before it: a force on node i, by the rates that move that node. The rates of a branch
  /// are consecutive.
  template <class C>
  void fill(const C& chain, int i, int rate, int before, const Force<Sp>& own, S* M) const {
    const Force<Sp> F = place[i].to_parent(own);
    S* row = M + static_cast<long>(rate) * nv;
    if (!chain.layout.branched) return fill(0, before, F, H, row);
    for (int end = before;;) {
      const int begin = first[i] == 0 ? 0 : rates[first[i] - 1];
      fill(begin, end, F, H + begin, row);
      const Node& seated = chain.layout.node[first[i]];
      i = seated.parent;
      if (i < 0) break;
      end = rates[i];
      if (!chain.slice_under(seated)) continue;
      end -= chain.layout.node[i].ne;
      fill(end, rates[i], F, H + column[seated.seat], row);
    }
  }
  /// @param h  of the column by rate `begin`
  void fill(int begin, int end, const Force<Sp>& F, const S* h, S* row) const {
    const S *x = view<const S>(&F), *y = x + Sp::linear;
    const int n = columns;
    row += begin;
    if constexpr (Sp::planar)
      for (int i = 0; i < end - begin; ++i) row[i] = x[0] * h[i] + x[1] * h[n + i] + y[0] * h[2 * n + i];
    else
      for (int i = 0; i < end - begin; ++i)
        row[i] = (x[0] * h[i] + x[1] * h[n + i] + x[2] * h[2 * n + i]) +
                 (y[0] * h[3 * n + i] + y[1] * h[4 * n + i] + y[2] * h[5 * n + i]);
  }

  template <class C>
  void inward(C& chain, S* M) const {
    Rigid B = Sp::no_body();  // of all nodes behind, in the axes of this node's end, about its end
    chain.clear_forks();
    for (int i = chain.layout.nodes; i-- > 0;) {
      const Node& node = chain.layout.node[i];
      const State<Sp>& s = chain.state[i];
      if (node.fork >= 0) Sp::add(B, chain.fork[node.fork].body);
      if (node.ne > 0) {
        if (node.tip) Sp::add(B, s.tip);
        bend(chain, i, B, M);
      }
      if (node.ne > 0 || node.body) Sp::add(B, s.body);
      if (node.kind != Node::fixed) {
        Force<Sp> F = Sp::column(B, node.kind == Node::revolute, node.axis);
        S& own = M[static_cast<long>(node.v) * nv + node.v];
        own = freedom(node, F);
        if (node.passive) own += s.reflected;
        fill(chain, i, node.v, node.v, number<S>(node.sign) * F, M);
      }
      if (node.parent >= 0 && !node.coincident) B = C::to_parent(node, s, B);
      if (!node.branch) continue;
      if (node.seat >= 0) Sp::add(chain.fork[node.seat].body, B);
      B = Sp::no_body();
    }
  }

  /// The rows of a beam's coordinates, with B on its end, which then is about the link's origin, and with those on its
  /// slices.
  template <class C>
  void bend(const C& chain, int i, Rigid& B, S* M) const {
    const Node& node = chain.layout.node[i];
    const Elastic<Sp>& e = chain.state[i].elastic;
    const Slice<Sp>& end = e.end;
    B = Sp::rotate(end.frame.R, B);
    chain.for_slices(node, [&](auto& f) { f.body = Sp::rotate(f.slice.frame.R, f.body); });
    for (int k = 0; k < node.ne; ++k) {
      const Force<Sp> F = B * end.J[k];
      S* row = M + static_cast<long>(node.ve + k) * nv + node.ve;
      for (int j = 0; j <= k; ++j) row[j] = e.M[packed(k, j)] + dot(end.J[j], F);
      Force<Sp> whole = e.M_er[k] + end.frame.shift_back(F);
      if (node.slices > 0) whole += force_slices(chain, node, k, row);
      fill(chain, i, node.ve + k, node.ve, whole, M);
    }
    B = Sp::shift(B, end.frame.r);
    chain.for_slices(node, [&](auto& f) { Sp::add(B, Sp::shift(f.body, f.slice.frame.r)); });
  }
  /// Of links on slices, by coordinate k: on coordinates, and about the link's origin.
  template <class C>
  [[gnu::noinline]] Force<Sp> force_slices(const C& chain, const Node& node, int k, S* row) const {
    Force<Sp> sum = Force<Sp>::zero();
    chain.for_slices(node, [&](auto& f) {
      const Force<Sp> on = f.body * f.slice.J[k];
      for (int j = 0; j <= k; ++j) row[j] += dot(f.slice.J[j], on);
      sum += f.slice.frame.shift_back(on);
    });
    return sum;
  }
};

}  // namespace
