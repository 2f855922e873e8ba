#define DOCTEST_CONFIG_IMPLEMENT_WITH_MAIN
#include <doctest/doctest.h>

/// Under the address sanitizer: tables that are kept for the life of the process (shape_tables.hpp) lie behind aligned
/// pointers, which its search for leaks does not follow.
extern "C" __attribute__((visibility("default"))) const char* __lsan_default_suppressions();
const char* __lsan_default_suppressions() { return "leak:shape_tables.hpp\n"; }
