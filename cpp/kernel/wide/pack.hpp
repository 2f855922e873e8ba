// Packs of doubles, one scenario (or one point of a beam) in each lane, by the compiler's vector types. Included by the
// kernels alone.
#pragma once

#ifdef __SSE2__
#include <immintrin.h>
#endif

#include "wide/scalar.hpp"

namespace {

typedef double Pack __attribute__((vector_size(8 * FLEXARM_WIDTH), may_alias));
using PackMask = decltype(Pack{} < Pack{});

template <>
struct Lanes<Pack> {
  static constexpr int width = FLEXARM_WIDTH, lag = 0;
  using Mask = PackMask;
  static Pack load(const double* p) {
    Pack x;
    __builtin_memcpy(&x, p, sizeof(x));
    return x;
  }
  static void store(double* p, const Pack& x) { __builtin_memcpy(p, &x, sizeof(x)); }
  static Pack select(const PackMask& m, const Pack& a, const Pack& b) { return m ? a : b; }
  static bool all(const PackMask& m) {
    long both = -1;
    for (int i = 0; i < width; ++i) both &= m[i];
    return both != 0;
  }
  static PackMask none_of(const PackMask& m) { return ~m; }  // where m is not
  static bool any(const PackMask& m) { return !all(~m); }
  static bool lane(const PackMask& m, int i) { return m[i] != 0; }
  static PackMask everywhere(bool m) { return PackMask{} - (m ? 1 : 0); }
  static Pack root(const Pack& x) {  // compilers make one instruction for each lane of a loop
#if FLEXARM_WIDTH == 8 && defined(__AVX512F__)
    return reinterpret_cast<Pack>(_mm512_maskz_sqrt_pd(0xff, reinterpret_cast<__m512d>(x)));
#elif FLEXARM_WIDTH == 4 && defined(__AVX__)
    return reinterpret_cast<Pack>(_mm256_sqrt_pd(reinterpret_cast<__m256d>(x)));
#elif FLEXARM_WIDTH == 2 && defined(__SSE2__)
    return reinterpret_cast<Pack>(_mm_sqrt_pd(reinterpret_cast<__m128d>(x)));
#else
    Pack y{};
    for (int i = 0; i < width; ++i) y[i] = __builtin_sqrt(x[i]);
    return y;
#endif
  }
  static Pack atan2(const Pack& y, const Pack& x) {
    Pack angle{};
    for (int i = 0; i < width; ++i) angle[i] = __builtin_atan2(y[i], x[i]);
    return angle;
  }
  static Pack size(const Pack& x) { return x < 0.0 ? -x : x; }
  static Pack larger(const Pack& a, const Pack& b) { return a > b ? a : b; }
  static Pack smaller(const Pack& a, const Pack& b) { return a < b ? a : b; }
  static PackMask finite(const Pack& x) { return x - x == 0.0; }
};

inline Pack widen(double x, const Pack&) { return x - Pack{}; }  // no operation: x + 0 is not -0 where x is
inline Pack widen(const Pack& x, const Pack&) { return x; }

/// Loads a factor once: compilers load it again for each product, and products then wait for loads.
inline void in_register(Pack& x) {
#if FLEXARM_WIDTH == 8
  asm("" : "+v"(x));
#elif FLEXARM_WIDTH == 4
  asm("" : "+x"(x));
#else
  (void)x;
#endif
}

/// Sums of neighbours `half` lanes apart: of a where that bit of the lane is 0, of b where it is 1.
inline Pack fold_pair(const Pack& a, const Pack& b, int half) {
  constexpr int w = FLEXARM_WIDTH;
#if defined(__GNUC__) && !defined(__clang__)
  PackMask own{}, other{};
  for (int l = 0; l < w; ++l) {
    const int from = l & half ? w : 0;
    own[l] = from + l;
    other[l] = from + (l ^ half);
  }
  return __builtin_shuffle(a, b, own) + __builtin_shuffle(a, b, other);
#else
  Pack sum{};
  for (int l = 0; l < w; ++l) sum[l] = l & half ? b[l] + b[l ^ half] : a[l] + a[l ^ half];
  return sum;
#endif
}

/// Sums over the lanes of each of n packs; where scalar and pack are one type there is nothing to sum.
inline void sum_lanes(const Pack*, int, const Pack*) {}
inline void sum_lanes(const Pack* in, int n, double* out) {
  constexpr int w = FLEXARM_WIDTH;
  int k = 0;
  for (; k + w <= n; k += w) {  // a square of them, folded in halves; out lies over in, and never ahead of it
    Pack fold[w];
    for (int i = 0; i < w; ++i) fold[i] = in[k + i];
#pragma GCC unroll 4
    for (int half = w / 2; half >= 1; half /= 2)
#pragma GCC unroll 4
      for (int i = 0; i < half; ++i) fold[i] = fold_pair(fold[i], fold[i + half], half);
    __builtin_memcpy(out + k, &fold[0], sizeof(Pack));
  }
  for (; k < n; ++k) {
    const Pack x = in[k];
    double sum = x[0];
    for (int i = 1; i < w; ++i) sum += x[i];
    out[k] = sum;
  }
}

}  // namespace
