// What drives, loads and controls an arm, from Python.
#pragma once

#include <memory>

#include "evaluation.hpp"
#include "flexarm/computed_torque.hpp"
#include "flexarm/problem.hpp"
#include "flexarm/trajectory.hpp"

/// Where in time a callable has been asked: the last call in each of many equal parts of a run.
struct Asked {
  static constexpr Eigen::Index kParts = 1000;
  double from, span;
  Rows calls;  ///< time and values; a time of nan where there was none

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

/// What acts on an arm, as Python gives it: see the classes of the same names, whose functions a `law` becomes. That is
/// a PiecewisePolynomial (of a load, a tuple of six) or a callable of time.
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

/// A problem from Python, and where its callables were asked: of drives, loads, and references of feedback.
struct PyProblem {
  flexarm::Problem problem;
  AllAsked asked;
  /// @param times  of the run
  PyProblem(const flexarm::Arm& arm, const Eigen::VectorXd& times, const std::vector<PyDrive>& drives,
            const std::vector<PyLoad>& loads, const std::vector<PyFeedback>& feedback,
            const std::vector<PySampler>& samplers, const std::vector<PyEvent>& events);
};

/// A drive, whose callable's calls are noted.
flexarm::Drive make_drive(const PyDrive& given, const Eigen::VectorXd& times, AllAsked& all);
/// q, v, a, tau and friction by the parameters, (np, nt, n) each.
py::dict tangent_rows(const std::vector<flexarm::Trajectory::Tangent>& all, Eigen::Index done, Eigen::Index rates);
