// The joint-space mass matrix H^T Phi^T M Phi H of Eq. 90, by composite inertias: everything outward of a freedom, held
// rigid, is one rigid body.
#pragma once

#include "lanes/chain.hpp"

namespace {

/// Works on a chain after its `move`.
template <class Sp>
struct Composite {
  using S = typename Sp::Scalar;
  using Lin = typename Sp::Lin;
  using Ang = typename Sp::Ang;
  using Rot = typename Sp::Rot;
  using Rigid = typename Sp::Rigid;
  static constexpr int kRows = Sp::linear + Sp::angular;
  struct Place {
    Rot R;  ///< a node's frame in the base's axes
    Lin p;  ///< from the origin: the first node that turns, so that no digits are lost where a base is far away
  };

  int nv;
  Place* place;  ///< by node
  S* H;          ///< kRows of nv: by rate, the motion of what it moves at the origin, base axes (Eq. 91)

  Composite(const Layout& layout, Room& room) : nv(layout.nv) {
    room.take(layout.nodes, place);
    room.take(kRows * nv, H);
  }
  Composite(const Layout& layout, Room&& room) : Composite(layout, room) {}

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
  void put(int rate, const Lin& v, const Ang& w) {
    const S *x = reinterpret_cast<const S*>(&v), *y = reinterpret_cast<const S*>(&w);
    for (int r = 0; r < Sp::linear; ++r) H[r * nv + rate] = x[r];
    for (int r = 0; r < Sp::angular; ++r) H[(Sp::linear + r) * nv + rate] = y[r];
  }

  /// What each rate moves, at the origin.
  template <class C>
  void outward(const C& chain) {
    Rot R = Sp::turn(0, S{}, number<S>(1.0));
    Lin p = Sp::zero();
    bool turned = false;
    for (int i = 0; i < chain.layout.nodes; ++i) {
      const Node& node = chain.layout.node[i];
      const State<Sp>& s = chain.state[i];
      if (!node.coincident) {
        if (turned) p += Sp::rotate(R, s.r);
        turned = turned || node.kind == Node::revolute || node.ne > 0;
        R = i == 0 ? s.R : Sp::times(R, s.R);
      }
      place[i] = {R, p};
      if (node.kind == Node::revolute) {
        const Ang w = number<S>(node.sign) * Sp::angular_axis(R, node.axis);
        put(node.v, number<S>(-1.0) * Sp::cross(w, p), w);
      } else if (node.kind == Node::prismatic) {
        put(node.v, number<S>(node.sign) * Sp::axis(R, node.axis), Sp::zero_angular());
      }
      if (node.ne == 0) continue;
      const Slice<Sp>& end = s.elastic.end;
      p += Sp::rotate(R, end.x);
      for (int k = 0; k < node.ne; ++k) {
        const Ang w = Sp::rotate_angular(R, end.J_angular[k]);
        put(node.ve + k, Sp::rotate(R, end.J_linear[k]) - Sp::cross(w, p), w);
      }
      R = Sp::times(R, end.R);
    }
  }

  /// The entries of row `rate` before it: a force and a moment of a node, by what moves that node.
  void fill(int rate, int before, const Place& at, const Lin& f, const Ang& n, S* M) const {
    const Lin force = Sp::rotate(at.R, f);
    const Ang torque = Sp::rotate_angular(at.R, n) + Sp::moment(at.p, force);
    const S *x = reinterpret_cast<const S*>(&force), *y = reinterpret_cast<const S*>(&torque);
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
    Rigid B = Sp::no_body();  // of all that follows, in the axes of this node's end, about its end
    for (int i = chain.layout.nodes; i-- > 0;) {
      const Node& node = chain.layout.node[i];
      const State<Sp>& s = chain.state[i];
      if (node.ne > 0) {
        if (node.tip) Sp::add(B, s.tip);
        bend(node, s.elastic, place[i], B, M);
      }
      if (node.ne > 0 || node.body) Sp::add(B, s.body);
      const bool about = node.kind == Node::revolute;
      if (node.kind != Node::fixed) {
        Lin f;
        Ang n;
        Sp::column(B, about, node.axis, f, n);
        S& own = M[static_cast<long>(node.v) * nv + node.v];
        own = about ? Sp::angular_component(n, node.axis) : Sp::component(f, node.axis);
        if (node.passive) own += s.reflected;
        const S sign = number<S>(node.sign);
        fill(node.v, node.v, place[i], sign * f, sign * n, M);
      }
      if (i == 0) break;
      if (node.coincident) continue;
      B = Sp::shift(
          about && !node.turned && !node.ball ? Sp::rotate(node.axis, s.sine, s.cosine, B) : Sp::rotate(s.R, B), s.r);
    }
  }

  /// The rows of a beam's coordinates, with B on its end, which then is about the link's origin.
  void bend(const Node& node, const Elastic<Sp>& e, const Place& at, Rigid& B, S* M) const {
    const Slice<Sp>& end = e.end;
    B = Sp::rotate(end.R, B);
    for (int k = 0; k < node.ne; ++k) {
      const Lin g = Sp::force(B, end.J_linear[k], end.J_angular[k]);
      const Ang h = Sp::torque(B, end.J_linear[k], end.J_angular[k]);
      S* row = M + static_cast<long>(node.ve + k) * nv + node.ve;
      for (int j = 0; j <= k; ++j)
        row[j] = e.M[packed(k, j)] + Sp::dot(end.J_linear[j], g) + Sp::dot(end.J_angular[j], h);
      fill(node.ve + k, node.ve, at, e.M_linear[k] + g, e.M_angular[k] + h + Sp::moment(end.x, g), M);
    }
    B = Sp::shift(B, end.x);
  }
};

}  // namespace
