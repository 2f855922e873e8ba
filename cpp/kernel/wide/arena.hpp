// Memory that structures take piece by piece.
#pragma once

#include <cstddef>

namespace {

/// Gives pieces of a block of memory, one after the other. Of no block it gives none, and tells how large one must be:
/// so that the list of pieces stands in one place.
class Arena {
 public:
  Arena() = default;
  explicit Arena(void* at) : at_(static_cast<char*>(at)) {}

  bool counts() const { return at_ == nullptr; }
  std::size_t bytes() const { return bytes_; }

  /// Of n each.
  template <class... T>
  void take(int n, T*&... pieces) {
    (take_piece(pieces, static_cast<std::size_t>(n)), ...);
  }
  /// All zero.
  template <class... S>
  void take_zeros(int n, S*&... pieces) {
    take(n, pieces...);
    for (int i = 0; at_ && i < n; ++i) ((pieces[i] = S{}), ...);
  }
  /// In lines of the cache of its own; null where this counts.
  template <class T>
  T* take_lines(std::size_t n) {
    bytes_ = (bytes_ + 63) / 64 * 64;
    T* piece;
    take_piece(piece, n);
    return piece;
  }

 private:
  template <class T>
  void take_piece(T*& piece, std::size_t n) {
    piece = at_ ? reinterpret_cast<T*>(at_ + bytes_) : nullptr;
    bytes_ += n * sizeof(T);
  }

  char* at_ = nullptr;
  std::size_t bytes_ = 0;
};

}  // namespace
