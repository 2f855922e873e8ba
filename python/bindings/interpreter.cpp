#include "interpreter.hpp"

#include <atomic>
#include <thread>

namespace {

constexpr auto kPatience = std::chrono::seconds(2);  // at the process's end, for runs to stop

std::atomic<int> running{0};         // threads without the lock
std::atomic<bool> ends{false};       // the process
std::atomic<std::thread::id> ender;  // which thread ends it

/// Stops the runs of other threads. Those that do not check in time are blocked when they request the lock.
void end_runs() {
  ender = std::this_thread::get_id();
  ends = true;
  const auto begun = std::chrono::steady_clock::now();
  PyThreadState* state = PyEval_SaveThread();  // lets threads in Python reach their checks
  while (running > 0 && std::chrono::steady_clock::now() - begun < kPatience)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  PyEval_RestoreThread(state);
}

}  // namespace

bool process_ends() { return ends && ender.load() != std::this_thread::get_id(); }

void wait_for_the_end() {
  for (;;) std::this_thread::sleep_for(std::chrono::hours(1));
}

Unlocked::Unlocked() : state_(PyEval_SaveThread()) {
  if (process_ends()) wait_for_the_end();
  ++running;
}

Unlocked::~Unlocked() {
  --running;
  if (process_ends()) wait_for_the_end();
  held_at_the_end([this] { PyEval_RestoreThread(state_); });
}

bool Lookout::look(double now) {
  if (process_ends()) return false;
  const Locked lock;
  if (held_at_the_end([] { return PyErr_CheckSignals(); }) != 0) {
    if (!PyErr_ExceptionMatches(PyExc_KeyboardInterrupt)) throw py::error_already_set();
    PyErr_Clear();  // the caller raises it again, with the result so far
    return false;
  }
  if (progress_.is_none() || looked_ - told_ < std::chrono::milliseconds(90)) return true;
  told_ = looked_;
  try {
    call(progress_, now);
  } catch (const flexarm::Interrupted&) {
    return false;
  }
  return true;
}

void bind_interpreter() {
  py::module_::import("atexit").attr("register")(py::cpp_function(&end_runs));
  py::register_exception_translator([](std::exception_ptr p) {
    try {
      if (p) std::rethrow_exception(p);
    } catch (const flexarm::Interrupted&) {
      PyErr_SetNone(PyExc_KeyboardInterrupt);
    }
  });
}
