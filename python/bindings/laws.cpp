#include "laws.hpp"

#include "mpc.hpp"

#include <algorithm>

#include "flexarm/check.hpp"

using namespace flexarm;

namespace {

/// The result of a callable at time t, as T.
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

namespace {

/// A callable of time that returns N numbers, for the core; its calls are recorded.
/// @param name, right  of errors
template <std::size_t N>
std::function<std::array<double, N>(double)> make_law(const py::object& given, const Eigen::VectorXd& times,
                                                      AllAsked& all, const std::string& name, const char* right) {
  auto asked = std::make_shared<Asked>(times, static_cast<Eigen::Index>(N));
  if (py::isinstance<Remembered>(given)) {
    auto& kept = given.cast<Remembered&>().asked;
    asked = kept = kept ? kept : asked;
  }
  all.back() = asked;
  const auto ask = [asked, name, right](const py::object& law, double t) {
    const Locked lock;
    std::array<double, N> x;
    if constexpr (N == 1)
      x[0] = answer<double>(law, name.c_str(), t, right);
    else
      x = answer<std::array<double, N>>(law, name.c_str(), t, right);
    for (double number : x)
      if (!std::isfinite(number)) bad_value(name + " at t", t, "gave nan or inf; it must be finite");
    asked->note(t, x.data());
    return x;
  };
  if (!py::isinstance<Remembered>(given))
    return [shared = std::make_shared<py::object>(given), ask](double t) { return ask(*shared, t); };
  return [shared = given.cast<std::shared_ptr<Remembered>>(), ask](double t) {
    const auto all_of = (*shared)(t, [&] {
      std::array<double, 6> out{};
      const auto x = ask(shared->law(), t);
      std::copy(x.begin(), x.end(), out.begin());
      return out;
    });
    std::array<double, N> x;
    std::copy_n(all_of.begin(), N, x.begin());
    return x;
  };
}

}  // namespace

Drive make_drive(const PyDrive& given, const Eigen::VectorXd& times, AllAsked& all) {
  const auto& [rate, is_motion, law, column] = given;
  Drive d{rate, {}, {}, {}, column};
  all.push_back(nullptr);
  if (py::isinstance<PiecewisePolynomial>(law)) {
    const auto p = law.cast<PiecewisePolynomial>();
    d.breaks = py::hasattr(law, "kinks") ? law.attr("kinks").cast<Eigen::VectorXd>() : p.breaks();
    if (is_motion) d.motion = p;
    if (!is_motion) d.force = PolynomialValue{p};
  } else if (is_motion) {
    d.motion = [f = make_law<3>(law, times, all, "Motion", "must give three numbers (q, v, a)")](double t) {
      const auto m = f(t);
      return MotionValue{m[0], m[1], m[2]};
    };
  } else {
    const char* name = column.size() > 0 ? "Voltage" : "Torque";
    d.force = [f = make_law<1>(law, times, all, name, "must give one number")](double t) { return f(t)[0]; };
  }
  return d;
}

namespace {

LoadDrive make_load(const PyLoad& given, const Eigen::VectorXd& times, AllAsked& all) {
  const py::object& law = given.law;
  LoadDrive d{given.place, {}, {}};
  all.push_back(nullptr);
  if (given.place.by_state) {
    d.wrench = [](double t) { return Vec6<double>(Vec6<double>::Unit(0) * t); };
  } else if (py::isinstance<py::tuple>(law)) {
    const auto parts = law.cast<std::vector<PiecewisePolynomial>>();
    d.breaks = parts.at(0).breaks();
    d.wrench = PolynomialWrench{parts};
  } else {
    d.wrench = [f = make_law<6>(law, times, all, "Load", "must give six numbers")](double t) {
      return Vec6<double>(Eigen::Map<const Vec6<double>>(f(t).data()));
    };
  }
  return d;
}

Feedback make_feedback(const PyFeedback& given, const Eigen::VectorXd& times, AllAsked& all) {
  Feedback f{given.column, given.by_q, given.by_v};
  f.limit = given.limit;
  if (given.reference.is_none()) return f;
  const Drive d = make_drive({0, false, given.reference, {}}, times, all);
  f.reference = d.force;
  f.breaks = d.breaks;
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
            [shared = law.cast<std::shared_ptr<MpcLaw>>()](double t, const Vector& q, const Vector& v, const Vector&,
                                                           Vector& force) { force = (*shared)(t, q, v); }};
#endif
  return {first, period, delay,
          [shared = std::make_shared<py::object>(law), nv](double t, const Vector& q, const Vector& v, const Vector& a,
                                                           Vector& force) {
            const Locked lock;
            force = call(*shared, t, q, v, a).cast<Vector>();
            if (force.size() != nv || !force.allFinite())
              bad_value("control at t = " + std::to_string(t), "nan, inf or a wrong length",
                        "must give finite numbers");
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
    : problem(std::shared_ptr<const Arm>(std::shared_ptr<void>(), &arm)) {  // Python's, kept alive by this
  for (const PyDrive& x : drives) problem.drives.push_back(make_drive(x, times, asked));
  for (const PyLoad& x : loads) problem.loads.push_back(make_load(x, times, asked));
  for (const PyFeedback& x : feedback) problem.feedback.push_back(make_feedback(x, times, asked));
  for (const PySampler& x : samplers) problem.samplers.push_back(make_sampler(x, arm.nv()));
  for (std::size_t k = 0; k < events.size(); ++k) problem.events.push_back(make_event(k, events[k]));
}

namespace {

template <class T, class... Of, std::size_t... K>
T made(const py::tuple& t, std::index_sequence<K...>) {
  return T{t[K].template cast<Of>()...};
}

/// The Python objects in a record: the garbage collector must see them, or a function that knows what holds the record
/// would keep both alive.
template <class T>
struct Seen {
  static inline std::vector<py::object T::*> fields;

  template <class Of>
  static void add(Of T::* field) {
    if constexpr (std::is_same_v<Of, py::object>) fields.push_back(field);
  }
  static T* in(PyObject* self) {  // null before it is constructed
    const auto value = reinterpret_cast<py::detail::instance*>(self)->get_value_and_holder();
    return value.holder_constructed() ? value.template value_ptr<T>() : nullptr;
  }
  static int visit(PyObject* self, visitproc visit, void* arg) {
    Py_VISIT(Py_TYPE(self));
    if (T* record = in(self))
      for (const auto field : fields) Py_VISIT((record->*field).ptr());
    return 0;
  }
  static int clear(PyObject* self) {
    if (T* record = in(self))
      for (const auto field : fields) record->*field = py::none();
    return 0;
  }
  static void set_up(PyHeapTypeObject* type) {
    type->ht_type.tp_flags |= Py_TPFLAGS_HAVE_GC;
    type->ht_type.tp_traverse = visit;
    type->ht_type.tp_clear = clear;
  }
};

/// A plain class: its constructor takes all fields, in their order; they can be read, and it pickles.
template <class T, class... Of>
py::class_<T> bind_record(py::module_& m, const char* name, const std::pair<const char*, Of T::*>&... fields) {
  (Seen<T>::add(fields.second), ...);
  py::class_<T> out(m, name, py::custom_type_setup(&Seen<T>::set_up));
  out.def(py::init([](const Of&... x) { return T{x...}; }), py::arg(fields.first)...);
  (out.def_readonly(fields.first, fields.second), ...);
  out.def(py::pickle(
      [at = std::make_tuple(fields.second...)](const T& x) {
        return std::apply([&x](auto... one) { return py::make_tuple(x.*one...); }, at);
      },
      [](const py::tuple& t) { return made<T, Of...>(t, std::index_sequence_for<Of...>()); }));
  return out;
}
template <class T, class Of>
std::pair<const char*, Of T::*> field(const char* name, Of T::* at) {
  return {name, at};
}

}  // namespace

std::shared_ptr<const StateForce> state_force(const py::object& law) {
  const std::shared_ptr<py::object> shared(new py::object(law), [](py::object* x) {
    const Locked lock;
    delete x;
  });
  return std::make_shared<const StateForce>(
      [shared](double t, const Eigen::Vector3d& p, const Eigen::Matrix3d& R, const Vec6<double>& velocity) {
        const Locked lock;
        const auto found = call(*shared, t, p, R, velocity).cast<std::array<double, 6>>();
        for (const double x : found)
          if (!std::isfinite(x)) bad_value("Load at t", t, "gave nan or inf; it must be finite");
        return Vec6<double>(Eigen::Map<const Vec6<double>>(found.data()));
      });
}

void bind_problem(py::module_& m) {
  using Eigen::VectorXd;
  py::class_<Remembered, std::shared_ptr<Remembered>>(m, "Remembered")
      .def(py::init<py::object>(), py::arg("law"))
      .def(
          "__call__", [](const Remembered& x, double t) { return call(x.law(), t); }, py::arg("t"))
      .def_property_readonly("law", &Remembered::law);
  bind_record(m, "Drive", field("rate", &PyDrive::rate), field("moves", &PyDrive::moves), field("law", &PyDrive::law),
              field("column", &PyDrive::column))
      .def(py::init([](int rate, bool moves, const py::object& law) { return PyDrive{rate, moves, law, {}}; }),
           py::arg("rate"), py::arg("moves"), py::arg("law"));
  bind_record(m, "LoadLaw", field("place", &PyLoad::place), field("law", &PyLoad::law));
  bind_record(m, "Feedback", field("column", &PyFeedback::column), field("by_q", &PyFeedback::by_q),
              field("by_v", &PyFeedback::by_v), field("reference", &PyFeedback::reference),
              field("limit", &PyFeedback::limit));
  bind_record(m, "Sampler", field("first", &PySampler::first), field("period", &PySampler::period),
              field("delay", &PySampler::delay), field("law", &PySampler::law));
  bind_record(m, "Event", field("value", &PyEvent::value), field("terminal", &PyEvent::terminal),
              field("direction", &PyEvent::direction));
  py::class_<PyProblem, std::shared_ptr<PyProblem>>(m, "Problem")
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

py::tuple event_rows(const std::vector<EventLog>& logs, Eigen::Index nq, Eigen::Index nv) {
  py::list t, q, v;
  for (const EventLog& log : logs) {
    const auto n = static_cast<Eigen::Index>(log.t.size());
    Rows q_of(n, nq), v_of(n, nv);
    for (Eigen::Index i = 0; i < n; ++i) {
      q_of.row(i) = log.q[static_cast<std::size_t>(i)].head(nq);
      v_of.row(i) = log.v[static_cast<std::size_t>(i)].head(nv);
    }
    t.append(Eigen::VectorXd(Eigen::Map<const Eigen::VectorXd>(log.t.data(), n)));
    q.append(q_of);
    v.append(v_of);
  }
  return py::make_tuple(t, q, v);
}

py::dict tangent_rows(const std::vector<Trajectory::Tangent>& all, Eigen::Index done) {
  const auto stacked = [&](auto part) {
    const auto count = static_cast<py::ssize_t>(all.size());
    const Eigen::Index width = all.empty() ? 0 : (all.front().*part).cols();
    py::array_t<double> out({count, static_cast<py::ssize_t>(done), static_cast<py::ssize_t>(width)});
    for (py::ssize_t k = 0; k < count && width > 0; ++k)
      Eigen::Map<Rows>(out.mutable_data(k), done, width) = (all[static_cast<std::size_t>(k)].*part).topRows(done);
    return out;
  };
  using Tangent = Trajectory::Tangent;
  return py::dict(py::arg("q") = stacked(&Tangent::q), py::arg("v") = stacked(&Tangent::v),
                  py::arg("a") = stacked(&Tangent::a), py::arg("tau") = stacked(&Tangent::tau),
                  py::arg("friction") = stacked(&Tangent::friction));
}
