// The arm as IDA sees it, and the two ways to solve its linear systems. No SUNDIALS header but in the .cpp files.
#pragma once

#include <exception>
#include <limits>
#include <optional>

#include "flexarm/ab.hpp"
#include "flexarm/derivatives.hpp"
#include "flexarm/event.hpp"
#include "flexarm/ida.hpp"
#include "system.hpp"
#include "tangents.hpp"

namespace flexarm {

/// The derivatives in the dense Jacobian.
struct DenseJacobian {
  InverseDerivatives derivatives;
  Eigen::MatrixXd rate_by_q, rate_by_v;
  DenseJacobian(const Arm& arm, const std::vector<Load>& loads)
      : derivatives(arm, loads), rate_by_q(arm.nq(), arm.nq()), rate_by_v(arm.nq(), arm.nv()) {}
};

/// The approximate inverse of dF/dy + cj dF/dy' = [cj - dE, -E; K, cj M + C] in O(N): elastic and joint forces alone
/// are kept of K and C, and nothing of dE. Then dq = (r1 + E dv) / cj leaves S cj dv = r2 - K r1 / cj, with S = M + C /
/// cj + K / cj^2, which factor_shifted eliminates. Its own workspace keeps the place where it was made.
class ChainInverse {
 public:
  ChainInverse(const Arm& arm, const std::vector<bool>& prescribed, const Control& control);
  /// @return whether S is positive definite
  bool factor(const System& s, double cj);
  /// dq (nq) and dv (nv) of r1 (nq) and r2 (nv); zero in prescribed coordinates where r1 and r2 are.
  void solve(const Eigen::VectorXd& r1, const Eigen::VectorXd& r2, double cj, Eigen::VectorXd& dq, Eigen::VectorXd& dv);

 private:
  const Arm* arm_;
  Workspace ws_;
  Eigen::VectorXd turn_;  ///< r1 as rates times time (nv)
  Eigen::VectorXd rhs_;
  std::vector<Eigen::Matrix<double, 4, 3>> ball_;  ///< E of each link's quaternion: of balls only
};

/// State y = [q; v] of the free coordinates and rates; of arms with loops [q; v; y; m], in the stabilised form of index
/// 2 (Gear, Gupta & Leimkuhler 1985): dq/dt = E (v + W G m), M dv/dt = .. + G y, g = 0, dg/dt = 0. W lets joints close
/// the loops, and elastic coordinates hardly, as these would have to bend stiff beams.
struct IdaSystem : System {
  Eigen::VectorXd dq;                  // rates of all coordinates
  std::optional<DenseJacobian> dense;  // one of the two
  std::optional<ChainInverse> chain;
  Eigen::VectorXd r1, r2, x1, x2;                            // of all coordinates, for the chain
  double driven = std::numeric_limits<double>::quiet_NaN();  // time of the drives' present values
  std::exception_ptr thrown;                                 // by a drive or an event, inside a C callback
  std::string message;                                       // IDA's last word
  void* memory = nullptr;                                    // IDA's
  const std::vector<Event>* events = nullptr;
  std::vector<int> rows;           // of loops: those that do not depend on others
  Eigen::VectorXd yielding;        // W, of the rates: 1 of joints
  Eigen::MatrixXd G;               // of all rigid rows, by columns
  Eigen::Matrix3Xd found;          // g and its derivatives by time, of all rigid rows
  Eigen::VectorXd shifted, drift;  // v + W G m; m
  std::optional<StateTangents> tangents;
  IdaSystem(const Problem& problem, Control& control_)
      : System(problem, control_),
        dq(q),
        r1(Eigen::VectorXd::Zero(arm.nq())),
        r2(Eigen::VectorXd::Zero(arm.nv())),
        x1(r1),
        x2(r2) {}

  int n_loops() const { return static_cast<int>(rows.size()); }
  int size() const { return n_q() + n_v() + 2 * n_loops(); }
  /// Takes the rows of loops that are independent where the chain is.
  void choose_rows();
  /// Whether all rigid rows are closed, those that were not chosen, too, as far as the tolerance lets them.
  bool loops_closed(double rtol);
  /// g and its derivatives, and G, where the chain is.
  void find_loops();
  /// Current coordinates and rates from y, accelerations from yp if given, and the drives at time t.
  void set(double t, const double* y, const double* yp);
  /// Contacts go on from y, at the end of a step.
  void remember(double t, const double* y);
  /// Whether the coordinates and rates of y are; see Arm.
  bool within_reach(const double* y) const;
  /// y and dy/dt of the current coordinates, rates and accelerations.
  std::pair<Eigen::VectorXd, Eigen::VectorXd> state();
  /// F(t, y, y') at the state of `set`.
  /// @return whether it is finite
  bool residual(const double* yp, double* r);

  /// The answer of a C callback whose data is a system: f(system); -1, which ends the run, where this throws.
  template <class F>
  static int answer(void* data, const F& f) {
    IdaSystem& s = *static_cast<IdaSystem*>(data);
    try {
      return f(s);
    } catch (...) {
      s.thrown = std::current_exception();
      return -1;
    }
  }
};

}  // namespace flexarm
