// The interpreter's lock, its signals, and its end.
//
// A daemon thread may be in the middle of a run when the main thread ends the process. Asked for the lock then, Python
// ends the thread (pthread_exit), which unwinds C++ frames that must not be unwound, and the process aborts. So runs
// that detect the end stop, and their threads wait for the process to end; the others are blocked before anything is
// unwound.
#pragma once

#include <chrono>

#include "bindings.hpp"
#include "flexarm/trajectory.hpp"

#if defined(__GLIBCXX__)
#include <cxxabi.h>
#endif

/// Whether the process is ending, seen from a thread that does not end it.
bool process_ends();
/// Waits for the process to end.
[[noreturn]] void wait_for_the_end();

/// f(), where Python may end the thread.
template <class F>
auto held_at_the_end(const F& f) -> decltype(f()) {
#if defined(__GLIBCXX__)
  try {
    return f();
  } catch (abi::__forced_unwind&) {
    wait_for_the_end();
  }
#else
  return f();
#endif
}

/// As long as it lives, the thread runs without the interpreter's lock.
class Unlocked {
 public:
  Unlocked();
  ~Unlocked();
  Unlocked(const Unlocked&) = delete;
  Unlocked& operator=(const Unlocked&) = delete;

 private:
  PyThreadState* state_;
};

/// As long as it lives, the thread has the lock again.
class Locked {
 public:
  Locked() : state_(held_at_the_end([] { return PyGILState_Ensure(); })) {}
  ~Locked() { PyGILState_Release(state_); }
  Locked(const Locked&) = delete;
  Locked& operator=(const Locked&) = delete;

 private:
  PyGILState_STATE state_;
};

/// Calls a user's function with the lock held; Ctrl-C meanwhile ends the run with the result so far.
template <class... Args>
py::object call(const py::object& law, Args&&... args) {
  const py::tuple given = py::make_tuple(std::forward<Args>(args)...);
  PyObject* answer = held_at_the_end([&] { return PyObject_CallObject(law.ptr(), given.ptr()); });
  if (answer) return py::reinterpret_steal<py::object>(answer);
  if (!PyErr_ExceptionMatches(PyExc_KeyboardInterrupt)) throw py::error_already_set();
  PyErr_Clear();
  throw flexarm::Interrupted();
}

/// Checks for Ctrl-C and the end of the process twenty times a second, from a thread without the lock, and calls
/// `progress`, if that is not None, ten times a second.
class Lookout {
 public:
  explicit Lookout(py::object progress = py::none()) : progress_(std::move(progress)) {}

  /// @return false once the run must stop; exceptions of signal handlers and `progress` other than KeyboardInterrupt
  /// pass through
  bool operator()(double now) {
    if (stopped_) return false;
    const auto clock = std::chrono::steady_clock::now();
    if (clock - looked_ < std::chrono::milliseconds(50)) return true;
    looked_ = clock;
    stopped_ = !look(now);
    return !stopped_;
  }
  /// For callers without a partial result: throws Interrupted.
  void operator()() {
    if (!(*this)(0.0)) throw flexarm::Interrupted();
  }

 private:
  bool look(double now);

  py::object progress_;
  std::chrono::steady_clock::time_point looked_ = std::chrono::steady_clock::now(), told_{};
  bool stopped_ = false;
};

void bind_interpreter();
