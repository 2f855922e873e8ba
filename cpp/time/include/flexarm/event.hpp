// Events: functions of time and state whose zeros are to be found.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

namespace flexarm {

struct Event {
  /// Value at t (s), q (nq) and v (nv); a ball's quaternion is of unit length.
  std::function<double(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v)> value;
  int terminal = 0;   ///< the run ends at this occurrence (1: the first); 0: it does not
  int direction = 0;  ///< counts only zeros where the value rises (1) or falls (-1)
};

/// The occurrences of one event.
struct EventLog {
  std::vector<double> t;
  std::vector<Eigen::VectorXd> q, v;
  /// Of a run with tangents: accelerations, and derivatives of q and v at that time by each parameter (nv, np).
  std::vector<Eigen::VectorXd> a;
  std::vector<Eigen::MatrixXd> q_by, v_by;
};

}  // namespace flexarm
