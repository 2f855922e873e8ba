#include <memory>

#include "flexarm/check.hpp"
#include "flexarm/collocation.hpp"
#include "flexarm/friction.hpp"
#include "flexarm/ida.hpp"
#include "flexarm/simulate.hpp"
#include "laws.hpp"

using namespace flexarm;

namespace {

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

/// Accelerations (nv), and derivatives of q and v at that time by each parameter (nv, np), of each occurrence.
py::list event_slopes(const Trajectory& r) {
  py::list out;
  for (const EventLog& log : r.events) {
    py::list all;
    for (std::size_t i = 0; i < log.a.size(); ++i) all.append(py::make_tuple(log.a[i], log.q_by[i], log.v_by[i]));
    out.append(all);
  }
  return out;
}

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
  out["hasty"] = r.stats.hasty;
  if (!r.tangents.empty()) {
    out["tangents"] = tangent_rows(r.tangents, r.done, r.v.cols());
    out["event_slopes"] = event_slopes(r);
  }
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

  py::class_<LinearLaw>(m, "LinearLaw")
      .def(py::init([](const Eigen::MatrixXd& A, const Eigen::MatrixXd& B, const Eigen::MatrixXd& C,
                       const Eigen::MatrixXd& D, const Eigen::MatrixXd& columns, const Eigen::MatrixXd& by_q,
                       const Eigen::MatrixXd& by_v, const Eigen::VectorXd& limit, const py::object& reference,
                       const py::object& read, const Eigen::VectorXd& u0, const Eigen::MatrixXd& windup,
                       const Eigen::VectorXd& reach) {
             LinearLaw law{A, B, C, D, columns, by_q, by_v, limit, {}, {}, u0, windup, reach};
             if (py::isinstance<py::function>(reference))
               law.reference = [r = std::make_shared<py::object>(reference)](double t) {
                 const Locked lock;
                 return call(*r, t).cast<Eigen::VectorXd>();
               };
             else if (py::isinstance<py::list>(reference))
               law.reference = [parts = reference.cast<std::vector<PiecewisePolynomial>>()](double t) {
                 Eigen::VectorXd r(static_cast<Eigen::Index>(parts.size()));
                 for (std::size_t k = 0; k < parts.size(); ++k) r[static_cast<Eigen::Index>(k)] = parts[k](t).q;
                 return r;
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
           py::arg("limit"), py::arg("reference"), py::arg("read"), py::arg("u0"), py::arg("windup"), py::arg("reach"))
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
}
