// Products of matrices, in columns as dual numbers have them.
#pragma once

#include "slopes/tangent.hpp"

namespace {

/// Columns are taken as many at a time as a dual number has directions.
constexpr int kColumns = kDirections;

/// out = add + A B, of so many rows of A, n columns of A, and kColumns of B. Strides are of rows.
inline void add_product(const double* add, int add_stride, const double* A, int A_stride, const double* B, int B_stride,
                        int rows, int n, double* out, int out_stride) {
  constexpr int W = FLEXARM_WIDTH, R = 4;
  const auto some = [&](auto count, int r, int column) {
    constexpr int C = decltype(count)::value;
    Pack sum[C];
#pragma GCC unroll 4
    for (int k = 0; k < C; ++k) sum[k] = add ? Lanes<Pack>::load(add + (r + k) * add_stride + column) : Pack{};
    for (int j = 0; j < n; ++j) {
      const Pack b = Lanes<Pack>::load(B + j * B_stride + column);
#pragma GCC unroll 4
      for (int k = 0; k < C; ++k) sum[k] += A[(r + k) * A_stride + j] * b;
    }
#pragma GCC unroll 4
    for (int k = 0; k < C; ++k) Lanes<Pack>::store(out + (r + k) * out_stride + column, sum[k]);
  };
  for (int column = 0; column < kColumns; column += W) {
    int r = 0;
    for (; r + R <= rows; r += R) some(Count<R>{}, r, column);
    for (; r < rows; ++r) some(Count<1>{}, r, column);
  }
}

}  // namespace
