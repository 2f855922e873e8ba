// Processor time of this thread, and statistics of times.
#pragma once

#include <time.h>

#include <algorithm>
#include <cstdio>
#include <vector>

inline double microseconds() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);  // not affected by other threads
  return 1e6 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_nsec);
}

/// Prints median, p99.9 and largest of times (us). @return the median
inline double print_times(const char* what, std::vector<double> times) {
  std::sort(times.begin(), times.end());
  const auto at = [&](double p) { return times[static_cast<std::size_t>(p * static_cast<double>(times.size() - 1))]; };
  std::printf("%-10s median %7.1f us, p99.9 %7.1f us, largest %7.1f us\n", what, at(0.5), at(0.999), at(1.0));
  return at(0.5);
}
