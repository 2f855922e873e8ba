// What is made of an object that never changes, by those who know more than it does: the model keeps what the kernels
// make of it, and knows no kernel.
#pragma once

#include <memory>
#include <mutex>

namespace flexarm {

/// A place for one thing, which is made at the first asking, by any thread, and shared by copies.
class MadeOnce {
 public:
  /// @param make  gives the thing; everyone who asks must ask for the same
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
