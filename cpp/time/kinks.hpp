// Kinks of forces by the state: where joints meet their stops, contacts touch, ropes get taut, limits begin to hold.
#pragma once

#include <vector>

#include "system.hpp"

namespace flexarm {

/// Between its kinks a force is smooth; here each such piece has a number.
class Kinks {
 public:
  explicit Kinks(const System& system);
  /// Whether any force has one.
  bool any() const { return count_ > 0; }
  /// Of how many forces.
  std::size_t count() const { return count_; }
  /// The pieces on which the forces are at the system's state, which has been driven (count numbers).
  void look(System& s, signed char* out);

 private:
  struct Stop {
    int q;                ///< coordinate, or the first of a ball
    bool ball, damped;    ///< damped: which sets in within the stop
    double lower, upper;  ///< of a ball, the angle
  };
  std::vector<Stop> stops_;  ///< of joints that are free
  std::vector<int> ropes_;
  bool limits_ = false;  ///< whether a law or a motor has one
  std::size_t count_ = 0;
  Eigen::VectorXd driven_;  ///< of all struts
  StrutMotion lines_;
  std::vector<double> touching_, pushes_;  ///< of contacts: what they would remember, and their forces
};

}  // namespace flexarm
