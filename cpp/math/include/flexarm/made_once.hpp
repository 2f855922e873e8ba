// Data derived from an immutable object by higher rooms: the model stores the kernels' data without knowing the
// kernels.
#pragma once

#include <memory>
#include <mutex>

namespace flexarm {

/// A slot for one object, which is made at the first request, by any thread, and shared by copies.
class MadeOnce {
 public:
  /// @param make  returns the object; all requests must be for the same
  template <class T, class Make>
  const T& get(const Make& make) const {
    std::call_once(place_->made, [&] { place_->thing = std::make_shared<const T>(make()); });
    return *static_cast<const T*>(place_->thing.get());
  }

 private:
  struct Place {
    std::once_flag made;
    std::shared_ptr<const void> thing;
  };
  std::shared_ptr<Place> place_ = std::make_shared<Place>();
};

}  // namespace flexarm
