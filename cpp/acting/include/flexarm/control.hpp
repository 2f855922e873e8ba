// Controllers: laws from the state to forces, continuous or sampled.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <functional>
#include <limits>
#include <utility>
#include <vector>

namespace flexarm {

class Arm;

/// A continuous law without memory, such as Eq. 97: u = reference(t) - by_q . q - by_v . v, limited to -limit .. limit,
/// exerts the generalised force column * u. It is part of the equations that the integrators solve.
struct Feedback {
  Eigen::VectorXd column;                        ///< generalised force per unit of u (nv)
  Eigen::VectorXd by_q, by_v;                    ///< gains (nq), (nv)
  std::function<double(double)> reference = {};  ///< of time (s), gains included; empty: zero
  Eigen::VectorXd breaks = {};                   ///< times that no step may pass over
  double limit = std::numeric_limits<double>::infinity();

  /// u before its limit.
  double wanted(double offset, const Eigen::Ref<const Eigen::VectorXd>& q,
                const Eigen::Ref<const Eigen::VectorXd>& v) const {
    return offset - by_q.dot(q) - by_v.dot(v);
  }
  double operator()(double offset, const Eigen::Ref<const Eigen::VectorXd>& q,
                    const Eigen::Ref<const Eigen::VectorXd>& v) const {
    const double u = wanted(offset, q, v);
    return u > limit ? limit : u < -limit ? -limit : u;
  }
};

/// A law with the value of its reference now.
struct AppliedFeedback {
  const Feedback* law;
  double offset = 0.0;
};

/// A rate whose motor has a limit (JointForce::torque_limit) on the sum of drives, held forces and laws.
struct AppliedLimit {
  int rate;
  double most;
  double given = 0.0;     ///< force of drives and of held laws now, `friction` included
  double friction = 0.0;  ///< part of it by dry friction, not the motor's
  double asked = 0.0;     ///< `given` and the laws, see `ask`

  /// The change of `asked` by the limit: zero below it.
  double cut() const { return std::clamp(asked - friction, -most, most) - (asked - friction); }
  /// The limited force: this order keeps it within the limit to the last digit.
  double force() const { return std::clamp(asked - friction, -most, most) + friction; }
};
/// The limits of an arm's joints that have one.
std::vector<AppliedLimit> torque_limits(const Arm& arm);
/// Sets `asked` of rates with limits, at q and v.
void ask(std::vector<AppliedLimit>& limits, const std::vector<AppliedFeedback>& feedback,
         const Eigen::Ref<const Eigen::VectorXd>& q, const Eigen::Ref<const Eigen::VectorXd>& v);

/// On which side of its limit each law, and then each motor, is: 1 or -1 beyond it, 0 below it. Sets `asked`.
void sides(const std::vector<AppliedFeedback>& feedback, std::vector<AppliedLimit>& limits,
           const Eigen::Ref<const Eigen::VectorXd>& q, const Eigen::Ref<const Eigen::VectorXd>& v, signed char* out);
/// Adds the generalised forces of laws, and the motors' reduction of the sum, each on a given side of its limit (see
/// `sides`): for a neighbour in a difference, which takes the branch of the run even beyond its own limit.
void add_on_sides(const std::vector<AppliedFeedback>& feedback, const std::vector<AppliedLimit>& limits,
                  const signed char* side, const Eigen::Ref<const Eigen::VectorXd>& q,
                  const Eigen::Ref<const Eigen::VectorXd>& v, Eigen::Ref<Eigen::VectorXd> tau);

/// Adds the slopes of -column * u, of laws that are not at their limits and at rates that are not, to those of inverse
/// dynamics. Sets `asked` of the limits.
void add_feedback_slopes(const std::vector<AppliedFeedback>& feedback, std::vector<AppliedLimit>& limits,
                         const Eigen::VectorXd& q, const Eigen::VectorXd& v, Eigen::MatrixXd& dq, Eigen::MatrixXd& dv);

/// A law that samples the state and holds its force until the next sample.
struct Sampler {
  double first, period, delay;  ///< first sample; between samples; from a sample to its force (s)
  /// Writes generalised forces (nv) from t, q, v and a; `force` has its size, and may hold other numbers before.
  std::function<void(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a,
                     Eigen::VectorXd& force)>
      law;
};

/// A sampled linear law with memory: e = reference(t) - y, w = u0 + C x + D e, u is w within -limit .. limit, x+ = A x
/// + B e + windup (u' - w), u' being w within -reach .. reach; its force is columns * u. y is read by `read`, or is
/// by_q q + by_v v + offset in steps of `resolution`. It allocates nothing, if these functions do not.
struct LinearLaw {
  Eigen::MatrixXd A, B, C, D, columns, by_q, by_v;
  Eigen::VectorXd limit;                                        ///< of each u
  std::function<void(double t, Eigen::VectorXd& r)> reference;  ///< writes r
  /// Writes y from t, q, v and a.
  std::function<void(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a,
                     Eigen::VectorXd& y)>
      read;
  Eigen::VectorXd u0 = Eigen::VectorXd::Zero(C.rows());
  Eigen::MatrixXd windup = Eigen::MatrixXd::Zero(A.rows(), C.rows());  ///< effect of a limit on the states
  Eigen::VectorXd reach = limit;  ///< of each u, the least of `limit` and its motors' limits
  /// Of each y: an addition, and then the step to whose nearest multiple it is rounded, 0: none. Both empty: none.
  Eigen::VectorXd offset = {}, resolution = {};
  Eigen::MatrixXd start = {};  ///< x is start e ahead of the samples up to the time `first` (s); empty: it is kept
  double first = -std::numeric_limits<double>::infinity();
  Eigen::VectorXd x = Eigen::VectorXd::Zero(A.rows());
  Eigen::VectorXd e = Eigen::VectorXd::Zero(B.cols()), y = e;  ///< of the last sample, as w and u
  Eigen::VectorXd w = Eigen::VectorXd::Zero(C.rows()), u = w, cut_off = w, next = x;
  bool starts = false;  ///< whether x was start e, at the last sample

