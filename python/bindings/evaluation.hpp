// Shared parts of evaluations from Python: vectors of one or many states, and reused memory.
#pragma once

#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <numeric>
#include <tuple>
#include <type_traits>

#include "flexarm/derivatives.hpp"
#include "flexarm/inverse.hpp"
#include "interpreter.hpp"

/// Vectors (..., n) as NumPy has them; of one state (n,).
using Vectors = py::array_t<double, py::array::c_style | py::array::forcecast>;

/// The number of vectors.
inline Eigen::Index count(const Vectors& x) {
  return std::accumulate(x.shape(), x.shape() + x.ndim() - 1, Eigen::Index{1}, std::multiplies<>());
}
/// One vector per row.
inline Eigen::Map<const Rows> rows(const Vectors& x) { return {x.data(), count(x), x.shape(x.ndim() - 1)}; }

/// A result for each of some vectors: a vector or a matrix.
class Answers {
 public:
  /// @param tail  the shape of one answer
  Answers(const Vectors& asked, std::initializer_list<py::ssize_t> tail);
  /// The k-th.
  Eigen::Map<Rows> operator[](Eigen::Index k) { return {data_ + k * height_ * width_, height_, width_}; }
  /// All, (..., tail).
  const Vectors& all() const { return array_; }

 private:
  Eigen::Index height_, width_;
  Vectors array_;
  double* data_;
};

/// Settings of an evaluation that determine its memory, beside the arm.
struct Setting {
  std::vector<bool> prescribed;
  std::vector<flexarm::Load> loads;
  bool operator==(const Setting& other) const;
};

/// A pool of reused memory for evaluations, as much as threads ever used at once. Safe from any thread.
template <class T>
class Pool {
  struct Kept {
    Setting setting;
    T memory;
  };

 public:
  /// As long as it lives, some memory is the caller's.
  class Lent {
   public:
    Lent(Pool& pool, std::unique_ptr<Kept> kept, bool keep) : pool_(pool), kept_(std::move(kept)), keep_(keep) {}
    Lent(const Lent&) = delete;
    Lent& operator=(const Lent&) = delete;
    ~Lent() {
      if (keep_) pool_.take_back(std::move(kept_));
    }
    T& operator*() const { return kept_->memory; }

   private:
    Pool& pool_;
    std::unique_ptr<Kept> kept_;
    bool keep_;
  };

  /// @param keep  whether the pool keeps the memory after this call
  /// @param make  makes some where none for this setting is idle
  template <class Make>
  Lent lend(Setting setting, bool keep, const Make& make) {
    std::unique_lock<std::mutex> lock(mutex_);
    const auto found = std::find_if(idle_.rbegin(), idle_.rend(), [&](const auto& k) { return k->setting == setting; });
    if (found != idle_.rend()) {
      std::unique_ptr<Kept> kept = std::move(*found);
      idle_.erase(std::next(found).base());
      return {*this, std::move(kept), keep};
    }
    lock.unlock();
    T memory = make(setting);
    return {*this, std::unique_ptr<Kept>(new Kept{std::move(setting), std::move(memory)}), keep};
  }

 private:
  static constexpr std::size_t kMost = 16;  // settings and threads may be many; those least recently used go

  void take_back(std::unique_ptr<Kept> kept) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (idle_.size() == kMost) idle_.erase(idle_.begin());
    idle_.push_back(std::move(kept));
  }

  std::mutex mutex_;
  std::vector<std::unique_ptr<Kept>> idle_;
};

/// An arm with the memory of its evaluations, which goes with it; but for matrices that are too large to keep.
class PyArm : public flexarm::Arm {
 public:
  using Arm::Arm;
  /// @param matrices  whether its matrices of nv^2 will be used
  template <class T>
  typename Pool<T>::Lent lend(Setting setting, bool matrices) const {
    const auto make = [this](const Setting& s) {
      if constexpr (std::is_same_v<T, flexarm::Workspace>)
        return T(*this, s.prescribed, s.loads);
      else
        return T(*this, s.loads);
    };
    return std::get<Pool<T>>(pools_).lend(std::move(setting), !matrices || nv() <= 1000, make);
  }
  Pool<flexarm::Workspace>::Lent workspace(Setting setting = {}, bool matrices = false) const {
    return lend<flexarm::Workspace>(std::move(setting), matrices);
  }
  /// Whether arguments (name: value) are of one state, and nothing is wrong with them: contiguous arrays of doubles,
  /// as long as they must be, all finite; and a ball's quaternion in q has a length, if `balls`.
  bool one_state(const py::dict& named, bool balls) const;

 private:
  mutable std::tuple<Pool<flexarm::Workspace>, Pool<flexarm::InverseDerivatives>, Pool<flexarm::JointReactions>,
                     Pool<flexarm::ForwardDerivatives>>
      pools_;
};

/// Runs visit(k), which takes about `each` evaluations, for each of n states; checks signals, and releases the
/// interpreter's lock if that takes long.
template <class Visit>
void for_states(const flexarm::Arm& arm, Eigen::Index n, Eigen::Index each, const Visit& visit) {
  constexpr Eigen::Index kShort = 256;  // rates, of which each takes about 0.1 us
  Lookout look;                         // while the thread has the lock
  std::optional<Unlocked> free;
  if (n * each * arm.nv() > kShort) free.emplace();
  for (Eigen::Index k = 0; k < n; ++k) {
    look();
    visit(k);
  }
}

void bind_dynamics(py::class_<PyArm, flexarm::Arm>& arm);  // ab, ci, inverse, kinematics
