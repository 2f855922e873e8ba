#include <memory>

#include "flexarm/check.hpp"
#include "flexarm/collocation.hpp"
#include "flexarm/ida.hpp"
#include "flexarm/simulate.hpp"
#include "laws.hpp"

using namespace flexarm;

namespace {

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

/// A neighbour and a parameter from Python; see Neighbour and Parameter.
struct PyNeighbour {
  double weight, offset;
  const PyProblem* of;
};
struct PyParameter {
  double scale;
  bool forces_only;
  std::vector<PyNeighbour> neighbours;
};

/// The trajectory that integrate(alive) makes without the interpreter's lock, looking around ten times a second:
/// Ctrl-C, progress.
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

  py::class_<PyNeighbour>(m, "Neighbour")
      .def(py::init([](double weight, double offset, const PyProblem& of) { return PyNeighbour{weight, offset, &of}; }),
           py::arg("weight"), py::arg("offset"), py::arg("problem"), py::keep_alive<1, 4>());
  py::class_<PyParameter>(m, "Parameter")
      .def(py::init<double, bool, std::vector<PyNeighbour>>(), py::arg("scale"), py::arg("forces_only"),
           py::arg("neighbours"), py::keep_alive<1, 4>());

  m.def(
      "simulate_ida",
      [](const PyProblem& of, const Eigen::VectorXd& t, double rtol, double atol, int max_order,
         const std::string& linear_solver, const py::object& slow, bool composite, const py::object& alive,
         const std::vector<PyParameter>& parameters) {
        const LinearSolver solver = linear_solver == "dense"   ? LinearSolver::dense
                                    : linear_solver == "chain" ? LinearSolver::chain
                                                               : LinearSolver::automatic;
        IdaOptions options{rtol, atol, max_order, composite, solver};
        if (!slow.is_none())
          options.slow = [&slow](double now, long steps) {
            const Locked lock;
            call(slow, now, steps);
          };
        std::vector<Parameter> by;
        for (const PyParameter& p : parameters) {
          by.push_back({p.scale, p.forces_only, {}});
          for (const PyNeighbour& n : p.neighbours) by.back().neighbours.push_back({n.weight, n.offset, n.of->problem});
        }
        return run(alive, [&](const Alive& look) { return simulate_ida(of.problem, t, options, look, by); });
      },
      py::arg("problem"), py::arg("t"), py::kw_only(), py::arg("rtol"), py::arg("atol"), py::arg("max_order"),
      py::arg("linear_solver"), py::arg("slow"), py::arg("composite"), py::arg("alive"), py::arg("parameters"));

  m.def(
      "simulate_fixed",
      [](const PyProblem& of, const Eigen::VectorXd& t, const std::string& integrator, double step, double rtol,
         double spectral_radius, int stages, bool composite, const py::object& alive, Tape* tape) {
        const std::unique_ptr<Step> method =
            make_step(integrator, *of.problem.arm, step, rtol, spectral_radius, stages);
        if (tape) *tape = Tape(method->stages());
        return run(alive, [&](const Alive& look) {
          return simulate_fixed(of.problem, t, *method, step, composite, look, tape);
        });
      },
      py::arg("problem"), py::arg("t"), py::kw_only(), py::arg("integrator"), py::arg("step"), py::arg("rtol"),
      py::arg("spectral_radius"), py::arg("stages"), py::arg("composite"), py::arg("alive"), py::arg("tape") = nullptr);
}
