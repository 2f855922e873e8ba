// The kernels of arms side by side, one in each lane; compiled once for each instruction set, as isa.cpp is.
#include "wide/pack.hpp"  // before the others
// clang-format: keep
#include "isa.hpp"
#include "step/roll.hpp"

namespace {

/// f of the type of the chain of arms side by side.
template <class F>
decltype(auto) with_side(const Layout& layout, const F& f) {
  return layout.planar ? f(Type<Chain<Plane<Pack>, Pack>>{}) : f(Type<Chain<Space<Pack>, Pack>>{});
}

/// Of the arms, and of the bodies that they share.
std::size_t side_memory(const Layout& layout) {
  return with_side(layout, [&](auto t) { return 2 * decltype(t)::type::memory_needed(layout); });
}

void inverse_side_by_side(const Layout& layout, const double* numbers, const bool* own, void* memory, bool* known,
                          const double* wrenches, const double* q, const double* v, const double* a, double* tau) {
  with_side(layout, [&](auto t) {
    const auto packs = [](const double* x) { return view<const Pack>(x); };
    Arena arena(memory);
    typename decltype(t)::type chain(layout, numbers, arena);
    const typename decltype(t)::type kept(layout, numbers, arena);
    for (int i = 0; i < 6 * layout.loads; ++i) chain.wrench[i] = packs(wrenches)[i];
    chain.move_beside(packs(q), packs(v), own, kept.state, known);
    chain.forces(chain.base(), packs(a), view<Pack>(tau));
  });
}

/// f of the type of this job's Roller.
template <class Sp, class F>
void with_roller(const Roll& job, const F& f) {
  Methods::visit(job.method, [&](auto row) { f(Type<Roller<Chain<Sp, Pack>, decltype(row)::template On>>{}); });
}
template <class F>
void with_roller(const Roll& job, const F& f) {
  if (job.width == 1)
    job.layout->planar ? with_roller<Plane<double>>(job, f) : with_roller<Space<double>>(job, f);
  else
    job.layout->planar ? with_roller<Plane<Pack>>(job, f) : with_roller<Space<Pack>>(job, f);
}

std::size_t roll_memory(Roll& job) {
  std::size_t bytes = 0;
  with_roller(job, [&](auto t) {
    Arena none;
    typename decltype(t)::type(job, none);
    bytes = none.bytes();
  });
  return bytes;
}

void roll(Roll& job, void* memory, const double* q, const double* v) {
  with_roller(job, [&](auto t) {
    Arena arena(memory);
    typename decltype(t)::type(job, arena).run(q, v);
  });
}

}  // namespace

namespace flexarm {
namespace lanes {

extern const LaneKernels FLEXARM_JOIN(lanes_, FLEXARM_ISA);
const LaneKernels FLEXARM_JOIN(lanes_, FLEXARM_ISA){FLEXARM_WIDTH, side_memory, inverse_side_by_side, roll_memory,
                                                    roll};

}  // namespace lanes
}  // namespace flexarm
