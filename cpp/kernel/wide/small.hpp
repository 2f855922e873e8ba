// Small systems of equations by elimination without pivoting: of matrices that are near the identity, or positive
// definite but for rows of it. Rows one after the other.
#pragma once

#include "wide/scalar.hpp"

namespace {

/// G = L U in place: below the diagonal L, above it U, on it one over U's.
template <class S>
void factor_small(S* G, int n) {
  for (int k = 0; k < n; ++k) {
    G[k * n + k] = number<S>(1.0) / G[k * n + k];
    for (int i = k + 1; i < n; ++i) {
      const S l = G[i * n + k] = G[i * n + k] * G[k * n + k];
      for (int j = k + 1; j < n; ++j) G[i * n + j] -= l * G[k * n + j];
    }
  }
}

/// x = G^-1 x.
template <class S, class V>
void solve_small(const S* G, int n, V* x) {
  for (int i = 1; i < n; ++i)
    for (int j = 0; j < i; ++j) x[i] -= G[i * n + j] * x[j];
  for (int i = n; i-- > 0;) {
    for (int j = i + 1; j < n; ++j) x[i] -= G[i * n + j] * x[j];
    x[i] = x[i] * G[i * n + i];
  }
}

}  // namespace
