#include "watch.hpp"

#ifdef FLEXARM_WATCHES

#include <dlfcn.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <pthread.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstddef>
#include <cstdio>
#include <cstdlib>

namespace {

thread_local bool watching = false;
thread_local flexarm_test::Asked asked;

void allocated(std::size_t n) {
  if (!watching) return;
  ++asked.allocations;
  asked.bytes += static_cast<long>(n);
}

template <class F>
F next(const char* name) {
  return reinterpret_cast<F>(dlsym(RTLD_NEXT, name));
}

}  // namespace

#define FLEXARM_EXPORTED __attribute__((visibility("default")))
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);
FLEXARM_EXPORTED void* malloc(std::size_t n) noexcept {
  allocated(n);
  return __libc_malloc(n);
}
FLEXARM_EXPORTED void* calloc(std::size_t n, std::size_t size) noexcept {
  allocated(n * size);
  return __libc_calloc(n, size);
}
FLEXARM_EXPORTED void* realloc(void* p, std::size_t n) noexcept {
  allocated(n);
  return __libc_realloc(p, n);
}
FLEXARM_EXPORTED void* aligned_alloc(std::size_t alignment, std::size_t n) noexcept {
  allocated(n);
  return __libc_memalign(alignment, n);
}
FLEXARM_EXPORTED int posix_memalign(void** out, std::size_t alignment, std::size_t n) noexcept {
  allocated(n);
  *out = __libc_memalign(alignment, n);
  return *out ? 0 : ENOMEM;
}

FLEXARM_EXPORTED int pthread_mutex_lock(pthread_mutex_t* m) noexcept {
  static const auto real = next<int (*)(pthread_mutex_t*)>("pthread_mutex_lock");
  asked.locks += watching;
  return real(m);
}
FLEXARM_EXPORTED int pthread_rwlock_rdlock(pthread_rwlock_t* m) noexcept {
  static const auto real = next<int (*)(pthread_rwlock_t*)>("pthread_rwlock_rdlock");
  asked.locks += watching;
  return real(m);
}
FLEXARM_EXPORTED int pthread_rwlock_wrlock(pthread_rwlock_t* m) noexcept {
  static const auto real = next<int (*)(pthread_rwlock_t*)>("pthread_rwlock_wrlock");
  asked.locks += watching;
  return real(m);
}
FLEXARM_EXPORTED [[noreturn]] void __cxa_throw(void* what, void* type, void (*destroy)(void*)) {
  static const auto real = next<void (*)(void*, void*, void (*)(void*))>("__cxa_throw");
  asked.throws += watching;
  real(what, type, destroy);
  std::abort();  // not reached
}
}

namespace flexarm_test {

Asked watch(const std::function<void()>& f) {
  asked = {};
  watching = true;
  f();
  watching = false;
  return asked;
}

Calls system_calls(const std::function<void()>& f) {
  constexpr int refused = 3;
  std::fflush(nullptr);
  const pid_t child = fork();
  if (child == 0) {
    std::setvbuf(stdout, nullptr, _IONBF, 0);
    std::setvbuf(stderr, nullptr, _IONBF, 0);
    f();  // pages that were not touched yet are faults, not calls; what is set up lazily is set up now
    std::signal(SIGSYS, SIG_DFL);
    sock_filter filter[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_exit_group, 0, 1),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS),
    };
    const sock_fprog program{sizeof filter / sizeof filter[0], filter};
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 || prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) != 0)
      _exit(refused);
    f();
    _exit(0);
  }
  int status = 0;
  if (child < 0 || waitpid(child, &status, 0) != child) return Calls::unknown;
  if (WIFSIGNALED(status) && WTERMSIG(status) == SIGSYS) return Calls::some;
  return WIFEXITED(status) && WEXITSTATUS(status) == 0 ? Calls::none : Calls::unknown;
}

}  // namespace flexarm_test

#endif
