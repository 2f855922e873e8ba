#include <algorithm>
#include <memory>

#include "evaluation.hpp"
#include "flexarm/check.hpp"
#include "flexarm/collocation.hpp"
#include "flexarm/control.hpp"
#include "flexarm/friction.hpp"
#include "flexarm/ida.hpp"
#include "flexarm/rollout_tape.hpp"
#include "flexarm/run_derivatives.hpp"
#include "flexarm/simulate.hpp"
#include "flexarm/step_derivatives.hpp"

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

/// A drive from Python: a piecewise polynomial, or a callable t -> force, t -> (q, v, a), whose calls are noted.
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

/// A load's value in time: six piecewise polynomials, or a callable t -> six numbers.
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

/// An event from Python: a callable (t, q, v) -> number.
Event make_event(std::size_t k, const py::object& law, int terminal, int direction) {
  const auto shared = std::make_shared<py::object>(law);
  const std::string name = "events[" + std::to_string(k) + "]";
  const auto value = [shared, name](double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
    const Locked lock;
    const py::object g = call(*shared, t, q, v);
    try {
      return g.cast<double>();
    } catch (const py::cast_error&) {
      bad_value(name + " at t = " + std::to_string(t), std::string(py::repr(g)), "must give one number");
    }
  };
  return {value, terminal, direction};
}

/// (value, terminal, direction) of each event.
using EventLaws = std::vector<std::tuple<py::object, int, int>>;

/// t (n), q (n, nq), v (n, nv) of each event.
py::list event_rows(const Trajectory& r) {
  py::list out;
  for (const EventLog& log : r.events) {
    const auto n = static_cast<Eigen::Index>(log.t.size());
    Rows q(n, r.q.cols()), v(n, r.v.cols());
    for (Eigen::Index i = 0; i < n; ++i) {
      q.row(i) = log.q[static_cast<std::size_t>(i)];
      v.row(i) = log.v[static_cast<std::size_t>(i)];
    }
    out.append(py::make_tuple(Eigen::VectorXd(Eigen::Map<const Eigen::VectorXd>(log.t.data(), n)), q, v));
  }
  return out;
}

/// (coordinate, is a motion, law, column or none) of each drive, and (place, law) of each load.
using Laws = std::vector<std::tuple<int, bool, py::object, Eigen::VectorXd>>;
using LoadLaws = std::vector<std::pair<Load, py::object>>;

/// (column, by_q, by_v, reference or None, limit) of each law without memory.
using FeedbackLaws = std::vector<std::tuple<Eigen::VectorXd, Eigen::VectorXd, Eigen::VectorXd, py::object, double>>;
/// (first, period, delay, law) of each sampled one.
using SampledLaws = std::vector<std::tuple<double, double, double, py::object>>;

