// Events: functions of time and state whose zeros are to be found.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <functional>
#include <vector>

namespace flexarm {

struct Event {
  /// Value at t (s), q (nq) and v (nv); a ball's quaternion is of unit length.
  std::function<double(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v)> value;
  int terminal = 0;   ///< the run ends at this occurrence (1: the first); 0: it does not
  int direction = 0;  ///< counts only zeros where the value rises (1) or falls (-1)
};

/// Vectors of one length, in one piece of memory.
class VectorList {
 public:
  void reserve(std::size_t count, Eigen::Index length) { numbers_.reserve(count * static_cast<std::size_t>(length)); }
  void push_back(const Eigen::VectorXd& x) {
    length_ = x.size();
    numbers_.insert(numbers_.end(), x.begin(), x.end());
  }
  Eigen::Map<const Eigen::VectorXd> operator[](std::size_t k) const {
    return {numbers_.data() + k * static_cast<std::size_t>(length_), length_};
  }
  Eigen::Map<const Eigen::VectorXd> back() const { return {numbers_.data() + numbers_.size() - length_, length_}; }
  void append(const VectorList& other) {
    length_ = std::max(length_, other.length_);
    numbers_.insert(numbers_.end(), other.numbers_.begin(), other.numbers_.end());
  }

 private:
  Eigen::Index length_ = 0;
  std::vector<double> numbers_;
};

/// The occurrences of one event.
struct EventLog {
  std::vector<double> t;
  VectorList q, v;
  /// Of a run with tangents: accelerations, and derivatives of q and v at that time by each parameter (nv, np).
  std::vector<Eigen::VectorXd> a;
  std::vector<Eigen::MatrixXd> q_by, v_by;
};

}  // namespace flexarm
