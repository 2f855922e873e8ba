// Numbers that kernels read in packs: they begin where a cache line does.
#pragma once

#include <new>
#include <vector>

namespace flexarm {
namespace lanes {

template <class T>
struct Aligned {
  using value_type = T;
  static constexpr std::align_val_t line{64};
  Aligned() = default;
  template <class U>
  Aligned(const Aligned<U>&) {}
  T* allocate(std::size_t n) { return static_cast<T*>(::operator new(n * sizeof(T), line)); }
  void deallocate(T* p, std::size_t) { ::operator delete(p, line); }
  friend bool operator==(const Aligned&, const Aligned&) { return true; }
  friend bool operator!=(const Aligned&, const Aligned&) { return false; }
};
using Numbers = std::vector<double, Aligned<double>>;

}  // namespace lanes
}  // namespace flexarm
