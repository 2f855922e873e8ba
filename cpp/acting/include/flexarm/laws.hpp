// Linear laws of one force: PD, PID, and laws that damp modes by collocated feedback.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <limits>
#include <optional>
#include <utility>

#include "flexarm/arm.hpp"
#include "flexarm/control.hpp"

namespace flexarm {

/// A linear law with memory: w = C x + D e, x' = A x + B e + windup (u - w), or, sampled, x+ in place of x'. e is
/// reference - y, u is w within its limit.
struct StateSpace {
  Eigen::MatrixXd A, B, C, D, windup;
};

enum class Discretisation {
  tustin,          ///< the trapezoidal rule
  zero_order_hold  ///< exact for e that is constant between samples
};

/// A continuous law, sampled every `period` seconds (Franklin, Powell & Workman, Digital Control of Dynamic Systems,
/// 1998, ch. 6). @throws std::invalid_argument where sizes do not fit, the period is not positive, or a pole is at
/// 2 / period (Tustin)
StateSpace sampled_law(const StateSpace& continuous, double period, Discretisation by = Discretisation::tustin);

/// u = kp e + ki int e dt + kd de/dt of a joint, per rad (m).
struct PidGains {
  double kp, ki, kd;
  std::optional<double> filter_time = {};  ///< of the low pass ahead of the derivative (s); none: two samples
  /// Time constant that unwinds the integral while u is at its limit (s, at least a sample; back-calculation: Astrom &
  /// Hagglund, Advanced PID Control, 2006, ch. 3.5); none: it winds up.
  std::optional<double> tracking_time = {};
  double limit = std::numeric_limits<double>::infinity();  ///< of |u|
};

/// Positive position feedback: u = gain w^2 / (s^2 + 2 zeta w s + w^2) (y - reference) (Fanson & Caughey, AIAA Journal
/// 28, 1990).
struct PositivePositionGains {
  double frequency, damping_ratio, gain;  ///< w (rad/s), zeta; u per unit of y
  double reference = 0.0;                 ///< of y
  double limit = std::numeric_limits<double>::infinity();
};

/// Integral resonant control: u' = gain (y - reference - feedthrough u) (Aphale, Fleming & Moheimani, Smart Materials
/// and Structures 16, 2007).
struct IntegralResonantGains {
  double gain, feedthrough;  ///< u per unit of y and second; y per unit of u; both of one sign
  double reference = 0.0;    ///< of y
  double limit = std::numeric_limits<double>::infinity();
};

/// A drive of a joint as it is built: u = kp (r - y) + ki int (r - y) dt + kv (r' - v) + force. y is the joint's angle
/// in the steps of its encoder; v the difference of two readings over the time between them, behind a low pass. The
/// first sample finds it at rest.
struct ServoGains {
  double kp, kv, ki = 0.0;
  double resolution = 0.0;  ///< the encoder's step (rad; m), 0: none
  /// The low pass of v: its frequency (Hz), of the first order, or, with a damping ratio, of the second; none: no
  /// filter.
  std::optional<double> filter = {}, damping_ratio = {};
  /// As of PidGains; none: sqrt(kv / ki), or kp / ki without kv (Astrom & Hagglund 2006, ch. 3.5), at least a sample.
  std::optional<double> tracking_time = {};
  double limit = std::numeric_limits<double>::infinity();  ///< of |u|
};

/// The law of a drive, over time (s); empty: zero.
struct Commands {
  std::function<double(double)> position = {}, rate = {}, force = {};
};

/// The measurement y = by_q q (nq) and the generalised forces column u (nv). For a sensing and a driving patch, both
/// come from `Arm::patch_matrix`.
struct FeedbackPath {
  Eigen::VectorXd by_q, column;
};

/// The continuous laws, windup included; with a period, as Tustin's rule needs them: the PID's default filter, and a
/// filter of positive position feedback whose peak the rule maps to w.
/// @throws std::invalid_argument of gains that are not finite, times that are not positive, and the like
StateSpace continuous_law(const PidGains& gains, std::optional<double> period = {});
StateSpace continuous_law(const PositivePositionGains& gains, std::optional<double> period = {});
StateSpace continuous_law(const IntegralResonantGains& gains);

/// The sampled law of a drive and the `start` of its memory (LinearLaw). Its e are r - y, -y, r' and force.
/// @throws std::invalid_argument of gains that are not finite, and times that are not positive
std::pair<StateSpace, Eigen::MatrixXd> servo_law(const ServoGains& gains, double period);

/// u = kp (reference - q) - kd v on the freedom of rate i, continuous. `reference` of time (s); empty: zero.
/// @throws std::invalid_argument of a rate that is not the arm's or is a ball's, or gains that are not finite
Feedback pd(const Arm& arm, int i, double kp, double kd, const std::function<double(double)>& reference = {},
            double limit = std::numeric_limits<double>::infinity());

/// The laws for `Sampler{first, period, delay, law}`, sampled by Tustin's rule; `i` and `reference` as of `pd`.
/// @throws std::invalid_argument as `continuous_law`, and where i or the sizes of the loop do not fit the arm
LinearLaw pid(const Arm& arm, int i, const PidGains& gains, double period,
              const std::function<double(double)>& reference = {});
/// @param first  time of the first sample, as of its Sampler
LinearLaw servo(const Arm& arm, int i, const ServoGains& gains, double period, const Commands& commands = {},
                double first = 0.0);
LinearLaw positive_position(const Arm& arm, const FeedbackPath& path, const PositivePositionGains& gains,
                            double period);
LinearLaw integral_resonant(const Arm& arm, const FeedbackPath& path, const IntegralResonantGains& gains,
                            double period);

}  // namespace flexarm
