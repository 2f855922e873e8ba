// Dual numbers for the kernels: a number with its derivatives in some directions. Included by the kernels alone.
#pragma once

#include "arm/chain.hpp"

namespace {

/// A number T and its derivatives, `count` of type D: T a double and D a pack, of as many directions as there are
/// lanes, or of a few; or both a pack, of one direction each.
template <class T, class D, int count>
struct Dual {
  T x;
  D d[count];

  template <class F>
  static Dual map(const T& x, const F& f) {
    Dual out;
    out.x = x;
    for (int i = 0; i < count; ++i) out.d[i] = f(i);
    return out;
  }
  Dual operator-() const {
    return map(-x, [&](int i) { return -d[i]; });
  }
  friend Dual operator+(const Dual& a, const Dual& b) {
    return map(a.x + b.x, [&](int i) { return a.d[i] + b.d[i]; });
  }
  friend Dual operator-(const Dual& a, const Dual& b) {
    return map(a.x - b.x, [&](int i) { return a.d[i] - b.d[i]; });
  }
  friend Dual operator*(const Dual& a, const Dual& b) {
    return map(a.x * b.x, [&](int i) { return a.x * b.d[i] + b.x * a.d[i]; });
  }
  friend Dual operator+(const Dual& a, double b) {
    return map(a.x + b, [&](int i) { return a.d[i]; });
  }
  friend Dual operator-(const Dual& a, double b) { return a + (-b); }
  friend Dual operator*(const Dual& a, double b) {
    return map(a.x * b, [&](int i) { return a.d[i] * b; });
  }
  friend Dual operator+(double a, const Dual& b) { return b + a; }
  friend Dual operator-(double a, const Dual& b) {
    return map(a - b.x, [&](int i) { return -b.d[i]; });
  }
  friend Dual operator*(double a, const Dual& b) { return b * a; }
  friend Dual operator/(const Dual& a, const Dual& b) {
    const T over = 1.0 / b.x, x = a.x * over;
    return map(x, [&](int i) { return (a.d[i] - x * b.d[i]) * over; });
  }
  friend Dual operator/(const Dual& a, double b) { return a * (1.0 / b); }
  friend Dual operator/(double a, const Dual& b) {
    const T x = a / b.x, slope = -x / b.x;
    return map(x, [&](int i) { return slope * b.d[i]; });
  }
#define FLEXARM_IN_PLACE(op)                                           \
  Dual& operator op## = (const Dual& b) { return *this = *this op b; } \
  Dual& operator op## = (double b) { return *this = *this op b; }
  FLEXARM_IN_PLACE(+)
  FLEXARM_IN_PLACE(-)
  FLEXARM_IN_PLACE(*)
  FLEXARM_IN_PLACE(/)
#undef FLEXARM_IN_PLACE
  auto operator<(double b) const { return x < b; }
  auto operator>(double b) const { return x > b; }
  auto operator<(const Dual& b) const { return x < b.x; }
  auto operator>(const Dual& b) const { return x > b.x; }
};

template <class T, class D, int count>
struct Lanes<Dual<T, D, count>> : Lanes<T> {
  using L = Lanes<T>;
  using X = Dual<T, D, count>;
  using Mask = typename L::Mask;
  static constexpr int lag = 2;
  static X load(const double* p) {
    X out{};
    out.x = L::load(p);
    return out;
  }
  static X select(const Mask& m, const X& a, const X& b) {
    return X::map(L::select(m, a.x, b.x), [&](int i) { return m ? a.d[i] : b.d[i]; });
  }
  static Mask finite(const X& a) { return L::finite(a.x); }
  static X root(const X& a) {
    const T x = L::root(a.x), slope = 0.5 / x;
    return X::map(x, [&](int i) { return slope * a.d[i]; });
  }
  static X atan2(const X& y, const X& x) {
    const T over = 1.0 / (x.x * x.x + y.x * y.x);
    return X::map(L::atan2(y.x, x.x), [&](int i) { return over * (x.x * y.d[i] - y.x * x.d[i]); });
  }
  static X size(const X& a) { return select(a.x < 0.0, -a, a); }
  static X larger(const X& a, const X& b) { return select(a.x > b.x, a, b); }
  static X smaller(const X& a, const X& b) { return select(a.x < b.x, a, b); }
};

template <class T, class D, int count>
void sine_cosine(const Dual<T, D, count>& x, Dual<T, D, count>& s, Dual<T, D, count>& c) {
  T sine, cosine;
  sine_cosine(x.x, sine, cosine);
  const Dual<T, D, count> at = x;  // s or c may be x
  s = Dual<T, D, count>::map(sine, [&](int i) { return cosine * at.d[i]; });
  c = Dual<T, D, count>::map(cosine, [&](int i) { return -sine * at.d[i]; });
}

template <class T, class D, int count>
Dual<T, D, count> widen(const Dual<T, D, count>& x, const Dual<T, D, count>&) {
  return x;
}
template <class T, class D, int count>
void sum_lanes(const Dual<T, D, count>*, int, const Dual<T, D, count>*) {}

template <class T, class D, int count>
Dual<T, D, count> constant(const Dual<T, D, count>& x) {
  return Dual<T, D, count>{} + x.x;
}

// --- A direction in each lane. ---

using LaneDual = Dual<double, Pack, (FLEXARM_WIDTH < 8 ? 8 / FLEXARM_WIDTH : 1)>;
constexpr int kDirections = FLEXARM_WIDTH < 8 ? 8 : FLEXARM_WIDTH;

inline double slope_of(const LaneDual& x, int direction) {
  return x.d[direction / FLEXARM_WIDTH][direction % FLEXARM_WIDTH];
}

inline void add_slopes(double factor, const LaneDual& from, LaneDual& to) {
  for (int k = 0; k < kDirections / FLEXARM_WIDTH; ++k) to.d[k] += factor * from.d[k];
}

/// The answers of laws of state: their slopes times those of pose and velocity.
template <>
struct StateAnswers<LaneDual> {
  static void values(const StateLaw& law, const LaneDual* in, LaneDual* out) {
    double x[kAsked], found[6], by[6 * kDirectionsOfState];
    for (int i = 0; i < kAsked; ++i) x[i] = in[i].x;
    ask(law, x, in[kAsked].x, found);
    ask_slopes(law, x, in[kAsked].x, by);
    const LaneDual* R = in + 3;
    for (int i = 0; i < 6; ++i) {
      out[i] = LaneDual{} + found[i];
      const double* row = by + i * kDirectionsOfState;
      for (int d = 0; d < 3; ++d) {
        add_slopes(row[d], in[d], out[i]);
        const int a = (d + 1) % 3, b = (d + 2) % 3;  // the turn about axis d: row b of dR times row a of R
        for (int k = 0; k < 3; ++k) add_slopes(row[3 + d] * x[3 + 3 * a + k], R[3 * b + k], out[i]);
      }
      for (int d = 0; d < 6; ++d) add_slopes(row[6 + d], in[12 + d], out[i]);
    }
  }
};

/// Calls visit(first, count) with the slopes of x[first], x[first + 1], .. set to 1, each in a direction of its own.
template <class Visit>
void for_directions(LaneDual* x, int all, const Visit& visit) {
  constexpr int W = FLEXARM_WIDTH, D = kDirections;
  for (int first = 0; first < all; first += D) {
    const int count = all - first < D ? all - first : D;
    const auto seed = [&](double slope) {
      for (int k = 0; k < count; ++k) x[first + k].d[k / W][k % W] = slope;
    };
    seed(1.0);
    visit(first, count);
    seed(0.0);
  }
}

// --- A few directions: of one arm in a vector, and one after the other where points of a beam lie in the lanes. ---

constexpr int kFew = 4;
struct __attribute__((packed, aligned(8))) FewSlopes {
  typedef double Vector __attribute__((vector_size(8 * kFew)));
  Vector v;
  FewSlopes operator-() const { return {-v}; }
  friend FewSlopes operator+(const FewSlopes& a, const FewSlopes& b) { return {a.v + b.v}; }
  friend FewSlopes operator-(const FewSlopes& a, const FewSlopes& b) { return {a.v - b.v}; }
  friend FewSlopes operator*(double k, const FewSlopes& a) { return {k * a.v}; }
  friend FewSlopes operator*(const FewSlopes& a, double k) { return {k * a.v}; }
};
using Few = Dual<double, FewSlopes, 1>;  // as dense as so many doubles, so that sums over lanes are
using FewPacks = Dual<Pack, Pack, kFew>;
static_assert(sizeof(Few) == (1 + kFew) * sizeof(double), "numbers side by side");

inline FewPacks widen(const Few& x, const FewPacks&) {
  return FewPacks::map(widen(x.x, Pack{}), [&](int i) { return widen(x.d[0].v[i], Pack{}); });
}
inline void sum_lanes(const FewPacks* in, int n, Few* out) {
  sum_lanes(view<const Pack>(in), n * (1 + kFew), view<double>(out));
}
template <class S>
S lane_of(const FewPacks* column, int i) {
  constexpr int W = FLEXARM_WIDTH;
  const FewPacks& at = column[i / W];
  S out;
  out.x = at.x[i % W];
  for (int k = 0; k < kFew; ++k) out.d[0].v[k] = at.d[k][i % W];
  return out;
}
template <class S>
void put_lane(FewPacks* column, int i, const S& x) {
  constexpr int W = FLEXARM_WIDTH;
  FewPacks& at = column[i / W];
  at.x[i % W] = x.x;
  for (int k = 0; k < kFew; ++k) at.d[k][i % W] = x.d[0].v[k];
}

/// Integrals are linear: those of a dual number's parts, as of plain columns.
template <>
class Integral<Few, FewPacks> {
  using P = FewPacks;

 public:
  Integral(const double* table, int half, int packs, P* work)
      : plain_(table, half, packs, view<Pack>(work + 4 * packs)),
        points_(2 * packs),
        in_(view<Pack>(work)),
        out_(view<Pack>(work + 2 * packs)) {}

  template <class Slope>
  void operator()(int columns, const Slope& slope, P* out, int stride) const {
    for (int c = 0; c < columns; ++c) {
      const auto f = slope(c);
      for (int i = 0; i < points_; ++i) {
        const P x = f(i);
        in_[i] = x.x;
        for (int k = 0; k < kFew; ++k) in_[(1 + k) * points_ + i] = x.d[k];
      }
      plain_(1 + kFew, columns_at(in_, points_), out_, points_);
      P* to = out + c * stride;
      for (int i = 0; i < points_; ++i) {
        to[i].x = out_[i];
        for (int k = 0; k < kFew; ++k) to[i].d[k] = out_[(1 + k) * points_ + i];
      }
    }
  }
  void operator()(P* f, int stride, int columns) const { (*this)(columns, columns_at(f, stride), f, stride); }

 private:
  Integral<double, Pack> plain_;
  int points_;
  Pack *in_, *out_;
};

}  // namespace
