// Derivatives of a system's state by parameters, along a run.
#pragma once

#include <Eigen/LU>
#include <memory>

#include "flexarm/derivatives.hpp"
#include "flexarm/parameter.hpp"
#include "system.hpp"

namespace flexarm {

/// A parameter's neighbour as a system of its own, with controllers of its own.
struct Near {
  const Neighbour& of;
  Control control;
  System system;
  explicit Near(const Neighbour& neighbour)
      : of(neighbour), control(of.problem.control()), system(of.problem, control) {}
};
/// The neighbours of parameters, which must outlive them: a list of each.
class Nears : public std::vector<std::vector<std::unique_ptr<Near>>> {
 public:
  explicit Nears(const std::vector<Parameter>& parameters);
  /// Derivatives of the start (nv, np).
  Eigen::MatrixXd q0() const;
  Eigen::MatrixXd v0() const;
  /// Runs their controllers that are due up to time `until`, each at its own state at time t, by the tangents of the
  /// run's. @return whether any force has changed
  bool sample(double t, double until, const System& run, const Eigen::MatrixXd& q, const Eigen::MatrixXd& v,
              const Eigen::MatrixXd& a);
  /// Derivatives of the forces that they hold (nv, np).
  Eigen::MatrixXd held() const;

 private:
  template <class Value>
  Eigen::MatrixXd sum(const Value& value) const;
};

/// Tangents of the state, a column for each parameter p: with the residual r(t, q, v, a; p) = inverse dynamics
/// less the forces, they keep to  M da + C dv + K dq + dr/dp = 0.  K, C and M are exact; dr/dp at a given state comes
/// from the parameters' neighbours, as do the tangents of prescribed motions, with which it is taken.
class StateTangents {
 public:
  /// @param parameters  must outlive this; their controllers go along with the run's
  /// @throws std::invalid_argument for neighbours that are not made like the system
  StateTangents(System& system, const std::vector<Parameter>& parameters);
  int size() const { return static_cast<int>(q.cols()); }

  Eigen::MatrixXd q, v, a;  ///< of all coordinates (nq x size; nv x size)

  /// Takes K, C, M and dr/dp at the system's q, v and a, which has been driven at time t.
  void linearise(double t);
  /// The accelerations' tangents behind `linearise`.
  /// @return whether they are finite
  bool accelerate();
  /// dr of tangents of the free coordinates, rates and accelerations (n_q, n_v x size), behind `linearise`.
  template <class In, class Out>
  void residual(const In& q_free, const In& v_free, const In& a_free, Out&& out) const {
    out.noalias() = K_ * q_free;
    out.noalias() += C_ * v_free;
    out.noalias() += M_ * a_free;
    out += P_;
  }
  /// Rates of tangents of the free coordinates (n_q x size), behind `linearise`.
  Eigen::MatrixXd rates(const Eigen::MatrixXd& q_free, const Eigen::MatrixXd& v_free) const;
  /// dq and dv with  cj dq - rates(dq, dv) = -r1  (n_q x size) and  K dq + (cj M + C) dv = -r2  (n_v x size), behind
  /// `linearise`: without balls, dq = (dv - r1) / cj leaves (cj M + C + K / cj) dv = K r1 / cj - r2.
  void correct(double cj, const Eigen::MatrixXd& r1, const Eigen::MatrixXd& r2, Eigen::MatrixXd& dq,
               Eigen::MatrixXd& dv);
  /// Runs the neighbours' controllers that are due up to time t, each at its own state; before those of the system.
  /// @return whether any force has changed
  bool sample(double t);
  /// Writes row `row` of each parameter: the tangents at the system's q, v and a, which has been driven at time t.
  /// @return whether they are finite
  bool record(double t, std::vector<Trajectory::Tangent>& out, Eigen::Index row);

 private:
  void check(const Near& near) const;
  void differ(double t, int column, const std::vector<std::unique_ptr<Near>>& all);

  System& s_;
  InverseDerivatives slopes_;
  Nears near_;
  std::vector<bool> forces_only_;
  std::vector<signed char> sides_;  // of the run's limits, see `sides`
  Eigen::PartialPivLU<Eigen::MatrixXd> factor_;
  bool balls() const { return s_.arm.nq() != s_.arm.nv(); }
  Eigen::MatrixXd K_, C_, M_, P_;                // of the free coordinates
  Eigen::MatrixXd rate_by_q_, rate_by_v_;        // of the free coordinates' rates, of an arm with balls
  Eigen::MatrixXd by_q_, by_v_;                  // slopes of inverse dynamics less those of feedback
  Eigen::MatrixXd inverse_by_p_, applied_by_p_;  // parts of dr/dp
};

}  // namespace flexarm
