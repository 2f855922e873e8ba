// Compiled once for each instruction set, with FLEXARM_ISA its name and FLEXARM_WIDTH its doubles. Everything but the
// table is in an unnamed namespace, so that no function of one set can end up in another's path.
#include "lanes/pack.hpp"  // what the others need first
// clang-format: keep
#include "lanes/roll.hpp"
#include "lanes/tangent.hpp"

namespace {

template <class Sp>
using Single = Chain<Sp, Pack>;

template <class F>
decltype(auto) on(void* self, const F& f) {
  const Layout& layout = **static_cast<const Layout**>(self);
  char* chain = static_cast<char*>(self) + 64;
  if (layout.planar) return f(*reinterpret_cast<Single<Plane<double>>*>(chain));
  return f(*reinterpret_cast<Single<Space<double>>*>(chain));
}

constexpr std::size_t kHead = 192;  // the layout's address, and the chain

std::size_t memory(const Layout& layout) {
  return kHead +
         (layout.planar ? Single<Plane<double>>::memory_needed(layout) : Single<Space<double>>::memory_needed(layout));
}

template <class Sp>
void lay_out(const Layout& layout, const double* numbers, char* at) {
  static_assert(sizeof(Single<Sp>) <= kHead - 64, "the chain's head");
  const Single<Sp> chain(layout, numbers, at + kHead);
  __builtin_memcpy(at + 64, &chain, sizeof(chain));
}

void begin(const Layout& layout, const double* numbers, void* memory) {
  char* at = static_cast<char*>(memory);
  *reinterpret_cast<const Layout**>(at) = &layout;
  if (layout.planar)
    lay_out<Plane<double>>(layout, numbers, at);
  else
    lay_out<Space<double>>(layout, numbers, at);
}

template <class C>
auto base_of(const C& chain) {
  const double* p = chain.numbers;
  return C::Space::read(p);
}

void load(void* self, const double* wrenches) {
  on(self, [&](auto& chain) {
    for (int i = 0; i < 6 * chain.layout.loads; ++i) chain.wrench[i] = wrenches[i];
  });
}

bool forward(void* self, const double* q, const double* v, const double* tau, double* a) {
  return on(self, [&](auto& chain) {
    chain.move(q, v);
    const bool good = chain.template inward<true, true, true>(tau, a, Shift{});
    chain.template outward<true>(base_of(chain), a);
    return good;
  });
}

void inverse(void* self, const double* q, const double* v, const double* a, double* tau) {
  on(self, [&](auto& chain) {
    chain.move(q, v);
    chain.forces(base_of(chain), a, tau);
  });
}

bool factor(void* self, const Shift& shift, const double* v, double* twice_kinetic) {
  return on(self, [&](auto& chain) {
    *twice_kinetic = chain.twice_kinetic(v);
    return chain.template inward<true, false, false>(nullptr, nullptr, shift);
  });
}

void solve(void* self, const double* r, double* x) {
  on(self, [&](auto& chain) {
    chain.template inward<false, true, false>(r, nullptr, Shift{});
    for (int i = 0; i < chain.layout.nodes; ++i)
      if (chain.layout.node[i].given) x[chain.layout.node[i].v] = 0.0;
    chain.template outward<false>({}, x);
  });
}

std::size_t roll_memory(const Roll& job) {
  return job.layout->planar ? Roller<Plane<Pack>>::memory(job) : Roller<Space<Pack>>::memory(job);
}

void roll(Roll& job, void* memory, const double* q, const double* v) {
  if (job.layout->planar)
    Roller<Plane<Pack>>(job, static_cast<char*>(memory)).run(q, v);
  else
    Roller<Space<Pack>>(job, static_cast<char*>(memory)).run(q, v);
}

std::size_t slopes_memory(const Layout& layout) {
  return layout.planar ? Slopes<Plane<LaneDual>>::memory(layout) : Slopes<Space<LaneDual>>::memory(layout);
}

void slopes(const Layout& layout, const double* numbers, const double* wrenches, void* memory, const double* q,
            const double* v, const double* a, double* by_q, double* by_v) {
  if (layout.planar)
    Slopes<Plane<LaneDual>>::run(layout, numbers, wrenches, memory, q, v, a, by_q, by_v);
  else
    Slopes<Space<LaneDual>>::run(layout, numbers, wrenches, memory, q, v, a, by_q, by_v);
}

}  // namespace

#define FLEXARM_JOIN_(a, b) a##b
#define FLEXARM_JOIN(a, b) FLEXARM_JOIN_(a, b)
#define FLEXARM_TEXT_(a) #a
#define FLEXARM_TEXT(a) FLEXARM_TEXT_(a)

namespace flexarm {
namespace lanes {

extern const Kernels FLEXARM_JOIN(kernels_, FLEXARM_ISA);
const Kernels FLEXARM_JOIN(kernels_, FLEXARM_ISA){FLEXARM_TEXT(FLEXARM_ISA),
                                                  FLEXARM_WIDTH,
                                                  memory,
                                                  begin,
                                                  load,
                                                  forward,
                                                  inverse,
                                                  factor,
                                                  solve,
                                                  roll_memory,
                                                  roll,
                                                  slopes_memory,
                                                  slopes};

}  // namespace lanes
}  // namespace flexarm
