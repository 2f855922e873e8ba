// What drives, loads and controls an arm, from Python.
#pragma once

#include <memory>

#include "evaluation.hpp"
#include "flexarm/computed_torque.hpp"
#include "flexarm/control.hpp"
#include "flexarm/drive.hpp"
#include "flexarm/load.hpp"
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

/// (coordinate, is a motion, law, column or none) of each drive, and (place, law) of each load.
using Laws = std::vector<std::tuple<int, bool, py::object, Eigen::VectorXd>>;
using LoadLaws = std::vector<std::pair<flexarm::Load, py::object>>;

/// (column, by_q, by_v, reference or None, limit) of each law without memory.
using FeedbackLaws = std::vector<std::tuple<Eigen::VectorXd, Eigen::VectorXd, Eigen::VectorXd, py::object, double>>;
/// (first, period, delay, law) of each sampled one.
using SampledLaws = std::vector<std::tuple<double, double, double, py::object>>;

/// A computed torque, of an arm that may be another than the one it moves.
struct ComputedLaw {
  struct Axis {
    int q, v, own_q, own_v;  ///< coordinate and rate of the arm that is moved, and of its own
  };
  flexarm::ComputedTorque of;
  std::vector<Axis> axes;
  Eigen::Index size;  ///< of the forces
  /// @throws std::invalid_argument where it gives no forces
  Eigen::VectorXd operator()(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v);
};

/// A drive: a piecewise polynomial, or a callable t -> force, t -> (q, v, a), whose calls are noted.
flexarm::Drive make_drive(int coordinate, bool is_motion, const py::object& law, const Eigen::VectorXd& column,
                          const Eigen::VectorXd& times, AllAsked& all);
/// A load's value in time: six piecewise polynomials, or a callable t -> six numbers.
flexarm::LoadDrive make_load(const flexarm::Load& load, const py::object& law, const Eigen::VectorXd& times,
                             AllAsked& all);
flexarm::Control make_control(const FeedbackLaws& feedback, const SampledLaws& sampled, int nv,
                              const Eigen::VectorXd& times, AllAsked& all);
/// q, v, a, tau and friction by the parameters, (np, nt, n) each.
py::dict tangent_rows(const std::vector<flexarm::Trajectory::Tangent>& all, Eigen::Index done, Eigen::Index rates);
