// Counts a thread's allocations while its flag is set, by replacing malloc and its kin (operator new calls it). For
// programs of one source file; where malloc cannot be replaced, `counts_allocations` is false.
#pragma once

#include <cerrno>
#include <cstddef>
#include <cstdlib>

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define FLEXARM_SANITIZED
#endif
#endif

inline thread_local bool counting_allocations = false;
inline thread_local long allocations = 0;

#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) && !defined(FLEXARM_SANITIZED)
constexpr bool counts_allocations = true;
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);
void* malloc(std::size_t n) noexcept {
  allocations += counting_allocations;
  return __libc_malloc(n);
}
void* calloc(std::size_t n, std::size_t size) noexcept {
  allocations += counting_allocations;
  return __libc_calloc(n, size);
}
void* realloc(void* p, std::size_t n) noexcept {
  allocations += counting_allocations;
  return __libc_realloc(p, n);
}
void* aligned_alloc(std::size_t alignment, std::size_t n) noexcept {
  allocations += counting_allocations;
  return __libc_memalign(alignment, n);
}
int posix_memalign(void** out, std::size_t alignment, std::size_t n) noexcept {
  allocations += counting_allocations;
  *out = __libc_memalign(alignment, n);
  return *out ? 0 : ENOMEM;
}
}
#else
constexpr bool counts_allocations = false;
#endif
