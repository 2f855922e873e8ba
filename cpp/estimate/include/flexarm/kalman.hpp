// An extended Kalman filter on an implicit step: states, payload and joint friction from encoders and strain gauges.
// After construction nothing is allocated, locked or thrown.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "flexarm/kinematics.hpp"
#include "flexarm/problem.hpp"

namespace flexarm {

class PredictiveStep;

/// One number that is measured, by_q being by the coordinates of rates (of balls zero): y = by_q . q + by_v . v +
/// offset + along . place + noise. The gain of an instrument multiplies by_q, by_v, offset and along; its reading at
/// zero is then added to offset.
struct KalmanSensor {
  /// A joint's coordinate (rad; m), by the index of its rate in v.
  static KalmanSensor encoder(const Arm& arm, int rate, double noise);
  /// A joint's rate (rad/s; m/s).
  static KalmanSensor tachometer(const Arm& arm, int rate, double noise);
  /// The strain of a beam's fibre at (y, z) of the section at x metres: eps + z K2 - y K3.
  static KalmanSensor gauge(const Arm& arm, std::size_t link, double x, double y, double z, double noise);
  /// The place of a slice, or of a link's end without x, along a direction of the world (m).
  static KalmanSensor camera(const Arm& arm, std::size_t link, std::optional<double> x, const Eigen::Vector3d& along,
                             double noise);

  Eigen::VectorXd by_q, by_v;  ///< (nv) each
  double offset = 0.0;
  double noise = 0.0;                               ///< standard deviation of a sample, positive
  std::optional<PlacedSlice> at = {};               ///< the slice of `place`
  Eigen::Vector3d along = Eigen::Vector3d::Zero();  ///< world axes
  /// A linear filter ahead of sampling, settled at the start: its state f goes to F f + before y0 + after y1 over a
  /// step in which y goes from y0 to y1, and f[0] is read. A delay is such a filter, too. Empty: none.
  Eigen::MatrixXd F = {};
  Eigen::VectorXd before = {}, after = {};
};

/// A constant that is estimated along with the state, in addition to the arm's own. Payloads, and friction with the
/// arm's own, are kept from becoming negative.
struct KalmanParameter {
  enum Kind {
    payload,  ///< mass at the last link's end (kg), a point
    damping,  ///< viscous friction of a joint (N m s/rad; N s/m)
    coulomb,  ///< Coulomb friction of a joint (N m; N)
    offset,   ///< of a joint's force (N m; N)
    gain      ///< of a joint's force: it is 1 + gain times the command
  };
  Kind kind;
  int rate;                 ///< of the joint, its index in v; of a payload ignored
  double start, deviation;  ///< first estimate, and its standard deviation
  double drift = 0.0;       ///< by which it wanders in a second (unit/sqrt(s))
};

struct KalmanOptions {
  /// Coulomb friction is c v / sqrt(v^2 + friction_speed^2) (rad/s; m/s), that of the arm's joints as well: a joint
  /// that sticks creeps.
  double friction_speed = 1e-2;
};

/// The extended Kalman filter (Jazwinski 1970) whose model is an implicit step with its exact derivatives: five stages,
/// of order 4, L-stable (Hairer & Wanner 1996). Readings of places are taken by the iterated filter.
/// The covariance is kept as a square root, P = L L^T: readings, one number after the other, by Potter's update (1963),
/// steps by an orthogonal triangularisation (Schmidt 1970), so that P is positive semidefinite whatever the rounding.
///
/// The equations of motion have products of the payload and accelerations. The mean and the covariance of the product
/// of their errors are in a step, as forces (the Gaussian filter of second order; Jazwinski 1970, Sec. 9.3).
///
/// State x = [q; v; parameters; filters of sensors], errors of q being displacements: of balls rotation vectors in the
/// axes that turn (the multiplicative filter: Lefferts, Markley, Shuster 1982). Given forces are held over a step. A
/// payload acts by its inertia and weight. All else that acts in the problem is known: motions, forces and
/// loads at their times, continuous laws at the estimate. Sampled ones are not asked.
class KalmanFilter {
 public:
  /// @param h            step (s)
  /// @param force_noise  two-sided density of white forces that the model does not know of, by rate (nv; N m/sqrt(Hz))
  /// @throws std::invalid_argument naming the field and the value
  KalmanFilter(const Problem& problem, double h, const std::vector<KalmanSensor>& sensors,
               const std::vector<KalmanParameter>& parameters, const Eigen::VectorXd& force_noise,
               const KalmanOptions& options = {});
  ~KalmanFilter();