  /// u, and x behind it.
  /// @throws std::invalid_argument where the sizes of e and B do not fit, or u is not finite
  const Eigen::VectorXd& sample(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a);
  /// Its force.
  void operator()(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a,
                  Eigen::VectorXd& force) {
    force.noalias() = columns * sample(t, q, v, a);
  }
  /// Small changes of x (in place) and u by changes of x and e at the last sample, one in each column.
  void slopes(Eigen::MatrixXd& dx, const Eigen::MatrixXd& de, Eigen::MatrixXd& du) const;
};

/// The controllers of one run, with their samples.
class Control {
 public:
  Control(std::vector<Feedback> feedback, std::vector<Sampler> samplers, int nv);
  const std::vector<Feedback>& feedback() const { return feedback_; }
  /// Forces held now (nv).
  const Eigen::VectorXd& held() const { return held_; }
  /// The first time from `from` on at which something is sampled or changes; infinite: none.
  double next(double from) const;
  /// Whether anything happens up to time t.
  bool due(double t) const;
  /// Samples, and applies delayed forces, up to time t. @return whether the forces have changed
  bool run(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a);

  /// Copies the samples of another of the same problem.
  void recall(const Control& other) {
    lines_ = other.lines_;
    held_ = other.held_;
  }
  /// Its samples as numbers, which `visit` reads or writes, in an order of their own: forces held and on their way, and
  /// the states of linear laws.
  void memory(const std::function<void(double&)>& visit);

 private:
  struct Line {
    Sampler sampler;
    std::vector<Eigen::VectorXd> forces;  ///< of sample k at place k modulo their number, until it acts
    Eigen::VectorXd force;                ///< that acts
    long sampled = 0, acted = 0;          ///< numbers of samples: taken; whose force acts, or has acted

    double sample(long k) const { return sampler.first + static_cast<double>(k) * sampler.period; }
    bool looks(double t) const { return sample(sampled) <= t; }
    bool changes(double t) const { return acted < sampled && sample(acted) + sampler.delay <= t; }
    Eigen::VectorXd& at(long k) { return forces[static_cast<std::size_t>(k) % forces.size()]; }
  };
  std::vector<Feedback> feedback_;
  std::vector<Line> lines_;
  Eigen::VectorXd held_;
};

}  // namespace flexarm
