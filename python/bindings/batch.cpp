#include "flexarm/batch.hpp"

#include <algorithm>

#include "flexarm/check.hpp"
#include "laws.hpp"

using namespace flexarm;

namespace {

/// (B or 1, times or 1, n)
using Table = py::array_t<double, py::array::c_style>;

/// A batch from Python, with the objects that must outlive it.
struct PyBatch {
  BatchProblem problem;
  py::list kept;
};

BatchTable make_table(const char* name, const std::optional<Table>& x, py::ssize_t scenarios, py::ssize_t times,
                      py::ssize_t n, py::list& kept) {
  if (!x) return {};
  const auto good = [](py::ssize_t have, py::ssize_t want) { return have == 1 || have == want; };
  if (x->ndim() != 3 || !good(x->shape(0), scenarios) || !good(x->shape(1), times) || x->shape(2) != n)
    bad_value(name, "an array of another shape",
              "must be (" + std::to_string(scenarios) + " or 1, " + std::to_string(times) + " or 1, " +
                  std::to_string(n) + ")");
  kept.append(*x);
  return {x->data(), x->shape(0) == 1 ? 0 : x->shape(1) * n, x->shape(1) == 1 ? 0 : n};
}

template <class T>
T* block(py::dict& out, const char* name, py::ssize_t size) {
  if (!out.contains(name)) return nullptr;
  auto x = out[name].cast<py::array>();
  if (!py::isinstance<py::array_t<T, py::array::c_style>>(x) || !x.writeable() || x.size() != size)
    bad_value(name, "an array of another kind", "must be writeable, contiguous, of " + std::to_string(size));
  return static_cast<T*>(x.mutable_data());
}

PyBatch make_batch(const std::vector<std::shared_ptr<PyProblem>>& problems, const std::vector<const PyArm*>& arms,
                   py::ssize_t scenarios, const Eigen::VectorXd& t, py::ssize_t every, const std::optional<Table>& q0,
                   const std::optional<Table>& v0, const std::optional<Table>& tau, int nq, int nv,
                   const PyIntegrator& integrator, const py::object& slow, bool lanes, py::ssize_t whole) {
  if (problems.empty()) bad_value("problems", "[]", "must be one, or one for each scenario");
  PyBatch out;
  BatchProblem& p = out.problem;
  for (const auto& one : problems) p.problems.emplace_back(one, &one->problem);
  if (arms.size() > 1) {
    const Problem one = *p.problems[0];
    const bool patched =
        std::any_of(one.drives.begin(), one.drives.end(), [](const Drive& d) { return d.column.size() > 0; });
    if (problems.size() > 1 || patched || !one.loads.empty() || !one.feedback.empty() || !one.samplers.empty())
      bad_value("arms", arms.size(), "are for one problem without loads, voltages and controllers");
    p.problems.clear();
    for (const PyArm* arm : arms) {
      auto other = std::make_shared<Problem>(one);
      other->arm = std::shared_ptr<const Arm>(std::shared_ptr<void>(), arm);
      p.problems.push_back(std::move(other));
    }
  }
  p.scenarios = scenarios;
  p.t = t;
  p.step = integrator.step;
  p.every = every;
  p.nq = nq;
  p.nv = nv;
  p.q0 = make_table("q0", q0, scenarios, 1, nq, out.kept);
  p.v0 = make_table("v0", v0, scenarios, 1, nv, out.kept);
  p.tau = make_table("tau", tau, scenarios, tau ? std::max<py::ssize_t>(tau->shape(1), t.size() - 1) : 1, nv, out.kept);
  p.method = integrator.method;
  if (p.method.name == "ida") {
    out.kept.append(slow);
    p.integrate = [options = integrator.ida, slow = slow.ptr()](Eigen::Index scenario, const Problem& of,
                                                                const Eigen::VectorXd& times, const Alive& alive) {
      IdaOptions own = options;
      if (slow != Py_None)
        own.slow = [&](double now, long steps) {
          const Locked lock;
          call(py::reinterpret_borrow<py::object>(slow), scenario, now, steps);
        };
      return simulate_ida(of, times, own, alive);
    };
  }
  p.lanes = lanes;
  p.whole = whole;
  return out;
}

/// The exception of a scenario's function; a ValueError names the scenario.
[[noreturn]] void tell_whose(const ScenarioError& e) {
  std::string words;
  try {
    std::rethrow_if_nested(e);
  } catch (const std::invalid_argument& x) {
    words = x.what();
  } catch (py::error_already_set& x) {
    if (!x.matches(PyExc_ValueError)) throw;
    words = py::str(x.value());
  }
  throw std::invalid_argument(std::string(e.what()) + ": " + words);
}

py::dict run(const PyBatch& of, py::dict& out, int workers, const py::object& alive) {
  const BatchProblem& p = of.problem;
  const py::ssize_t all = p.scenarios * p.rows();
  BatchOutput o;
  o.q = block<double>(out, "q", all * p.nq);
  o.v = block<double>(out, "v", all * p.nv);
  o.a = block<double>(out, "a", all * p.nv);
  o.tau = block<double>(out, "tau", all * p.nv);
  o.contacts = block<double>(out, "contacts", all * p.row_contacts());
  o.loops = block<double>(out, "loops", all * p.row_loops());
  o.status = block<int>(out, "status", p.scenarios);
  o.reached = block<double>(out, "reached", p.scenarios);
  std::vector<std::vector<EventLog>> events(out.contains("events") ? static_cast<std::size_t>(p.scenarios) : 0);
  if (!events.empty()) o.events = events.data();
  std::vector<std::string> failure(static_cast<std::size_t>(p.scenarios));
  std::vector<SimulationStats> counts(failure.size());
  o.failure = failure.data();
  o.stats = counts.data();
  Lookout lookout(alive);
  const auto look_around = [&lookout](double share) { return lookout(share); };
  BatchStats s;
  try {
    const Unlocked free;
    s = run_batch(p, o, workers, look_around);
  } catch (const ScenarioError& e) {
    tell_whose(e);
  }
  for (std::size_t b = 0; b < events.size(); ++b)
    if (o.status[b] != static_cast<int>(BatchStatus::not_done))
      out["events"][py::int_(b)] = event_rows(events[b], p.nq, p.nv);
  py::dict apart, counted;
  const bool in_kernels = p.in_kernels();  // which looks at every problem
  for (std::size_t b = 0; b < counts.size(); ++b) {
    const SimulationStats& x = counts[b];
    if (!in_kernels) apart[py::int_(b)] = failure[b];
    if (in_kernels && x.failed_steps == 0) continue;
    counted[py::int_(b)] =
        py::dict(py::arg("steps") = x.steps, py::arg("failed_steps") = x.failed_steps, py::arg("doubt") = x.doubt,
                 py::arg("switches") = x.switches, py::arg("hasty") = x.hasty);
  }
  py::dict stats;
  stats["steps"] = s.steps;
  stats["evaluations"] = s.evaluations;
  stats["factorisations"] = s.factorisations;
  stats["newton_iterations"] = s.iterations;
  stats["workers"] = s.workers;
  stats["lanes"] = s.lanes;
  stats["interrupted"] = s.interrupted;
  stats["apart"] = apart;
  stats["counted"] = counted;
  return stats;
}

}  // namespace

void bind_batch(py::module_& m) {
  m.def("in_kernels", &in_kernels, py::arg("method"), py::arg("arm"));
  py::class_<PyBatch>(m, "BatchProblem")
      .def(py::init(&make_batch), py::keep_alive<1, 2>(), py::keep_alive<1, 3>(), py::arg("problems"), py::arg("arms"),
           py::kw_only(), py::arg("scenarios"), py::arg("t"), py::arg("every"), py::arg("q0"), py::arg("v0"),
           py::arg("tau"), py::arg("nq"), py::arg("nv"), py::arg("integrator"), py::arg("slow"), py::arg("lanes"),
           py::arg("whole"))
      .def("run", &run, py::arg("out"), py::arg("workers"), py::arg("alive"));
}
