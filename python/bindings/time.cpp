#include <memory>

#include "flexarm/check.hpp"
#include "flexarm/scene.hpp"
#include "flexarm/simulate.hpp"
#include "laws.hpp"

using namespace flexarm;

namespace {

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

LinearSolver solver_of(const std::string& name) {
  return name == "dense" ? LinearSolver::dense : name == "chain" ? LinearSolver::chain : LinearSolver::automatic;
}

/// The trajectory that integrate(alive) makes without the interpreter's lock, with checks for Ctrl-C and progress ten
/// times a second.
template <class Integrate>
py::dict run(const py::object& alive, const Integrate& integrate) {
  Lookout lookout(alive);
  const auto look_around = [&lookout](double now) { return lookout(now); };
  Trajectory r;
  {
    const Unlocked free;
    r = integrate(look_around);
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
  out["contacts"] = head(r.contacts);
  out["loops"] = head(r.loops);
  out["reached"] = r.reached;
  out["failure"] = r.failure;
  out["terminated"] = r.terminated;
  out["events"] = event_rows(r.events, r.q.cols(), r.v.cols());
  out["stats"] = stats;
  out["hasty"] = r.stats.hasty;
  out["doubt"] = r.stats.doubt;
  if (!r.tangents.empty()) {
    out["tangents"] = tangent_rows(r.tangents, r.done);
    out["event_slopes"] = event_slopes(r);
  }
  return out;
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
      .def("standing", &PiecewisePolynomial::standing)
      .def_property_readonly("breaks", &PiecewisePolynomial::breaks)
      .def_property_readonly("coefficients", [](const PiecewisePolynomial& p) { return Rows(p.coefficients()); });

  py::class_<LinearLaw>(m, "LinearLaw")
      .def(py::init([](const Eigen::MatrixXd& A, const Eigen::MatrixXd& B, const Eigen::MatrixXd& C,
                       const Eigen::MatrixXd& D, const Eigen::MatrixXd& columns, const Eigen::MatrixXd& by_q,
                       const Eigen::MatrixXd& by_v, const Eigen::VectorXd& limit, const py::object& reference,
                       const py::object& read, const Eigen::VectorXd& u0, const Eigen::MatrixXd& windup,
                       const Eigen::VectorXd& reach, const Eigen::VectorXd& offset, const Eigen::VectorXd& resolution,
                       const Eigen::MatrixXd& start, double first) {
             LinearLaw law{A,  B,  C,      D,     columns, by_q,       by_v,  limit, {},
                           {}, u0, windup, reach, offset,  resolution, start, first};
             if (py::isinstance<py::function>(reference))
               law.reference = [r = std::make_shared<py::object>(reference)](double t, Eigen::VectorXd& out) {
                 const Locked lock;
                 out = call(*r, t).cast<Eigen::VectorXd>();
               };
             else {
               PolynomialValues values;
               if (py::isinstance<py::list>(reference))
                 for (const auto& part : reference.cast<std::vector<PiecewisePolynomial>>())
                   values.of.push_back(part.standing());
               else
                 for (const double r : reference.cast<Eigen::VectorXd>())
                   values.of.push_back(PiecewisePolynomial::constant(r));
               law.reference = values;
             }
             if (!read.is_none())
               law.read = [r = std::make_shared<py::object>(read)](double t, const Eigen::VectorXd& q,
                                                                   const Eigen::VectorXd& v, const Eigen::VectorXd& a,
                                                                   Eigen::VectorXd& y) {
                 const Locked lock;
                 y = call(*r, t, q, v, a).cast<Eigen::VectorXd>();
               };
             return law;
           }),
           py::arg("A"), py::arg("B"), py::arg("C"), py::arg("D"), py::arg("columns"), py::arg("by_q"), py::arg("by_v"),
           py::arg("limit"), py::arg("reference"), py::arg("read"), py::arg("u0"), py::arg("windup"), py::arg("reach"),
           py::arg("offset"), py::arg("resolution"), py::arg("start"), py::arg("first"))
      .def_readonly("columns", &LinearLaw::columns)
      .def_property_readonly("reads", [](const LinearLaw& law) { return bool(law.read); });

  py::class_<Neighbour>(m, "Neighbour")
      .def(py::init(
               [](double weight, double offset, const PyProblem& of) { return Neighbour{weight, offset, of.problem}; }),
           py::arg("weight"), py::arg("offset"), py::arg("problem"), py::keep_alive<1, 4>());
  py::class_<Parameter>(m, "Parameter")
      .def(py::init<double, bool, bool, std::vector<Neighbour>>(), py::arg("scale"), py::arg("forces_only"),
           py::arg("start_only"), py::arg("neighbours"), py::keep_alive<1, 5>());

  py::class_<PyIntegrator>(m, "Integrator")
      .def(py::init([](const std::string& name, double step, double rtol, double spectral_radius, int stages,
                       double atol, int max_order, const std::string& linear_solver, std::optional<double> tolerance) {
             return PyIntegrator{{name, rtol, spectral_radius, stages, tolerance.value_or(0.0)},
                                 step,
                                 {rtol, atol, max_order, solver_of(linear_solver)}};
           }),
           py::arg("name"), py::kw_only(), py::arg("step") = 0.0, py::arg("rtol") = 0.0,
           py::arg("spectral_radius") = 1.0, py::arg("stages") = 4, py::arg("atol") = 0.0, py::arg("max_order") = 5,
           py::arg("linear_solver") = "auto", py::arg("tolerance") = py::none());

  m.def(
      "simulate_ida",
      [](const PyProblem& of, const Eigen::VectorXd& t, const PyIntegrator& by, const py::object& slow,
         const py::object& alive, const std::vector<Parameter>& parameters) {
        IdaOptions options = by.ida;
        if (!slow.is_none())
          options.slow = [&slow](double now, long steps) {
            const Locked lock;
            call(slow, now, steps);
          };
        return run(alive, [&](const Alive& look) { return simulate_ida(of.problem, t, options, look, parameters); });
      },
      py::arg("problem"), py::arg("t"), py::arg("integrator"), py::kw_only(), py::arg("slow"), py::arg("alive"),
      py::arg("parameters"));

  m.def(
      "simulate_fixed",
      [](const PyProblem& of, const Eigen::VectorXd& t, const PyIntegrator& by, const py::object& alive, Tape* tape) {
        const std::unique_ptr<Step> method = by.method.on(*of.problem.arm, by.step);
        if (tape) *tape = Tape(method->stages());
        return run(alive,
                   [&](const Alive& look) { return simulate_fixed(of.problem, t, *method, by.step, look, tape); });
      },
      py::arg("problem"), py::arg("t"), py::arg("integrator"), py::kw_only(), py::arg("alive"),
      py::arg("tape") = nullptr);

#ifdef FLEXARM_SCENES
  m.def(
      "scene_text",
      [](const PyProblem& of, const Eigen::VectorXd& t, const PyIntegrator& by) {
        return scene_text({of.problem, t, by.method, by.step, by.ida});
      },
      py::arg("problem"), py::arg("t"), py::arg("integrator"));
#endif

  py::class_<Simulation::State>(m, "State").def_readonly("t", &Simulation::State::t);
  py::class_<Simulation>(m, "Simulation")
      .def(py::init([](const PyProblem& of, const PyIntegrator& by, double t) {
             return Simulation(of.problem, by.method, by.step, t);
           }),
           py::keep_alive<1, 2>(), py::arg("problem"), py::arg("integrator"), py::arg("t"))
      .def("step", [](Simulation& s) { return s.step() == Status::ok; })
      .def(
          "advance",
          [](Simulation& s, double until) {
            Lookout lookout;
            Status found;
            {
              const Unlocked free;
              found = s.advance(until, [&lookout](double now) { return lookout(now); });
            }
            if (found == Status::ok && s.t() < until && !s.terminated()) {
              PyErr_SetNone(PyExc_KeyboardInterrupt);
              throw py::error_already_set();
            }
            return found == Status::ok;
          },
          py::arg("until"))
      .def_property_readonly("t", &Simulation::t)
      .def_property_readonly("q", &Simulation::q, py::return_value_policy::copy)
      .def_property_readonly("v", &Simulation::v, py::return_value_policy::copy)
      .def_property_readonly("a", &Simulation::a, py::return_value_policy::copy)
      .def_property_readonly("tau", &Simulation::tau, py::return_value_policy::copy)
      .def_property_readonly("friction", &Simulation::friction, py::return_value_policy::copy)
      .def_property_readonly("failure", &Simulation::failure)
      .def_property_readonly("steps", &Simulation::steps)
      .def_property_readonly("failed_steps", &Simulation::failed_steps)
      .def_property_readonly("terminated", &Simulation::terminated)
      .def_property_readonly("events",
                             [](const Simulation& s) { return event_rows(s.events(), s.q().size(), s.v().size()); })
      .def("set_tau", &Simulation::set_tau, py::arg("tau"))
      .def("set_force", &Simulation::set_force, py::arg("drive"), py::arg("value"))
      .def("set_load", &Simulation::set_load, py::arg("load"), py::arg("wrench"))
      .def("set_reference", &Simulation::set_reference, py::arg("feedback"), py::arg("value"))
      .def("state", &Simulation::state)
      .def("restore", &Simulation::restore, py::arg("state"));
}
