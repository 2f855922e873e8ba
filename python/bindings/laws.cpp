#include "laws.hpp"

#include "mpc.hpp"

#include <algorithm>

#include "flexarm/check.hpp"

using namespace flexarm;

namespace {

/// What a callable answers at time t, as T.
template <class T>
T answer(const py::object& law, const char* name, double t, const char* right) {
  const py::object value = call(law, t);
  try {
    return value.cast<T>();
  } catch (const py::cast_error&) {
    bad_value(std::string(name) + " at t = " + std::to_string(t), std::string(py::repr(value)), right);
  }
}

}  // namespace

Drive make_drive(int coordinate, bool is_motion, const py::object& law, const Eigen::VectorXd& column,
                 const Eigen::VectorXd& times, AllAsked& all) {
  Drive d{coordinate, {}, {}, {}, column};
  all.push_back(nullptr);
  if (py::isinstance<PiecewisePolynomial>(law)) {
    const auto p = law.cast<PiecewisePolynomial>();
    d.breaks = p.breaks();
    if (is_motion) d.motion = p;
    if (!is_motion) d.force = [p](double t) { return p(t).q; };
    return d;
  }
  const auto shared = std::make_shared<py::object>(law);
  const auto asked = std::make_shared<Asked>(times, is_motion ? 3 : 1);
  all.back() = asked;
  if (is_motion) {
    d.motion = [shared, asked](double t) {
      const Locked lock;
      const auto m = answer<std::array<double, 3>>(*shared, "Motion", t, "must give three numbers (q, v, a)");
      if (!std::isfinite(m[0]) || !std::isfinite(m[1]) || !std::isfinite(m[2]))
        bad_value("Motion at t", t, "gave nan or inf; q, v and a must be finite");
      asked->note(t, m.data());
      return MotionValue{m[0], m[1], m[2]};
    };
  } else {
    const std::string name = column.size() > 0 ? "Voltage" : "Torque";
    d.force = [shared, asked, name](double t) {
      const Locked lock;
      const double f = answer<double>(*shared, name.c_str(), t, "must give one number");
      if (!std::isfinite(f)) bad_value(name + " at t", t, "gave nan or inf; it must be finite");
      asked->note(t, &f);
      return f;
    };
  }
  return d;
}

LoadDrive make_load(const Load& load, const py::object& law, const Eigen::VectorXd& times, AllAsked& all) {
  LoadDrive d{load, {}, {}};
  all.push_back(nullptr);
  if (py::isinstance<py::tuple>(law)) {
    const auto parts = law.cast<std::vector<PiecewisePolynomial>>();
    d.breaks = parts.at(0).breaks();
    d.wrench = [parts](double t) {
      Vec6<double> w;
      for (std::size_t k = 0; k < 6; ++k) w[static_cast<Eigen::Index>(k)] = parts.at(k)(t).q;
      return w;
    };
    return d;
  }
  const auto shared = std::make_shared<py::object>(law);
  const auto asked = all.back() = std::make_shared<Asked>(times, 6);
  d.wrench = [shared, asked](double t) {
    const Locked lock;
    const auto w = answer<std::array<double, 6>>(*shared, "Load", t, "must give six numbers");
    asked->note(t, w.data());
    return Vec6<double>(Eigen::Map<const Vec6<double>>(w.data()));
  };
  return d;
}

Control make_control(const FeedbackLaws& feedback, const SampledLaws& sampled, int nv, const Eigen::VectorXd& times,
                     AllAsked& all) {
  std::vector<Feedback> laws;
  for (const auto& [column, by_q, by_v, reference, limit] : feedback) {
    Feedback f{column, by_q, by_v};
    f.limit = limit;
    if (!reference.is_none()) {
      const Drive d = make_drive(0, false, reference, {}, times, all);
      f.reference = d.force;
      f.breaks = py::hasattr(reference, "kinks") ? reference.attr("kinks").cast<Eigen::VectorXd>() : d.breaks;
    }
    laws.push_back(f);
  }
  std::vector<Sampler> samplers;
  for (const auto& [first, period, delay, law] : sampled) {
    if (py::isinstance<LinearLaw>(law)) {
      samplers.push_back({first, period, delay, law.cast<LinearLaw>()});
      continue;
    }
    if (py::isinstance<ComputedLaw>(law)) {
      const auto own = std::make_shared<ComputedLaw>(law.cast<ComputedLaw>());
      const auto forces = [own](double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd&) {
        return (*own)(t, q, v);
      };
      samplers.push_back({first, period, delay, forces});
      continue;
    }
#ifdef FLEXARM_MPC
    if (py::isinstance<MpcLaw>(law)) {
      const auto shared = law.cast<std::shared_ptr<MpcLaw>>();
      samplers.push_back({first, period, delay,
                          [shared](double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                   const Eigen::VectorXd&) { return (*shared)(t, q, v); }});
      continue;
    }
#endif
    const auto shared = std::make_shared<py::object>(law);
    const auto ask = [shared, nv](double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                  const Eigen::VectorXd& a) {
      const Locked lock;
      const auto force = call(*shared, t, q, v, a).cast<Eigen::VectorXd>();
      if (force.size() != nv || !force.allFinite())
        bad_value("control at t = " + std::to_string(t), "nan, inf or a wrong length", "must give finite numbers");
      return force;
    };
    samplers.push_back({first, period, delay, ask});
  }
  return Control(std::move(laws), std::move(samplers), nv);
}

py::dict tangent_rows(const std::vector<Trajectory::Tangent>& all, Eigen::Index done, Eigen::Index rates) {
  const auto stacked = [&](auto part) {
    const auto count = static_cast<py::ssize_t>(all.size());
    py::array_t<double> out({count, static_cast<py::ssize_t>(done), static_cast<py::ssize_t>(rates)});
    for (py::ssize_t k = 0; k < count; ++k) {
      const auto& rows = all[static_cast<std::size_t>(k)].*part;
      if (rows.size() > 0) Eigen::Map<Rows>(out.mutable_data(k), done, rates) = rows.topRows(done);
    }
    return out;
  };
  using Tangent = Trajectory::Tangent;
  return py::dict(py::arg("q") = stacked(&Tangent::q), py::arg("v") = stacked(&Tangent::v),
                  py::arg("a") = stacked(&Tangent::a), py::arg("tau") = stacked(&Tangent::tau),
                  py::arg("friction") = stacked(&Tangent::friction));
}
