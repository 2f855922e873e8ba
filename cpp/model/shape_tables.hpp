// Tables of a beam's shape functions at length 1. They depend neither on the length nor on the section nor on the
// material, so that beams which differ in these share them.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "flexarm/shape.hpp"
#include "flexarm/slice.hpp"

namespace flexarm {

/// A cache of the latest objects by their keys, with a limit of total bytes. For any thread.
template <class T>
class Kept {
 public:
  explicit Kept(std::size_t bytes) : room_(bytes) {}

  /// The result of `make` (a shared pointer), or the stored one for the same key. `bytes` returns its size.
  template <class Make, class Bytes>
  std::shared_ptr<const T> get(const std::string& key, const Make& make, const Bytes& bytes) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      for (auto it = kept_.begin(); it != kept_.end(); ++it)
        if (it->key == key) {
          kept_.splice(kept_.begin(), kept_, it);
          return it->value;
        }
    }
    const std::shared_ptr<const T> made = make();
    const std::size_t size = bytes(*made) + key.size();
    const std::lock_guard<std::mutex> lock(mutex_);
    kept_.push_front({key, made, size});
    used_ += size;
    while (used_ > room_ && kept_.size() > 1) {
      used_ -= kept_.back().size;
      kept_.pop_back();
    }
    return made;
  }

 private:
  struct Entry {
    std::string key;
    std::shared_ptr<const T> value;
    std::size_t size;
  };
  std::mutex mutex_;
  std::list<Entry> kept_;
  std::size_t room_, used_ = 0;
};

/// Numbers at the end of a key, bit by bit.
void append(std::string& key, const double* x, Eigen::Index n);

/// The shapes of a beam of length 1, and their key.
struct UnitShapes {
  std::vector<ShapeSet> shapes;  ///< one for each strain
  StrainCounts first;            ///< coordinate of each strain
  bool quadratic;                ///< whether slices have products
  std::string key;               ///< identifies them
  /// A coordinate of this strain at length L is L^power times that at length 1, of the same motion scaled by L.
  int power(int strain) const;
};
UnitShapes unit_shapes(const std::vector<ShapeSet>& shapes, const StrainCounts& first, bool quadratic);

/// A slice of a beam of length 1.
struct UnitSlice {
  std::array<ShapeValues, kStrains> values;
  std::vector<Product> products;
};
/// The slices at places that increase.
std::shared_ptr<const std::vector<UnitSlice>> unit_slices(const UnitShapes& unit, const std::vector<double>& places);
/// Integrals of the products of two strains, for each strain.
std::shared_ptr<const std::array<Eigen::MatrixXd, kStrains>> unit_stiffness(const UnitShapes& unit);

}  // namespace flexarm
