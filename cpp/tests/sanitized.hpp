// Whether the tests run under a sanitizer, where the largest loops take fewer rounds: it looks for memory errors, which
// do not depend on the number of rounds.
#pragma once

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define FLEXARM_SANITIZED
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define FLEXARM_SANITIZED
#endif

namespace flexarm_test {
#ifdef FLEXARM_SANITIZED
inline constexpr bool kSanitized = true;
#else
inline constexpr bool kSanitized = false;
#endif
}  // namespace flexarm_test
