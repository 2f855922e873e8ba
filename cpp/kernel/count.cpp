// Operations of one evaluation, by running it on numbers that count.
#include <vector>

#include "wide/scalar.hpp"

namespace {

/// A double that counts its operations.
struct Counted {
  double x;
  static thread_local long operations;
  Counted() = default;
  explicit Counted(double v) : x(v) {}
  Counted operator-() const { return Counted(-x); }
  bool operator<(double b) const { return x < b; }
  bool operator>(double b) const { return x > b; }
  bool operator<(const Counted& b) const { return x < b.x; }
  bool operator>(const Counted& b) const { return x > b.x; }
#define FLEXARM_COUNT(op)                                                                     \
  friend Counted operator op(const Counted& a, const Counted& b) { return note(a.x op b.x); } \
  friend Counted operator op(double a, const Counted& b) { return note(a op b.x); }           \
  friend Counted operator op(const Counted& a, double b) { return note(a.x op b); }           \
  Counted& operator op## = (const Counted& b) { return *this = *this op b; }                  \
  Counted& operator op## = (double b) { return *this = *this op b; }
  FLEXARM_COUNT(+)
  FLEXARM_COUNT(-)
  FLEXARM_COUNT(*)
  FLEXARM_COUNT(/)
#undef FLEXARM_COUNT
  static Counted note(double v) {
    ++operations;
    return Counted(v);
  }
};
thread_local long Counted::operations = 0;

template <>
struct Lanes<Counted> {
  static constexpr int width = 1, lag = 0;
  using Mask = bool;
  static Counted load(const double* p) { return Counted(*p); }
  static Counted select(bool m, const Counted& a, const Counted& b) { return m ? a : b; }
  static bool everywhere(bool m) { return m; }
  static bool all(bool m) { return m; }
  static Counted atan2(const Counted& y, const Counted& x) { return Counted::note(__builtin_atan2(y.x, x.x)); }
  static bool none_of(bool m) { return !m; }
  static bool finite(const Counted& a) { return a.x - a.x == 0.0; }
  static Counted size(const Counted& a) { return a < 0.0 ? -a : a; }
  static Counted root(const Counted& a) { return Counted::note(__builtin_sqrt(a.x)); }
  static Counted larger(const Counted& a, const Counted& b) { return a > b ? a : b; }
  static Counted smaller(const Counted& a, const Counted& b) { return a < b ? a : b; }
};

template <>
Counted number<Counted>(double x) {
  return Counted(x);
}

Counted widen(const Counted& x, const Counted&) { return x; }
void sum_lanes(const Counted*, int, const Counted*) {}

}  // namespace

#include "arm/composite.hpp"
#include "arm/elimination.hpp"
#include "setup/single.hpp"

namespace flexarm {
namespace lanes {

namespace {

template <class Sp>
long count(const KernelArm& arm, const double* at_q, const double* at_v) {
  using C = Chain<Sp, Counted>;
  const Memory memory(C::memory_needed(arm.layout()));
  C chain(arm.layout(), arm.numbers().data(), Arena(memory.get()));
  std::vector<Counted> q, v;
  for (int i = 0; i < arm.layout().nq; ++i) q.emplace_back(at_q[i]);
  for (int i = 0; i < arm.layout().nv; ++i) v.emplace_back(at_v[i]);
  std::vector<Counted> tau = v, a = v;
  Counted::operations = 0;
  chain.move(q.data(), v.data());
  ::forward(chain, chain.base(), tau.data(), a.data());
  return Counted::operations;
}

}  // namespace

long operation_count(const KernelArm& arm, const double* q, const double* v) {
  const KernelArm alone = arm.grouped(1, {});
  return alone.layout().planar ? count<::Plane<Counted>>(alone, q, v) : count<::Space<Counted>>(alone, q, v);
}

}  // namespace lanes
}  // namespace flexarm