  /// Begins at time t (s), at a state (nq), (nv) known to standard deviations (nv each), with the parameters' starts.
  /// Sizes are not checked.
  void start(const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& q_deviation,
             const Eigen::VectorXd& v_deviation, double t = 0.0);
  /// Ahead by a step under tau (nv), and all that acts in the problem. O((2 nv + parameters)^3).
  /// @return when not ok, the estimate is as it was
  Status predict(const Eigen::VectorXd& tau);
  /// Takes readings of all sensors (N, N m ..; one each), of which those that are not finite are left out.
  /// @return when not ok, an estimate is not finite
  Status update(const Eigen::VectorXd& y);

  const Arm& arm() const { return *arm_; }
  double t() const { return t_; }  ///< s
  const Eigen::VectorXd& q() const { return q_; }
  const Eigen::VectorXd& v() const { return v_; }
  const Eigen::VectorXd& parameters() const { return p_; }
  int states() const { return static_cast<int>(L_.rows()); }
  /// Square root L of the covariance, states x states, with rows [q; v; parameters; filters].
  const Eigen::MatrixXd& root() const { return L_; }
  /// Standard deviation of a state.
  double deviation(int state) const { return L_.row(state).norm(); }
  /// Of the last update: innovations (reading less expected reading; nan: left out) and their standard
  /// deviations, each after the readings ahead of it; the sum of the squares of their ratios (NIS), which with a model
  /// that holds is distributed as chi-square of `used()` degrees of freedom; and how many readings there were.
  const Eigen::VectorXd& innovations() const { return innovations_; }
  const Eigen::VectorXd& innovation_deviations() const { return innovation_deviations_; }
  double nis() const { return nis_; }
  int used() const { return used_; }
  /// The place of a slice (m, world axes), and its covariance (m^2).
  void place(const PlacedSlice& at, Eigen::Vector3d& p, Eigen::Matrix3d& covariance);
  /// All that readings and steps have made of it, in a row.
  Eigen::VectorXd state() const;
  /// Goes on from the state of a filter that was made of the same. Its size is not checked.
  void resume(const Eigen::VectorXd& state);
  /// Derivatives of the last predicted state by the one before (states x states).
  const Eigen::MatrixXd& transition() const { return transition_; }

 private:
  double expected(std::size_t sensor);
  void linearise();
  void disturb();
  void triangularise();
  void take(const Eigen::VectorXd& y, bool turned);
  void turn();
  void add(double times);
  double look(std::size_t sensor, const Eigen::VectorXd& q, const Eigen::VectorXd& v, Eigen::VectorXd& row);
  void bound(Eigen::Index parameter);

  const Problem problem_;
  const Arm* arm_;
  std::vector<KalmanSensor> sensors_;
  std::vector<Eigen::VectorXd> by_q_;  ///< of each sensor, by coordinates
  std::vector<KalmanParameter> parameters_;
  std::vector<Eigen::Index> first_;       ///< of each sensor's filter in its states
  std::vector<Eigen::VectorXd> settled_;  ///< those states, of a reading that is 1
  Eigen::VectorXd force_noise_;
  double h_, t_ = 0.0;
  std::unique_ptr<PredictiveStep> step_;  ///< its parameters are those here, and a force for each rate
  Eigen::Index payload_ = -1;             ///< which state; -1: none
  Eigen::VectorXd q_, v_, p_, f_, q0_, v0_, f0_, from_, told_, row_, phi_, gain_, innovations_, innovation_deviations_;
  Eigen::VectorXd u_, essential_, lowest_, bend_, mean_;
  Eigen::VectorXd change_, about_;  ///< of an update: of the state, and where readings are linear
  Eigen::VectorXd read_;            ///< by sensor, ahead of its filter, before a step
  Eigen::MatrixXd before_, after_;  ///< by sensor, its derivatives by [q; v] there and behind the step
  Eigen::MatrixXd L_, L0_, rows_, forces_, back_, turned_, A_, B_;
  Eigen::MatrixXd transition_, pushes_;  ///< derivatives of the last predicted state by that before, and by forces
  Mat6X<double> J_;
  double nis_ = 0.0;
  int used_ = 0;
};

}  // namespace flexarm
