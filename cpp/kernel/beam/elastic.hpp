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

template <int C>
struct Count {
  static constexpr int value = C;
};

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

/// Adds a block's part of a row of a slice's motion to its value, slopes and, with `rates`, convective second rate; of
/// slices one after the other, whose numbers are `apart`, and rows three. Numbers in memory are read once: packs may
/// alias anything.
/// @tparam N  its ni, or 0 where that is any
template <int N, bool rates, class S, class P>
void add_block_of(const Block b, const double* numbers, int apart, const S* q, const S* dq, P* value, P* bias, P* slope,
                  int stride, int slices) {
  const bool square = b.i == b.j;
  const int ni = N > 0 ? N : b.ni;
  P qi[N > 0 ? N : kMostElastic], di[N > 0 ? N : kMostElastic], si[N > 0 ? N : kMostElastic];
#pragma GCC unroll 4
  for (int r = 0; r < ni; ++r) {
    qi[r] = widen(q[b.i + r], P{});
    if constexpr (rates) di[r] = widen(dq[b.i + r], P{});
  }
  q += b.j;
  dq += b.j;
  for (P* const end = slope + 3 * slices; slope < end; numbers += apart, value += 3, bias += 3, slope += 3) {
    const double* p = numbers;
    P *sj = slope + b.j * stride, total{}, total_bias{};
#pragma GCC unroll 4
    for (int r = 0; r < ni; ++r) si[r] = slope[(b.i + r) * stride];
    for (int c = 0; c < b.nj; ++c, sj += stride) {
      const P qb = widen(q[c], P{});
      P left{}, left_dot{};
#pragma GCC unroll 4
      for (int r = 0; r < ni; ++r) {
        const P C = next<P>(p);
        left += C * qi[r];
        if constexpr (rates) left_dot += C * di[r];
        if (!square) si[r] += C * qb;
      }
      *sj += left;
      total += left * qb;
      if constexpr (rates) total_bias += left_dot * widen(dq[c], P{});
    }
    if (!square)
#pragma GCC unroll 4
      for (int r = 0; r < ni; ++r) slope[(b.i + r) * stride] = si[r];
    *value += square ? 0.5 * total : total;
    if constexpr (rates) *bias += square ? total_bias : 2.0 * total_bias;
  }
}
template <bool rates = true, class S, class P>
void add_blocks(const Block& b, const double* numbers, int apart, const S* q, const S* dq, P* value, P* bias, P* slope,
                int stride, int slices) {
  const auto sized = [&](auto count) {
    add_block_of<decltype(count)::value, rates>(b, numbers, apart, q, dq, value, bias, slope, stride, slices);
  };
  if constexpr (Lanes<P>::width > 1) {  // in registers
    if (b.ni == 1) return sized(Count<1>{});
    if (b.ni == 2) return sized(Count<2>{});
    if (b.ni == 3) return sized(Count<3>{});
    if (b.ni == 4) return sized(Count<4>{});
  }
  sized(Count<0>{});
}
/// The same of one slice, whose numbers are next.
template <bool rates = true, class S, class P>
void add_block(const Block& b, const double*& numbers, const S* q, const S* dq, P& value, P& bias, P* slope,
               int stride) {
  add_blocks<rates>(b, numbers, 0, q, dq, &value, &bias, slope, stride, 1);
  numbers += b.ni * b.nj * Lanes<P>::width;
}

/// Adds R x C numbers of F^T G, of columns i.. of F and j.. of G, to those of its lower triangle.
template <int R, int C, int each, class P>
void add_some_products(const P* F, const P* G, int rows, int i, int j, P* out) {
  P sum[R][C];
#pragma GCC unroll 2
  for (int r = 0; r < R; ++r)
#pragma GCC unroll 4
    for (int k = 0; k < C; ++k) sum[r][k] = P{};
  F += i * rows;
  G += j * rows;
  for (int first = 0; first < rows; first += each)
#pragma GCC unroll 3
    for (int a = first; a < first + each; ++a)
#pragma GCC unroll 4
      for (int k = 0; k < C; ++k) {
        P x = G[k * rows + a];
        in_register(x);
#pragma GCC unroll 2
        for (int r = 0; r < R; ++r) sum[r][k] += F[r * rows + a] * x;
      }
#pragma GCC unroll 2
  for (int r = 0; r < R; ++r)
#pragma GCC unroll 4
    for (int k = 0; k < C; ++k)
      if (j + k <= i + r) out[packed(i + r, j + k)] += sum[r][k];
}
/// Adds the lower triangle of F^T G, which is symmetric, of n columns of so many rows.
/// @tparam each  the number of rows is a multiple of it
template <int each, class P>
void add_products(const P* F, const P* G, int n, int rows, P* out) {
  const auto along = [&](auto height, int i) {
    constexpr int R = decltype(height)::value;
    const int end = i + R;
    int j = 0;
    for (; j + 4 <= end; j += 4) add_some_products<R, 4, each>(F, G, rows, i, j, out);
    if (end - j == 3) add_some_products<R, 3, each>(F, G, rows, i, j, out);
    if (end - j == 2) add_some_products<R, 2, each>(F, G, rows, i, j, out);
    if (end - j == 1) add_some_products<R, 1, each>(F, G, rows, i, j, out);
  };
  int i = 0;
  for (; i + 2 <= n; i += 2) along(Count<2>{}, i);
  if (i < n) along(Count<1>{}, i);
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
