// For the files that are compiled once for each instruction set.
#pragma once

#define FLEXARM_JOIN_(a, b) a##b
#define FLEXARM_JOIN(a, b) FLEXARM_JOIN_(a, b)
#define FLEXARM_TEXT_(a) #a
#define FLEXARM_TEXT(a) FLEXARM_TEXT_(a)

namespace {

/// A type as an argument.
template <class R>
struct Type {
  using type = R;
};

}  // namespace
