// Computed torque: the inverse dynamics of the arm as if it were rigid, at its joints.
// J. Y. S. Luh, M. W. Walker, R. P. C. Paul, "Resolved-acceleration control of mechanical manipulators", IEEE Trans.
// Automatic Control 25 (1980), 468-474; J. J. Craig, Introduction to Robotics, ch. 10.
#pragma once

#include <Eigen/LU>
#include <functional>
#include <limits>
#include <memory>
#include <vector>

#include "flexarm/derivatives.hpp"
#include "flexarm/drive.hpp"

namespace flexarm {

/// Forces at the joints, M_j(q) a + h_j(q, v), of the arm with its elastic coordinates at rest: in static balance with
/// gravity at these joint positions, or at zero. Joint springs, stops, viscous friction, struts and normal forces of
/// contacts are in them, dry friction and loads are not. The calls allocate nothing, one object per thread.
class ComputedTorque {
 public:
  /// One freedom of a joint. All freedoms of all joints need one, none of them a ball's.
  struct Axis {
    int rate;                                      ///< which of the arm's rates
    std::function<MotionValue(double)> reference;  ///< of time (s)
    double kp = 0.0, kv = 0.0;                     ///< 1/s^2, 1/s
    double limit = std::numeric_limits<double>::infinity();
  };
  /// @param sags  whether the elastic coordinates are in static balance, else zero
  /// @throws std::invalid_argument naming the field and the value
  ComputedTorque(const Arm& arm, std::vector<Axis> axes, bool sags = true);

  /// Feedback linearisation, into tau (nv): a = r'' + kv (r' - v) + kp (r - q) of the joints, at their q (nq) and v
  /// (nv); elastic entries are not looked at. Each force is kept within its limit.
  /// @return Status::not_converged where no static balance was found, Status::not_finite; tau is then not to be used
  Status operator()(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v);
  /// Feed-forward, into tau: forces of the reference alone; without `inertia` of rest where it is now.
  Status feed_forward(double t, bool inertia = true);

  Eigen::VectorXd tau;  ///< result, zero on elastic coordinates
  /// Where the last call looked at the arm: its joints, and the elastic coordinates at rest there (nq).
  const Eigen::VectorXd& q() const { return q_; }
  const Arm& arm() const { return *arm_; }
  const std::vector<Axis>& axes() const { return axes_; }
  bool sags() const { return sags_; }

 private:
  Status forces();
  Status balance();
  Status settle(double share);
  void look(double share);
  void factor();
  /// Coordinate of the k-th elastic rate.
  int place(Eigen::Index k) const { return arm_->coordinate_of(elastic_[static_cast<std::size_t>(k)]); }

  const Arm* arm_;
  std::vector<Axis> axes_;
  std::vector<int> elastic_;
  Workspace ws_;
  InverseDerivatives slopes_;
  Eigen::VectorXd q_, v_, a_, none_, kept_;
  Eigen::VectorXd left_, step_, next_, base_, first_;  // of the elastic coordinates
  Eigen::MatrixXd K_;
  Eigen::PartialPivLU<Eigen::MatrixXd> factor_;
  bool sags_, factored_ = false;
};

/// The law of a Sampler: a computed torque of an arm that may be another than the one it moves.
struct TorqueLaw {
  /// A coordinate and a rate of the arm that is moved.
  struct Place {
    int q, v;
  };
  /// @param places  of the axes, in their order
  /// @param rates   of the arm that is moved
  /// @throws std::invalid_argument naming the field and the value
  TorqueLaw(std::shared_ptr<const Arm> arm, std::vector<ComputedTorque::Axis> axes, bool sags,
            std::vector<Place> places, int rates);
  /// Writes forces (`rates`); allocates nothing. @throws std::invalid_argument where there are none
  void operator()(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a,
                  Eigen::VectorXd& force);
  /// @throws std::invalid_argument saying why there are no forces
  static void check(Status status, double t);

  std::shared_ptr<const Arm> arm;
  ComputedTorque of;
  std::vector<Place> places;
  int rates;
  Eigen::VectorXd own_q, own_v;  ///< of its arm
};

}  // namespace flexarm
