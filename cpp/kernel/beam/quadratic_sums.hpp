// Sums of the quadratic body (quadratic.hpp) over its points, in space and in the plane.
#pragma once

#include "beam/elastic.hpp"

namespace {

/// A rotation vector theta, which takes its slopes through the left Jacobian I + b t~ + c t~^2 (or through the right
/// one: sign -1), and its second rate likewise (Eq. 35, 39, 40).
template <class S>
struct Turned {
  typename Space<S>::Lin t;
  Turn<S> k;
  explicit Turned(const typename Space<S>::Lin& t_) : t(t_), k(Space<S>::dot(t_, t_)) {}
  typename Space<S>::Lin jacobian(const typename Space<S>::Lin& y, double sign) const {
    const auto ty = Space<S>::cross(t, y);
    return y + (sign * k.b) * ty + k.c * Space<S>::cross(t, ty);
  }
  typename Space<S>::Lin bias(const typename Space<S>::Lin& rate, const typename Space<S>::Lin& second,
                              double sign) const {
    const auto tt = Space<S>::cross(t, rate);
    const S s_dot = 2.0 * Space<S>::dot(t, rate);
    return jacobian(second, sign) + (sign * (k.db * s_dot)) * tt + (k.dc * s_dot) * Space<S>::cross(t, tt) +
           k.c * Space<S>::cross(rate, tt);
  }
  typename Space<S>::Rot rotation() const {
    const S xx = t.x * t.x, yy = t.y * t.y, zz = t.z * t.z, xy = k.b * t.x * t.y, xz = k.b * t.x * t.z,
            yz = k.b * t.y * t.z, x = k.a * t.x, y = k.a * t.y, z = k.a * t.z;
    return {1.0 - k.b * (yy + zz), xy - z, xz + y, xy + z, 1.0 - k.b * (xx + zz), yz - x, xz - y, yz + x,
            1.0 - k.b * (xx + yy)};
  }
};

namespace quadratic {

/// Sums over the points, of the body alone. In the plane, y has no quadratic part: the pairings with x need points.
template <class Sp>
struct Moments;
template <class T>
struct Moments<Plane<T>> {
  using Linear = T;   ///< the points' part of a coordinate's first moment: along x
  T c, c_rate, bias;  ///< first moment along x, its rate, and the convective part of its second rate
  T J, n;             ///< second moment; moment of the accelerations that velocities give
};
template <class T>
struct Moments<Space<T>> {
  using Linear = typename Space<T>::Lin;
  typename Space<T>::Lin c, c_rate, bias;
  typename Space<T>::Sym xx;  ///< the integral of x x^T
  typename Space<T>::Lin n;
  typename Space<T>::Sym J_turn;  ///< of sections that turn: their own inertia,
  typename Space<T>::Lin n_turn;  ///< and the moment that turns them
};

/// All sums over the points: first packs, and then, in the same place, the sums of their lanes. Functions take it by
/// value: packs may alias anything, and so also pointers that lie in memory.
template <class Sp>
struct Sums {
  using T = typename Sp::Scalar;
  using Body = Moments<Sp>;
  using Linear = typename Body::Linear;
  using Ang = typename Sp::Ang;
  Body* body;
  T* e;              ///< of each coordinate: its force,
  Linear* M_linear;  ///< its coupling with forces
  Ang* M_angular;    ///< and with moments;
  T* M;              ///< of each pair, packed
  int size;          ///< numbers T of all this

  Sums(T* at, int ne) : body(view<Body>(at)) {
    e = at + sizeof(Body) / sizeof(T);
    M_linear = view<Linear>(e + ne);
    M_angular = view<Ang>(M_linear + ne);
    M = view<T>(M_angular + ne);
    size = size_of(ne);
  }
  static int size_of(int ne) {
    return static_cast<int>((sizeof(Body) + static_cast<std::size_t>(ne) * (sizeof(T) + sizeof(Linear) + sizeof(Ang))) /
                            sizeof(T)) +
           packed(ne, 0);
  }
};

/// A point of position: the constant 1 there, and x.
template <class P>
struct Position {
  P one;
  typename Space<P>::Lin x;
};

/// How scratch is divided: where each part begins, in numbers P, and how many these are in all.
template <class Sp>
struct Parts {
  int rows;       ///< of a coordinate's column of slopes
  int slopes;     ///< columns by coordinate, after the sums
  int forces;     ///< in space: by row, the forces of accelerations by velocities;
  int positions;  ///< a Position of each point of position,
  int turns;      ///< and for each of rotation, R times the root of its inertia
  int size;

  explicit Parts(const Node& node) : rows(Sp::planar ? node.passes : 3 * (node.passes + node.rotary)) {
    slopes = Sums<Sp>::size_of(node.ne);
    forces = slopes + rows * node.ne;
    positions = forces + (Sp::planar ? 0 : rows);
    turns = positions + (Sp::planar ? 0 : 4 * node.passes);
    size = turns + (Sp::planar ? 0 : 9 * node.rotary);
  }
};

/// Mee of sums and its constant part, whose numbers are next, and elastic forces (Eq. 62).
template <class Sp, class S>
void finish_elastic(const Node& node, const double* p, const S* M, const S* q, const S* dq, Elastic<Sp>& out) {
  for (int k = 0; k < packed(node.ne, 0); ++k) out.M[k] = next<S>(p) + M[k];
  out.constants = p;
  add_elastic_forces(node, p, q, dq, out.e);
}

}  // namespace quadratic
}  // namespace
