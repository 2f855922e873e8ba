// Integrals from 0 to X of functions that are given at Gauss points: of the polynomial through them.
//
// Gauss points lie symmetrically about the middle. A column holds a function at those of the first half and at X = 0,
// and then at their mirror images. Of a function that is even about the middle, the integral from the middle is odd,
// and the other way round: two matrices of half the size replace one, with half the operations. Lengths are parts
// of the beam's.
#pragma once

#include "beam/elastic.hpp"

namespace {

constexpr int kMostColumns = 6;  // that an Integral takes at once

/// Columns, `stride` apart, as an Integral takes them: function c gives its value at a point.
template <class P>
auto columns_at(const P* first, int stride) {
  return [=](int c) {
    const P* column = first + c * stride;
    return [column](int i) { return column[i]; };
  };
}

/// The matrices: for each point of the first half its column of the one for even functions, and of the one for odd
/// functions, by rows of points. Where points lie across lanes, columns and rows are filled up to whole packs.
template <class S, class P>
class Integral {
 public:
  static constexpr int width = static_cast<int>(sizeof(P) / sizeof(S));  // points in one P
  static constexpr bool many = Lanes<P>::width >= 8;                     // registers
  static constexpr int batch = many ? 6 : 2;                             // columns at once
  static constexpr int rows = 2;                                         // P of each matrix at once

  static_assert(batch <= kMostColumns, "the room to work in");

  /// @param half points of the first half @param packs P of a column's first half @param work 2 kMostColumns packs of P
  Integral(const double* table, int half, int packs, P* work)
      : table_(table), half_(half), packs_(packs), work_(work) {}

  /// Integrals of so many functions into columns, `stride` apart. slope(c) is function c: it gives its values at
  /// points.
  template <class Slope>
  void operator()(int columns, const Slope& slope, P* out, int stride) const {
    for (int c = 0; c < columns;) c += some<batch>(c, columns, slope, out, stride);
  }
  /// In place.
  void operator()(P* f, int stride, int columns) const { (*this)(columns, columns_at(f, stride), f, stride); }

 private:
  template <int C, class Slope>
  int some(int c, int columns, const Slope& slope, P* out, int stride) const {
    if constexpr (C > 1)
      if (columns - c < C) return some<C - 1>(c, columns, slope, out, stride);
    for (int k = 0; k < C; ++k) {
      const auto f = slope(c + k);
      P *sum = work_ + k * packs_, *difference = sum + C * packs_;
      for (int i = 0; i < packs_; ++i) {
        const P first = f(i), second = f(packs_ + i);
        sum[i] = first + second;
        difference[i] = first - second;
      }
    }
    integrate<C>(out + c * stride, stride);
    return C;
  }

  template <int C>
  void integrate(P* out, int stride) const {
    P first_half[C];  // integrals
#pragma GCC unroll 8
    for (int c = 0; c < C; ++c) first_half[c] = P{};
    for (int i = packs_; i > 0;) i -= block<C, rows>(i, out, stride, first_half);
  }

  /// The rows before `end`.
  template <int C, int R>
  int block(int end, P* out, int stride, P* first_half) const {
    if constexpr (R > 1)
      if (end < R) return block<C, R - 1>(end, out, stride, first_half);
    const int i = end - R;
    P odd[C][R], even[C][R];
#pragma GCC unroll 8
    for (int c = 0; c < C; ++c)
#pragma GCC unroll 4
      for (int r = 0; r < R; ++r) odd[c][r] = even[c][r] = P{};
    const S *sum = view<const S>(work_), *difference = sum + C * packs_ * width;
    const double* A = table_ + i * width;
    for (int j = 0; j < half_; ++j, A += 2 * packs_ * width) {
      const double* B = A + packs_ * width;
#pragma GCC unroll 8
      for (int c = 0; c < C; ++c) {
        P s = widen(sum[c * packs_ * width + j], P{}), d = widen(difference[c * packs_ * width + j], P{});
        in_register(s);
        in_register(d);
#pragma GCC unroll 4
        for (int r = 0; r < R; ++r) {
          odd[c][r] += entry(A + r * width) * s;
          even[c][r] += entry(B + r * width) * d;
        }
      }
    }
    if (end == packs_)
#pragma GCC unroll 8
      for (int c = 0; c < C; ++c) first_half[c] = from_zero(odd[c][R - 1]);
#pragma GCC unroll 8
    for (int c = 0; c < C; ++c) {
#pragma GCC unroll 4
      for (int r = 0; r < R; ++r) {
        const P centre = even[c][r] + first_half[c];
        out[c * stride + i + r] = centre - odd[c][r];
        out[c * stride + packs_ + i + r] = centre + odd[c][r];
      }
    }
    return R;
  }
  static auto entry(const double* p) {
    if constexpr (width > 1)
      return Lanes<P>::load(p);
    else
      return *p;
  }
  /// The row of X = 0, in its last pack.
  P from_zero(const P& x) const {
    if constexpr (width > 1)
      return widen(x[half_ % width], P{});
    else
      return x;
  }

  const double* table_;
  int half_, packs_;
  P* work_;
};

}  // namespace
