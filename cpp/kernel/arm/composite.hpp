// The joint-space mass matrix H^T Phi^T M Phi H of Eq. 90, by composite inertias: everything outward of a freedom, held
// rigid, is one rigid body.
#pragma once

#include "arm/chain.hpp"

namespace {

/// Works on a chain after its `move`.
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
  S* H;  ///< kRows of nv: by rate, the motion at the origin of the bodies that it moves, base axes (Eq. 91)

  Composite(const Layout& layout, Arena& arena) : nv(layout.nv) {
    arena.take(layout.nodes, place);
    arena.take(kRows * nv, H);
  }
  Composite(const Layout& layout, Arena&& arena) : Composite(layout, arena) {}

  /// M (nv x nv, symmetric).
  template <class C>
  void run(const C& chain, S* M) {
    outward(chain);
    inward(chain, M);
    constexpr int kBlock = 8;  // rows that stay in the cache
    for (int first = 0; first < nv; first += kBlock)
      for (int i = 0; i < nv; ++i)
        for (int j = first > i ? first : i + 1; j < nv && j < first + kBlock; ++j) M[i * nv + j] = M[j * nv + i];
  }

 private:
  void put(int rate, const Motion<Sp>& m) {
    const S* x = view<const S>(&m);
    for (int r = 0; r < kRows; ++r) H[r * nv + rate] = x[r];
  }

  /// The motion at the origin by each rate.
  template <class C>
  void outward(const C& chain) {
    Frame<Sp> at{Sp::turn(0, S{}, number<S>(1.0)), Sp::zero()};
    bool turned = false;
    for (int i = 0; i < chain.layout.nodes; ++i) {
      const Node& node = chain.layout.node[i];
      const State<Sp>& s = chain.state[i];
      if (!node.coincident) {
        if (turned) at.r += Sp::rotate(at.R, s.frame.r);
        turned = turned || node.kind == Node::revolute || node.ne > 0;
        at.R = i == 0 ? s.frame.R : Sp::times(at.R, s.frame.R);
      }
      place[i] = at;
      if (node.kind == Node::revolute) {
        const Ang w = number<S>(node.sign) * Sp::angular_axis(at.R, node.axis);
        put(node.v, {number<S>(-1.0) * Sp::cross(w, at.r), w});
      } else if (node.kind == Node::prismatic) {
        put(node.v, {number<S>(node.sign) * Sp::axis(at.R, node.axis), Sp::zero_angular()});
      }
      if (node.ne == 0) continue;
      const Slice<Sp>& end = s.elastic.end;
      at.r += Sp::rotate(at.R, end.frame.r);
      for (int k = 0; k < node.ne; ++k) put(node.ve + k, at.to_parent(end.J[k]));
      at.R = Sp::times(at.R, end.frame.R);
    }
  }

  /// The entries of row `rate` before it: a force on a node, by the rates that move that node.
  void fill(int rate, int before, const Frame<Sp>& at, const Force<Sp>& own, S* M) const {
    const Force<Sp> F = at.to_parent(own);
    const S *x = view<const S>(&F), *y = x + Sp::linear;
    S* row = M + static_cast<long>(rate) * nv;
    const S* h = H;
    if constexpr (Sp::planar)
      for (int i = 0; i < before; ++i) row[i] = x[0] * h[i] + x[1] * h[nv + i] + y[0] * h[2 * nv + i];
    else
      for (int i = 0; i < before; ++i)
        row[i] = (x[0] * h[i] + x[1] * h[nv + i] + x[2] * h[2 * nv + i]) +
                 (y[0] * h[3 * nv + i] + y[1] * h[4 * nv + i] + y[2] * h[5 * nv + i]);
  }

  template <class C>
  void inward(const C& chain, S* M) const {
    Rigid B = Sp::no_body();  // of all nodes behind, in the axes of this node's end, about its end
    for (int i = chain.layout.nodes; i-- > 0;) {
      const Node& node = chain.layout.node[i];
      const State<Sp>& s = chain.state[i];
      if (node.ne > 0) {
        if (node.tip) Sp::add(B, s.tip);
        bend(node, s.elastic, place[i], B, M);
      }
      if (node.ne > 0 || node.body) Sp::add(B, s.body);
      if (node.kind != Node::fixed) {
        Force<Sp> F = Sp::column(B, node.kind == Node::revolute, node.axis);
        S& own = M[static_cast<long>(node.v) * nv + node.v];
        own = freedom(node, F);
        if (node.passive) own += s.reflected;
        fill(node.v, node.v, place[i], number<S>(node.sign) * F, M);
      }
      if (i == 0) break;
      if (!node.coincident) B = C::to_parent(node, s, B);
    }
  }

  /// The rows of a beam's coordinates, with B on its end, which then is about the link's origin.
  void bend(const Node& node, const Elastic<Sp>& e, const Frame<Sp>& at, Rigid& B, S* M) const {
    const Slice<Sp>& end = e.end;
    B = Sp::rotate(end.frame.R, B);
    for (int k = 0; k < node.ne; ++k) {
      const Force<Sp> F = B * end.J[k];
      S* row = M + static_cast<long>(node.ve + k) * nv + node.ve;
      for (int j = 0; j <= k; ++j) row[j] = e.M[packed(k, j)] + dot(end.J[j], F);
      fill(node.ve + k, node.ve, at, e.M_er[k] + end.frame.shift_back(F), M);
    }
    B = Sp::shift(B, end.frame.r);
  }
};

}  // namespace
