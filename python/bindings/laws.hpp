// Drives, loads and controllers from Python.
#pragma once

#include <memory>
#include <shared_mutex>
#include <unordered_map>

#include "evaluation.hpp"
#include "flexarm/computed_torque.hpp"
#include "flexarm/ida.hpp"
#include "flexarm/parameter.hpp"
#include "flexarm/simulation.hpp"
#include "flexarm/trajectory.hpp"

/// The recorded calls of a callable: the last one in each of many equal parts of a run.
struct Asked {
  static constexpr Eigen::Index kParts = 1000;
  double from, span;
  Rows calls;  ///< time and values; the time is nan without a call

  Asked(const Eigen::VectorXd& t, Eigen::Index values)
      : from(t[0]), span(t[t.size() - 1] - t[0]), calls(Rows::Constant(kParts, 1 + values, std::nan(""))) {}
  void note(double t, const double* x) {
    const auto k = std::clamp<Eigen::Index>(static_cast<Eigen::Index>((t - from) / span * kParts), 0, kParts - 1);
    calls(k, 0) = t;
    for (Eigen::Index i = 1; i < calls.cols(); ++i) calls(k, i) = x[i - 1];
  }
};
/// Of each callable.
using AllAsked = std::vector<std::shared_ptr<Asked>>;

/// A callable of time that many scenarios share: called once for each time, up to a number of them. Safe from any
/// thread.
class Remembered {
 public:
  std::shared_ptr<Asked> asked;  ///< of all scenarios together

  explicit Remembered(py::object law) : law_(std::move(law)) {}
  const py::object& law() const { return law_; }
  /// Its numbers at t; `ask` computes unknown ones with the interpreter's lock held.
  template <class Ask>
  std::array<double, 6> operator()(double t, const Ask& ask) {
    {
      const std::shared_lock<std::shared_mutex> lock(mutex_);
      if (const auto found = known_.find(t); found != known_.end()) return found->second;
    }
    const std::array<double, 6> x = ask();
    const std::unique_lock<std::shared_mutex> lock(mutex_);
    if (known_.size() < kMost) known_.emplace(t, x);
    return x;
  }

 private:
  static constexpr std::size_t kMost = 200000;
  py::object law_;
  std::shared_mutex mutex_;
  std::unordered_map<double, std::array<double, 6>> known_;
};

/// Actions on an arm from Python: see the classes of the same names; a `law` becomes their function. That is
/// a PiecewisePolynomial (of a load, a tuple of six), a callable of time, or such a callable Remembered.
struct PyDrive {
  int rate;    ///< -1: of a column
  bool moves;  ///< whether it prescribes the motion of that rate, or is a force on it
  py::object law;
  Eigen::VectorXd column;
};
struct PyLoad {
  flexarm::Load place;
  py::object law;
};
struct PyFeedback {
  Eigen::VectorXd column, by_q, by_v;
  py::object reference;  ///< or None
  double limit;
};
struct PySampler {
  double first, period, delay;
  py::object law;
};
struct PyEvent {
  py::object value;  ///< callable (t, q, v) -> number
  int terminal, direction;
};

/// A problem from Python, with the recorded calls of its drives, loads, and references of feedback.
struct PyProblem {
  flexarm::Problem problem;
  AllAsked asked;
  /// @param times  of the run
  PyProblem(const flexarm::Arm& arm, const Eigen::VectorXd& times, const std::vector<PyDrive>& drives,
            const std::vector<PyLoad>& loads, const std::vector<PyFeedback>& feedback,
            const std::vector<PySampler>& samplers, const std::vector<PyEvent>& events);
};

/// An integrator from Python, with the options of all.
struct PyIntegrator {
  flexarm::Method method;  ///< its name is "ida" as well
  double step;             ///< (s); 0: it chooses its own
  flexarm::IdaOptions ida;
};

struct PyStateForce {
  std::shared_ptr<const flexarm::StateForce> of;
};
/// A callable (t, p, R, velocity) -> six numbers.
std::shared_ptr<const flexarm::StateForce> state_force(const py::object& law);
/// A drive with recorded calls of its callable.
flexarm::Drive make_drive(const PyDrive& given, const Eigen::VectorXd& times, AllAsked& all);
/// Lists, by event, of t (n), q (n, nq) and v (n, nv), of which the first coordinates are kept.
py::tuple event_rows(const std::vector<flexarm::EventLog>& logs, Eigen::Index nq, Eigen::Index nv);
/// q, v, a, tau and friction by the parameters, (np, nt, n) each; those that are not known are empty.
py::dict tangent_rows(const std::vector<flexarm::Trajectory::Tangent>& all, Eigen::Index done);
