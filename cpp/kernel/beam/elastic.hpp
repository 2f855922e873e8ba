// The elastic body of a node as the dynamics knows it, and the parts that its kinds share: quadratic.hpp (order 1, 2),
// sampled.hpp (order 3 and exact), cut.hpp (order 0). S is the scalar of the arm; P that of points along a beam: of one
// arm, a pack takes several points at once.
#pragma once

#include <utility>

#include "door/layout.hpp"
#include "door/records.hpp"
#include "space/plane.hpp"
#include "space/space.hpp"

namespace {

using flexarm::lanes::Block;
using flexarm::lanes::kMostElastic;
using flexarm::lanes::Node;
namespace records = flexarm::lanes::records;

// A scalar as the points' scalar, and sums over its lanes; where they are one type there is nothing to do.
inline double widen(double x, double) { return x; }
inline void sum_lanes(const double*, int, const double*) {}

/// Keeps a factor of many products in a register (pack.hpp); other scalars than packs need no help.
template <class T>
void in_register(T&) {}

template <class S>
S next(const double*& p) {
  const S x = Lanes<S>::load(p);
  p += Lanes<S>::width;
  return x;
}

template <class S, std::size_t... i>
void read_each(const double*& p, S* x, std::index_sequence<i...>) {  // of a loop, compilers leave the record in memory
  ((x[i] = next<S>(p)), ...);
}
/// A record (door/records.hpp), or another list of numbers S.
template <class R, class S = typename R::Number>
R read(const double*& p) {
  R record;
  read_each(p, view<S>(&record), std::make_index_sequence<sizeof(R) / sizeof(S)>());
  return record;
}

constexpr int packed(int i, int j) { return i * (i + 1) / 2 + j; }  // of a lower triangle, j <= i

/// Adds a block's part of a row of a slice's motion to its value, slopes and, with `rates`, convective second rate.
template <bool rates = true, class S, class P>
void add_block(const Block& b, const double*& numbers, const S* q, const S* dq, P& value, P& bias, P* slope,
               int stride) {
  const bool square = b.i == b.j;
  P total{}, total_bias{};
  for (int c = 0; c < b.nj; ++c) {
    const P qb = widen(q[b.j + c], P{});
    P left{}, left_dot{};
    for (int r = 0; r < b.ni; ++r) {
      const P C = next<P>(numbers);
      left += C * widen(q[b.i + r], P{});
      if constexpr (rates) left_dot += C * widen(dq[b.i + r], P{});
      if (!square) slope[(b.i + r) * stride] += C * qb;
    }
    slope[(b.j + c) * stride] += left;
    total += left * qb;
    if constexpr (rates) total_bias += left_dot * widen(dq[b.j + c], P{});
  }
  value += square ? 0.5 * total : total;
  if constexpr (rates) bias += square ? total_bias : 2.0 * total_bias;
}

/// The lower triangle of F^T F, of n columns of so many rows.
template <class P>
void products(const P* F, int n, int rows, P* out) {
  for (int i = 0; i < n; ++i) {
    const P* a = F + i * rows;
    int j = 0;
    for (; j + 1 <= i; j += 2) {
      const P *b = F + j * rows, *c = b + rows;
      P ab{}, ac{};
      for (int r = 0; r < rows; ++r) {
        ab += a[r] * b[r];
        ac += a[r] * c[r];
      }
      *out++ = ab;
      *out++ = ac;
    }
    if (j > i) continue;
    P aa{};
    for (int r = 0; r < rows; ++r) aa += a[r] * a[r];
    *out++ = aa;
  }
}

/// A cross section of an elastic body in motion, in link axes (Eq. 23-27, 34-40).
template <class Sp>
struct Slice {
  Frame<Sp> frame;  ///< in the link
  Motion<Sp> rate;  ///< J dq, with J = [J_T; J_R] (Eq. 37, 39)
  Motion<Sp> bias;  ///< (dJ/dt) dq (Eq. 38, 40)
  Motion<Sp>* J;    ///< by coordinate
};

/// An elastic body as the dynamics knows it. In link axes, about the link's origin.
template <class Sp>
struct Elastic {
  using S = typename Sp::Scalar;
  Slice<Sp> end;              ///< which carries the next node
  Force<Sp>* M_er;            ///< inertia that couples coordinates and frame, ne columns (Eq. 80)
  S* M;                       ///< M_ee, packed lower triangle
  S* e;                       ///< ne: bias, elastic and damping forces
  typename Sp::Lin left_out;  ///< of a cut body alone: mass times the part of the tip's displacement beyond the cut
  // elimination: M_ee, with the inertia that the end carries, = L D L^T, below the diagonal L, on it 1/D
  S* L;
  Force<Sp>* W;             ///< L^-1 M_er
  const double* constants;  ///< stiffness K and damping, packed lower triangles
};

/// Forces of stiffness and damping into e.
template <class S>
void add_elastic_forces(const Node& node, const double* K, const S* q, const S* dq, S* e) {
  for (int part = 0; part < (node.damped ? 2 : 1); ++part) {
    const S* x = part == 0 ? q : dq;
    for (int i = 0; i < node.ne; ++i)
      for (int j = 0; j <= i; ++j) {
        const S k = next<S>(K);
        e[i] += k * x[j];
        if (j < i) e[j] += k * x[i];
      }
  }
}

}  // namespace
