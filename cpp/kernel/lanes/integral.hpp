// Integrals from 0 to X of functions that are given at Gauss points: of the polynomial through them.
//
// Gauss points lie symmetrically about the middle. A column holds a function at those of the first half, and then at
// their mirror images. Of a function that is even about the middle, the integral from the middle is odd, and the other
// way round: two matrices of half the size do what one would, in half the operations. Lengths are parts of the beam's.
#pragma once

#include "lanes/elastic.hpp"

namespace {

/// The matrices: for each point of the first half its column of the one for even functions, and of the one for odd
/// functions, by rows of points. One row beyond the points of the former is the integral of the first half. Where
/// points lie across lanes, rows are filled up to whole packs, and columns as well.
template <class S, class P>
class Integral {
 public:
  static constexpr int width = static_cast<int>(sizeof(P) / sizeof(S));                        // points in one P
  static constexpr int batch = Lanes<P>::width < 8 ? (width > 1 ? 6 : 2) : width > 1 ? 8 : 4;  // columns at once

  /// Numbers P that it works on.
  static std::size_t scratch(int packs) { return static_cast<std::size_t>(2 * batch * packs); }
  /// @param half points of the first half @param packs P of them in a column
  Integral(const double* table, int half, int packs, P* work)
      : table_(table), half_(half), packs_(packs), rows_(width > 1 ? packs : half + 1), work_(work) {}

  /// Takes functions in columns, `stride` apart, to their integrals, in their place.
  void operator()(P* f, int stride, int columns) const {
    while (columns > 0) columns -= some<batch>(f, stride, columns);
  }

 private:
  template <int C>
  int some(P*& f, int stride, int columns) const {
    if constexpr (C > 1)
      if (columns < C) return some<C - 1>(f, stride, columns);
    integrate<C>(f, stride);
    f += C * stride;
    return C;
  }

  template <int C>
  void integrate(P* f, int stride) const {
    P *sum = work_, *difference = work_ + C * packs_;
    for (int c = 0; c < C; ++c)
      for (int i = 0; i < packs_; ++i) {
        const P first = f[c * stride + i], second = f[c * stride + packs_ + i];
        sum[c * packs_ + i] = first + second;
        difference[c * packs_ + i] = first - second;
      }
    P* odd[C];
    for (int c = 0; c < C; ++c) odd[c] = f + c * stride + packs_;
    S first_half[C] = {};
    multiply<C>(0, rows_, sum, [&](int c, int i, const P& x) {
      if (i < packs_) odd[c][i] = x;
      if constexpr (width == 1)
        if (i == half_) first_half[c] = x;
    });
    if constexpr (width > 1)
      for (int c = 0; c < C; ++c) first_half[c] = reinterpret_cast<const S*>(odd[c])[half_];
    multiply<C>(1, packs_, difference, [&](int c, int i, const P& x) {
      const P even = x + widen(first_half[c], P{}), o = odd[c][i];
      odd[c][i] = even + o;
      odd[c][i - packs_] = even - o;
    });
  }

  /// put(column, row, product) of matrix `which` with columns that lie one after the other.
  template <int C, class Put>
  void multiply(int which, int rows, const P* columns, const Put& put) const {
    constexpr int most = width > 1 ? 2 : 4;
    for (int i = 0; i < rows;) i += block<C, most>(which, i, rows, columns, put);
  }
  template <int C, int R, class Put>
  int block(int which, int i, int rows, const P* columns, const Put& put) const {
    if constexpr (R > 1)
      if (rows - i < R) return block<C, R - 1>(which, i, rows, columns, put);
    P total[C][R] = {};
    const S* f = reinterpret_cast<const S*>(columns);
    const double* A = table_ + (which * rows_ + i) * width;
    for (int j = 0; j < half_; ++j, A += 2 * rows_ * width) {
      decltype(entry(A)) a[R];
#pragma GCC unroll 4
      for (int r = 0; r < R; ++r) a[r] = entry(A + r * width);
#pragma GCC unroll 8
      for (int c = 0; c < C; ++c) {
        const P x = widen(f[c * packs_ * width + j], P{});
#pragma GCC unroll 4
        for (int r = 0; r < R; ++r) total[c][r] += a[r] * x;
      }
    }
    for (int c = 0; c < C; ++c)
      for (int r = 0; r < R; ++r) put(c, i + r, total[c][r]);
    return R;
  }
  static auto entry(const double* p) {
    if constexpr (width > 1)
      return Lanes<P>::load(p);
    else
      return *p;
  }

  const double* table_;
  int half_, packs_, rows_;
  P* work_;
};

}  // namespace
