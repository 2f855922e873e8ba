// Memory as numbers of another kind: the casts of the kernels.
#pragma once

namespace {

/// The same memory as packs or as the scalars in their lanes, as records or as the numbers that these consist of.
template <class To, class From>
To* view(From* at) {
  static_assert(__is_trivially_copyable(To) && __is_trivially_copyable(From), "plain numbers");
  static_assert(sizeof(To) % sizeof(From) == 0 || sizeof(From) % sizeof(To) == 0, "whole numbers");
  return reinterpret_cast<To*>(at);
}

}  // namespace