Control make_control(const FeedbackLaws& feedback, const SampledLaws& sampled, int nv, const Eigen::VectorXd& times,
                     AllAsked& all) {
  std::vector<Feedback> laws;
  for (const auto& [column, by_q, by_v, reference, limit] : feedback) {
    Feedback f{column, by_q, by_v};
    f.limit = limit;
    if (!reference.is_none()) {
      const Drive d = make_drive(0, false, reference, {}, times, all);
      f.reference = d.force;
      f.breaks = d.breaks;
    }
    laws.push_back(f);
  }
  std::vector<Sampler> samplers;
  for (const auto& [first, period, delay, law] : sampled) {
    if (py::isinstance<LinearLaw>(law)) {
      samplers.push_back({first, period, delay, law.cast<LinearLaw>()});
      continue;
    }
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

/// A run's problem from Python, as its derivatives take it.
struct Problem {
  std::vector<Drive> drives;
  std::vector<LoadDrive> loads;
  AllAsked asked;
  Control control;
  Eigen::VectorXd tau;
  const Arm& arm;

  Problem(const Arm& arm_, const Laws& laws, const Eigen::VectorXd& t, const Eigen::VectorXd& tau_,
          const LoadLaws& wrenches, const FeedbackLaws& feedback)
      : control(make_control(feedback, {}, arm_.nv(), t, asked)), tau(tau_), arm(arm_) {
    for (const auto& [coordinate, is_motion, law, column] : laws)
      drives.push_back(make_drive(coordinate, is_motion, law, column, t, asked));
    for (const auto& [load, law] : wrenches) loads.push_back(make_load(load, law, t, asked));
  }
  operator Driven() { return {arm, drives, loads, tau, &control}; }
};

/// (weight, offset, arm, drives, loads, tau, feedback, sampled, q0, v0) of each neighbour of a problem, and (scale,
/// whether it changes no more than controllers and the start, neighbours) of each parameter.
using NeighbourLaws = std::tuple<double, double, py::object, Laws, LoadLaws, Eigen::VectorXd, FeedbackLaws, SampledLaws,
                                 Eigen::VectorXd, Eigen::VectorXd>;
using ParameterLaws = std::vector<std::tuple<double, bool, std::vector<NeighbourLaws>>>;

/// Parameters, and the controllers of their neighbours.
struct Parameters {
  std::vector<Parameter> all;
  std::vector<std::unique_ptr<Control>> controls;

  Parameters(const ParameterLaws& given, const Eigen::VectorXd& times) {
    AllAsked asked;  // nobody looks at where the neighbours' callables were asked
    for (const auto& [scale, forces_only, neighbours] : given) {
      all.push_back({scale, forces_only, {}});
      for (const auto& [weight, offset, arm, drives, loads, tau, feedback, sampled, q0, v0] : neighbours) {
        const Arm& its = arm.cast<const Arm&>();
        controls.push_back(std::make_unique<Control>(make_control(feedback, sampled, its.nv(), times, asked)));
        Neighbour n{weight, offset, &its, {}, {}, tau, controls.back().get(), q0, v0};
        for (const auto& [coordinate, is_motion, law, column] : drives)
          n.drives.push_back(make_drive(coordinate, is_motion, law, column, times, asked));
        for (const auto& [load, law] : loads) n.loads.push_back(make_load(load, law, times, asked));
        all.back().neighbours.push_back(std::move(n));
      }
    }
  }
};

/// q, v, a, tau and friction by the parameters, (np, nt, n) each.
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

/// What a run is given beside its integrator.
struct Given {
  const Arm& arm;
  const Laws& drives;
  const Eigen::VectorXd &t, &q0, &v0, &tau;
  bool composite;
  const py::object& alive;
  const LoadLaws& loads;
  const EventLaws& events;
  const FeedbackLaws& feedback;
  const SampledLaws& sampled;
  const ParameterLaws& parameters;
};

/// Runs integrate(drives, t, q, v, tau, alive, loads, events, control) -> Trajectory, once where the method `rubs`,
/// else from one switch of dry friction to the next, without the interpreter's lock, looking around ten times a second:
/// Ctrl-C, progress.
template <class Integrate>
py::dict run(const Given& given, bool rubs, double step, const Integrate& integrate) {
  std::vector<Drive> laws;
  AllAsked asked;  // in the order of drives, loads, and references of control
  for (const auto& [coordinate, is_motion, law, column] : given.drives)
    laws.push_back(make_drive(coordinate, is_motion, law, column, given.t, asked));
  std::vector<LoadDrive> wrenches;
  for (const auto& [load, law] : given.loads) wrenches.push_back(make_load(load, law, given.t, asked));
  Control control = make_control(given.feedback, given.sampled, given.arm.nv(), given.t, asked);
  std::vector<Event> watched;
  for (std::size_t k = 0; k < given.events.size(); ++k)
    std::apply([&](const auto&... parts) { watched.push_back(make_event(k, parts...)); }, given.events[k]);
  const Parameters parameters(given.parameters, given.t);
  Lookout lookout(given.alive);
  const auto look_around = [&lookout](double now) { return lookout(now); };
  Trajectory r;
  {
    const Unlocked free;
    const auto part = [&](const auto& drives, const auto& t, const auto& q, const auto& v, const auto& tau,
                          const auto& events, const auto& by) {
      return integrate(drives, t, q, v, tau, look_around, wrenches, events, control, by);
    };
    r = rubs ? part(laws, given.t, given.q0, given.v0, given.tau, watched, parameters.all)
             : simulate_with_friction(given.arm, laws, given.t, given.q0, given.v0, given.tau, wrenches, watched,
                                      given.composite, part, &control, step, parameters.all);
  }
  py::dict stats, out;
  stats["steps"] = r.stats.steps;
  stats["evaluations"] = r.stats.residuals;
  stats["jacobians"] = r.stats.jacobians;
  stats["newton_iterations"] = r.stats.newton_iterations;
  stats["linear_iterations"] = r.stats.linear_iterations;
  stats["failed_steps"] = r.stats.failed_steps;
  if (r.rubs) stats["switches"] = r.stats.switches;
  stats["wall_time"] = r.stats.wall_time;
  const auto head = [&](const Rows& x) { return Rows(x.topRows(r.done)); };
  out["q"] = head(r.q);
  out["v"] = head(r.v);
  out["a"] = head(r.a);
  out["tau"] = head(r.tau);
  out["friction"] = r.rubs ? py::cast(head(r.friction)) : py::none();
  out["reached"] = r.reached;
  out["failure"] = r.failure;
  out["terminated"] = r.terminated;
  out["events"] = event_rows(r);
  out["stats"] = stats;
  if (!r.tangents.empty()) out["tangents"] = tangent_rows(r.tangents, r.done, r.v.cols());
  py::list calls;
  for (const auto& a : asked) calls.append(a ? py::cast(a->calls) : py::none());
  out["asked"] = calls;
  return out;
}

/// The fixed-step method of a name; those of one step have their rows in lanes/methods.hpp.
std::unique_ptr<Step> make_step(const std::string& integrator, const Arm& arm, double step, double rtol,
                                double spectral_radius, int stages) {
  constexpr DryFriction ours = DryFriction::left_to_caller;
  if (integrator == "gauss") return std::make_unique<CollocationStep>(arm, CollocationOptions{stages, rtol}, ours);
  return std::make_unique<OneStep>(integrator, arm, step, ImplicitOptions{spectral_radius, rtol}, ours);
}

}  // namespace

void bind_time(py::module_& m) {
  py::dict methods;
  for (const OneStep::Traits& t : OneStep::methods())
    methods[t.name.c_str()] = py::dict(py::arg("rubs") = t.rubs, py::arg("iterates") = t.iterates,
                                       py::arg("damps") = t.damps, py::arg("limited") = t.limit > 0.0);
  m.attr("ONE_STEP") = methods;

  py::class_<PiecewisePolynomial>(m, "PiecewisePolynomial")
      .def(py::init<Eigen::VectorXd, Eigen::MatrixXd>(), py::arg("breaks"), py::arg("coefficients"))
      .def(
          "__call__",
          [](const PiecewisePolynomial& p, double t) {
            const MotionValue f = p(t);
            return py::make_tuple(f.q, f.v, f.a);
          },
          py::arg("t"))
      .def("__repr__",
           [](const PiecewisePolynomial& p) {
             return "<" + std::to_string(p.breaks().size() - 1) +
                    " polynomial pieces, t = " + std::to_string(p.breaks()[0]) + " to " +
                    std::to_string(p.breaks().tail(1)[0]) + ">";
           })
      .def(py::pickle([](const PiecewisePolynomial& p) { return py::make_tuple(p.breaks(), Rows(p.coefficients())); },
                      [](const py::tuple& t) {
                        return PiecewisePolynomial(t[0].cast<Eigen::VectorXd>(), t[1].cast<Eigen::MatrixXd>());
                      }))
      .def_property_readonly("breaks", &PiecewisePolynomial::breaks)
      .def_property_readonly("coefficients", [](const PiecewisePolynomial& p) { return Rows(p.coefficients()); });

  m.def(
      "step_derivatives",
      [](const PyArm& arm, const Vectors& q, const Vectors& v, const Vectors& tau, const std::string& integrator,
         double step, double rtol, double spectral_radius, const std::vector<Load>& places, const Vectors& wrenches) {
        StepDerivatives d(integrator, arm, step, ImplicitOptions{spectral_radius, rtol}, places);
        const auto lent = arm.workspace({{}, places}, true);
        for (std::size_t k = 0; k < places.size(); ++k)
          (*lent).loads[k].wrench = rows(wrenches).row(static_cast<Eigen::Index>(k));
        const int n = arm.nv();
        Answers end_q(q, {arm.nq()}), end_v(v, {n}), by_state(q, {2 * n, 2 * n}), by_tau(q, {2 * n, n});
        std::vector<int> status(static_cast<std::size_t>(count(q)));
        Eigen::MatrixXd A, B;
        for_states(arm, count(q), 4 * n, [&](Eigen::Index k) {
          Eigen::VectorXd x = rows(q).row(k), y = rows(v).row(k);
          const Status found = d(*lent, x, y, rows(tau).row(k));
          status[static_cast<std::size_t>(k)] = static_cast<int>(found);
          if (found != Status::ok) return;
          d.matrices(A, B);
          end_q[k] = x.transpose();
          end_v[k] = y.transpose();
          by_state[k] = A;
          by_tau[k] = B;
        });
        return py::make_tuple(end_q.all(), end_v.all(), by_state.all(), by_tau.all(), status);
      },
      py::arg("arm"), py::arg("q"), py::arg("v"), py::arg("tau"), py::arg("integrator"), py::arg("step"),
      py::arg("rtol"), py::arg("spectral_radius"), py::arg("loads"), py::arg("wrenches"));

  py::class_<LinearLaw>(m, "LinearLaw")
      .def(py::init([](const Eigen::MatrixXd& A, const Eigen::MatrixXd& B, const Eigen::MatrixXd& C,
                       const Eigen::MatrixXd& D, const Eigen::MatrixXd& columns, const Eigen::MatrixXd& by_q,
                       const Eigen::MatrixXd& by_v, double limit, const py::object& reference, const py::object& read) {
             LinearLaw law{A, B, C, D, columns, by_q, by_v, limit, {}, {}};
             if (py::isinstance<py::function>(reference))
               law.reference = [r = std::make_shared<py::object>(reference)](double t) {
                 const Locked lock;
                 return call(*r, t).cast<Eigen::VectorXd>();
               };
             else
               law.reference = [r = reference.cast<Eigen::VectorXd>()](double) { return r; };
             if (!read.is_none())
               law.read = [r = std::make_shared<py::object>(read)](double t, const Eigen::VectorXd& q,
                                                                   const Eigen::VectorXd& v, const Eigen::VectorXd& a) {
                 const Locked lock;
                 return call(*r, t, q, v, a).cast<Eigen::VectorXd>();
               };
             return law;
           }),
           py::arg("A"), py::arg("B"), py::arg("C"), py::arg("D"), py::arg("columns"), py::arg("by_q"), py::arg("by_v"),
           py::arg("limit"), py::arg("reference"), py::arg("read"))
      .def_property_readonly("reads", [](const LinearLaw& law) { return bool(law.read); });

  m.def(
      "simulate_ida",
      [](const Arm& arm, const Laws& drives, const Eigen::VectorXd& t, const Eigen::VectorXd& q0,
         const Eigen::VectorXd& v0, const Eigen::VectorXd& tau, double rtol, double atol, int max_order,
         const std::string& linear_solver, const py::object& slow, bool composite, const py::object& alive,
         const LoadLaws& loads, const EventLaws& events, const FeedbackLaws& feedback, const SampledLaws& sampled,
         const ParameterLaws& by) {
        const LinearSolver solver = linear_solver == "dense"   ? LinearSolver::dense
                                    : linear_solver == "chain" ? LinearSolver::chain
                                                               : LinearSolver::automatic;
        IdaOptions options{rtol, atol, max_order, composite, solver, DryFriction::left_to_caller};
        if (!slow.is_none())
          options.slow = [&slow](double now, long steps) {
            const Locked lock;
            call(slow, now, steps);
          };
        return run({arm, drives, t, q0, v0, tau, composite, alive, loads, events, feedback, sampled, by}, false, 0.0,
                   [&](const auto& laws, const auto& times, const auto& q, const auto& v, const auto& forces,
                       const auto& look_around, const auto& wrenches, const auto& watched, Control& control,
                       const auto& parameters) {
                     return simulate_ida(arm, laws, times, q, v, forces, options, look_around, wrenches, watched,
                                         &control, parameters);
                   });
      },
      py::arg("arm"), py::arg("drives"), py::arg("t"), py::arg("q0"), py::arg("v0"), py::arg("tau"), py::arg("rtol"),
      py::arg("atol"), py::arg("max_order"), py::arg("linear_solver"), py::arg("slow"), py::arg("composite"),
      py::arg("alive"), py::arg("loads"), py::arg("events"), py::arg("feedback"), py::arg("sampled"),
      py::arg("parameters"));

  m.def(
      "simulate_fixed",
      [](const Arm& arm, const Laws& drives, const Eigen::VectorXd& t, const Eigen::VectorXd& q0,
         const Eigen::VectorXd& v0, const Eigen::VectorXd& tau, const std::string& integrator, double step, double rtol,
         double spectral_radius, int stages, bool composite, const py::object& alive, const LoadLaws& loads,
         const EventLaws& events, const FeedbackLaws& feedback, const SampledLaws& sampled, Tape* tape) {
        const std::unique_ptr<Step> method = make_step(integrator, arm, step, rtol, spectral_radius, stages);
        if (tape) *tape = Tape(method->stages());
        return run(
            {arm, drives, t, q0, v0, tau, composite, alive, loads, events, feedback, sampled, {}},
            method->rubbing() != nullptr, step,
            [&](const auto& laws, const auto& times, const auto& q, const auto& v, const auto& forces,
                const auto& look_around, const auto& wrenches, const auto& watched, Control& control, const auto&) {
              // what is left after a switch may be shorter than a step
              const double left = times[times.size() - 1] - times[0];
              return simulate_fixed(arm, laws, times, q, v, forces, *method,
                                    times[0] > t[0] ? std::min(step, left) : step, composite, look_around, wrenches,
                                    watched, &control, tape);
            });
      },
      py::arg("arm"), py::arg("drives"), py::arg("t"), py::arg("q0"), py::arg("v0"), py::arg("tau"),
      py::arg("integrator"), py::arg("step"), py::arg("rtol"), py::arg("spectral_radius"), py::arg("stages"),
      py::arg("composite"), py::arg("alive"), py::arg("loads"), py::arg("events"), py::arg("feedback"),
      py::arg("sampled"), py::arg("tape") = nullptr);

  py::class_<Problem>(m, "Problem")
      .def(py::init<const Arm&, const Laws&, const Eigen::VectorXd&, const Eigen::VectorXd&, const LoadLaws&,
                    const FeedbackLaws&>(),
           py::arg("arm"), py::arg("drives"), py::arg("t"), py::arg("tau"), py::arg("loads"), py::arg("feedback"),
           py::keep_alive<1, 2>());

  const auto shaped = [](const std::vector<double>& x, const Tape& tape) {
    const auto height = tape.points();
    return Rows(
        Eigen::Map<const Rows>(x.data(), height, height > 0 ? static_cast<Eigen::Index>(x.size()) / height : 0));
  };
  py::class_<Tape>(m, "Tape")
      .def(py::init([] { return Tape(Stages{}); }))
      .def_property_readonly("t",
                             [](const Tape& tape) {
                               return Eigen::VectorXd(Eigen::Map<const Eigen::VectorXd>(tape.t.data(), tape.points()));
                             })
      .def_property_readonly("q", [shaped](const Tape& tape) { return shaped(tape.q, tape); })
      .def_property_readonly("v", [shaped](const Tape& tape) { return shaped(tape.v, tape); })
      .def_property_readonly("a", [shaped](const Tape& tape) { return shaped(tape.a, tape); })
      .def_property_readonly("switches",
                             [](const Tape& tape) {
                               Eigen::VectorXd ends(static_cast<Eigen::Index>(tape.switches.size()));
                               for (Eigen::Index k = 0; k < ends.size(); ++k) {
                                 const Tape::Switch& s = tape.switches[static_cast<std::size_t>(k)];
                                 ends[k] = s.t + s.h;
                               }
                               return ends;
                             })
      .def(
          "balance",
          [](const Tape& tape, Problem& of) {
            Balance found;
            {
              const Unlocked free;
              found = balance(of, tape);
            }
            return py::make_tuple(found.needed, found.applied);
          },
          py::arg("problem"))
      .def(
          "weigh",
          [](const Tape& tape, const std::vector<Problem*>& problems, const Rows& needed, const Rows& applied,
             int threads) {
            const Unlocked free;
            std::vector<Driven> all;
            for (Problem* p : problems) all.push_back(*p);
            return weigh(all, tape, needed, applied, threads);
          },
          py::arg("problems"), py::arg("needed"), py::arg("applied"), py::arg("threads"))
      .def(
          "repeat_switches",
          [](const Tape& tape, Problem& of, double rtol, double spectral_radius) {
            const Unlocked free;
            return repeat_switches(of, tape, {spectral_radius, rtol});
          },
          py::arg("problem"), py::arg("rtol"), py::arg("spectral_radius"))
      .def(
          "tangents",
          [](const Tape& tape, Problem& of, double rtol, double spectral_radius,
             const std::vector<std::pair<Rows, Rows>>& by_p, const std::vector<Rows>& switches, const Rows& q0,
             const Rows& v0, bool accelerations, int threads) {
            std::vector<Balance> balances;
            for (const auto& [needed, applied] : by_p) balances.push_back({needed, applied});
            std::vector<Trajectory::Tangent> found;
            {
              const Unlocked free;
              found = tangents(of, tape, {spectral_radius, rtol}, balances, switches, q0, v0, accelerations, threads);
            }
            return tangent_rows(found, static_cast<Eigen::Index>(tape.rows.size()), of.arm.nv());
          },
          py::arg("problem"), py::arg("rtol"), py::arg("spectral_radius"), py::arg("by_p"), py::arg("switches"),
          py::arg("q0"), py::arg("v0"), py::arg("accelerations"), py::arg("threads"))
      .def(
          "adjoint",
          [](const Tape& tape, Problem& of, double rtol, double spectral_radius, const Rows& q, const Rows& v,
             const Rows& a, const Rows& tau, int threads) {
            Adjoint found;
            {
              const Unlocked free;
              found = adjoint(of, tape, {spectral_radius, rtol}, q, v, a, tau, threads);
            }
            return py::make_tuple(found.q0, found.v0, found.needed, found.applied, found.switches, found.held);
          },
          py::arg("problem"), py::arg("rtol"), py::arg("spectral_radius"), py::arg("q"), py::arg("v"), py::arg("a"),
          py::arg("tau"), py::arg("threads"));

  m.def(
      "roll_on_tape",
      [](const Arm& arm, const std::string& integrator, double step, double rtol, double spectral_radius,
         const Eigen::VectorXd& q0, const Eigen::VectorXd& v0, const Rows& tau) {
        TapedRollout r{Tape(Stages{}), {}, {}, {}};
        {
          const Unlocked free;
          r = roll_on_tape(integrator, arm, step, {spectral_radius, rtol}, q0, v0, tau);
        }
        return py::make_tuple(std::move(r.tape), r.q, r.v, r.first, r.failed, static_cast<int>(r.status));
      },
      py::arg("arm"), py::arg("integrator"), py::arg("step"), py::arg("rtol"), py::arg("spectral_radius"),
      py::arg("q0"), py::arg("v0"), py::arg("tau"));
}
