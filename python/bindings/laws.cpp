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

Drive make_drive(const PyDrive& given, const Eigen::VectorXd& times, AllAsked& all) {
  const auto& [rate, is_motion, law, column] = given;
  Drive d{rate, {}, {}, {}, column};
  all.push_back(nullptr);
  if (py::isinstance<PiecewisePolynomial>(law)) {
    const auto p = law.cast<PiecewisePolynomial>();
    d.breaks = p.breaks();
    if (is_motion) d.motion = p;
    if (!is_motion) d.force = PolynomialValue{p};
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

namespace {

LoadDrive make_load(const PyLoad& given, const Eigen::VectorXd& times, AllAsked& all) {
  const py::object& law = given.law;
  LoadDrive d{given.place, {}, {}};
  all.push_back(nullptr);
  if (py::isinstance<py::tuple>(law)) {
    const auto parts = law.cast<std::vector<PiecewisePolynomial>>();
    d.breaks = parts.at(0).breaks();
    d.wrench = PolynomialValues<Vec6<double>>{parts};
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

Feedback make_feedback(const PyFeedback& given, const Eigen::VectorXd& times, AllAsked& all) {
  Feedback f{given.column, given.by_q, given.by_v};
  f.limit = given.limit;
  if (given.reference.is_none()) return f;
  const Drive d = make_drive({0, false, given.reference, {}}, times, all);
  f.reference = d.force;
  f.breaks = py::hasattr(given.reference, "kinks") ? given.reference.attr("kinks").cast<Eigen::VectorXd>() : d.breaks;
  return f;
}

Sampler make_sampler(const PySampler& given, int nv) {
  const auto& [first, period, delay, law] = given;
  using Vector = Eigen::VectorXd;
  if (py::isinstance<LinearLaw>(law)) return {first, period, delay, law.cast<LinearLaw>()};
  if (py::isinstance<TorqueLaw>(law)) return {first, period, delay, law.cast<TorqueLaw>()};
#ifdef FLEXARM_MPC
  if (py::isinstance<MpcLaw>(law))
    return {first, period, delay,
            [shared = law.cast<std::shared_ptr<MpcLaw>>()](double t, const Vector& q, const Vector& v, const Vector&) {
              return (*shared)(t, q, v);
            }};
#endif
  return {
      first, period, delay,
      [shared = std::make_shared<py::object>(law), nv](double t, const Vector& q, const Vector& v, const Vector& a) {
        const Locked lock;
        const auto force = call(*shared, t, q, v, a).cast<Vector>();
        if (force.size() != nv || !force.allFinite())
          bad_value("control at t = " + std::to_string(t), "nan, inf or a wrong length", "must give finite numbers");
        return force;
      }};
}

Event make_event(std::size_t k, const PyEvent& given) {
  const std::string name = "events[" + std::to_string(k) + "]";
  const auto value = [shared = std::make_shared<py::object>(given.value), name](double t, const Eigen::VectorXd& q,
                                                                                const Eigen::VectorXd& v) {
    const Locked lock;
    const py::object g = call(*shared, t, q, v);
    try {
      return g.cast<double>();
    } catch (const py::cast_error&) {
      bad_value(name + " at t = " + std::to_string(t), std::string(py::repr(g)), "must give one number");
    }
  };
  return {value, given.terminal, given.direction};
}

}  // namespace

PyProblem::PyProblem(const Arm& arm, const Eigen::VectorXd& times, const std::vector<PyDrive>& drives,
                     const std::vector<PyLoad>& loads, const std::vector<PyFeedback>& feedback,
                     const std::vector<PySampler>& samplers, const std::vector<PyEvent>& events)
    : problem(std::shared_ptr<const Arm>(std::shared_ptr<void>(), &arm)) {  // Python's, which this keeps alive
  for (const PyDrive& x : drives) problem.drives.push_back(make_drive(x, times, asked));
  for (const PyLoad& x : loads) problem.loads.push_back(make_load(x, times, asked));
  for (const PyFeedback& x : feedback) problem.feedback.push_back(make_feedback(x, times, asked));
  for (const PySampler& x : samplers) problem.samplers.push_back(make_sampler(x, arm.nv()));
  for (std::size_t k = 0; k < events.size(); ++k) problem.events.push_back(make_event(k, events[k]));
}

void bind_problem(py::module_& m) {
  using Eigen::VectorXd;
  py::class_<PyDrive>(m, "Drive")
      .def(py::init<int, bool, py::object, VectorXd>(), py::arg("rate"), py::arg("moves"), py::arg("law"),
           py::arg("column") = VectorXd())
      .def_readonly("rate", &PyDrive::rate)
      .def_readonly("moves", &PyDrive::moves)
      .def_readonly("law", &PyDrive::law)
      .def_readonly("column", &PyDrive::column)
      .def(py::pickle([](const PyDrive& x) { return py::make_tuple(x.rate, x.moves, x.law, x.column); },
                      [](const py::tuple& t) {
                        return PyDrive{t[0].cast<int>(), t[1].cast<bool>(), t[2].cast<py::object>(),
                                       t[3].cast<VectorXd>()};
                      }));
  py::class_<PyLoad>(m, "LoadLaw")
      .def(py::init<Load, py::object>(), py::arg("place"), py::arg("law"))
      .def_readonly("law", &PyLoad::law)
      .def(py::pickle([](const PyLoad& x) { return py::make_tuple(x.place, x.law); },
                      [](const py::tuple& t) { return PyLoad{t[0].cast<Load>(), t[1].cast<py::object>()}; }));
  py::class_<PyFeedback>(m, "Feedback")
      .def(py::init<VectorXd, VectorXd, VectorXd, py::object, double>(), py::arg("column"), py::arg("by_q"),
           py::arg("by_v"), py::arg("reference"), py::arg("limit"))
      .def_readonly("column", &PyFeedback::column)
      .def_readonly("by_q", &PyFeedback::by_q)
      .def_readonly("by_v", &PyFeedback::by_v)
      .def_readonly("reference", &PyFeedback::reference)
      .def_readonly("limit", &PyFeedback::limit)
      .def(
          py::pickle([](const PyFeedback& x) { return py::make_tuple(x.column, x.by_q, x.by_v, x.reference, x.limit); },
                     [](const py::tuple& t) {
                       return PyFeedback{t[0].cast<VectorXd>(), t[1].cast<VectorXd>(), t[2].cast<VectorXd>(),
                                         t[3].cast<py::object>(), t[4].cast<double>()};
                     }));
  py::class_<PySampler>(m, "Sampler")
      .def(py::init<double, double, double, py::object>(), py::arg("first"), py::arg("period"), py::arg("delay"),
           py::arg("law"))
      .def_readonly("first", &PySampler::first)
      .def_readonly("period", &PySampler::period)
      .def_readonly("delay", &PySampler::delay)
      .def_readonly("law", &PySampler::law)
      .def(py::pickle([](const PySampler& x) { return py::make_tuple(x.first, x.period, x.delay, x.law); },
                      [](const py::tuple& t) {
                        return PySampler{t[0].cast<double>(), t[1].cast<double>(), t[2].cast<double>(),
                                         t[3].cast<py::object>()};
                      }));
  py::class_<PyEvent>(m, "Event")
      .def(py::init<py::object, int, int>(), py::arg("value"), py::arg("terminal"), py::arg("direction"))
      .def_readonly("value", &PyEvent::value)
      .def(py::pickle(
          [](const PyEvent& x) { return py::make_tuple(x.value, x.terminal, x.direction); },
          [](const py::tuple& t) { return PyEvent{t[0].cast<py::object>(), t[1].cast<int>(), t[2].cast<int>()}; }));
  py::class_<PyProblem>(m, "Problem")
      .def(py::init([](const Arm& arm, const VectorXd& t, const VectorXd& q0, const VectorXd& v0, const VectorXd& tau,
                       const std::vector<PyDrive>& drives, const std::vector<PyLoad>& loads,
                       const std::vector<PyFeedback>& feedback, const std::vector<PySampler>& samplers,
                       const std::vector<PyEvent>& events) {
             PyProblem out(arm, t, drives, loads, feedback, samplers, events);
             out.problem.q0 = q0;
             out.problem.v0 = v0;
             out.problem.tau = tau;
             return out;
           }),
           py::keep_alive<1, 2>(), py::kw_only(), py::arg("arm"), py::arg("t"), py::arg("q0"), py::arg("v0"),
           py::arg("tau"), py::arg("drives"), py::arg("loads"), py::arg("feedback"), py::arg("samplers"),
           py::arg("events"))
      .def_property_readonly("q0", [](const PyProblem& p) { return p.problem.q0; })
      .def_property_readonly("v0", [](const PyProblem& p) { return p.problem.v0; })
      .def_property_readonly("asked", [](const PyProblem& p) {
        py::list out;
        for (const auto& a : p.asked) out.append(a ? py::cast(a->calls) : py::none());
        return out;
      });
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
