// What a piece of code asks of the system: memory, locks, exceptions (counted by replacing malloc and its kin,
// pthread_mutex_lock and __cxa_throw), and system calls, output included (a child process in which the first one is
// fatal).
#pragma once

#include <functional>

#include "sanitized.hpp"

#if defined(__linux__) && defined(__GLIBC__) && !defined(FLEXARM_SANITIZED)
#define FLEXARM_WATCHES
#endif

namespace flexarm_test {

struct Asked {
  long allocations = 0, bytes = 0;  ///< malloc and its kin; operator new calls them
  long locks = 0;                   ///< mutexes and read-write locks taken, free or not
  long throws = 0;
};
/// Counts what f asks for on this thread.
Asked watch(const std::function<void()>& f);

enum class Calls { none, some, unknown };  ///< unknown: the kernel does not let a process forbid itself calls
/// Whether f makes any system call. Runs it in a child process, whose output is not buffered, so that output is one.
Calls system_calls(const std::function<void()>& f);

}  // namespace flexarm_test
