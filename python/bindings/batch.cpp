#include "flexarm/batch.hpp"

#include "flexarm/check.hpp"
#include "interpreter.hpp"

using namespace flexarm;

namespace {

/// (B or 1, times or 1, n)
using Table = py::array_t<double, py::array::c_style>;

BatchTable make_table(const char* name, const Table& x, py::ssize_t scenarios, py::ssize_t times, py::ssize_t n) {
  const auto good = [](py::ssize_t have, py::ssize_t want) { return have == 1 || have == want; };
  if (x.ndim() != 3 || !good(x.shape(0), scenarios) || !good(x.shape(1), times) || x.shape(2) != n)
    bad_value(name, "an array of another shape",
              "must be (" + std::to_string(scenarios) + " or 1, " + std::to_string(times) + " or 1, " +
                  std::to_string(n) + ")");
  return {x.data(), x.shape(0) == 1 ? 0 : x.shape(1) * n, x.shape(1) == 1 ? 0 : n};
}

template <class T>
T* block(py::dict& out, const char* name, py::ssize_t size) {
  if (!out.contains(name)) return nullptr;
  auto x = out[name].cast<py::array>();
  if (!py::isinstance<py::array_t<T, py::array::c_style>>(x) || !x.writeable() || x.size() != size)
    bad_value(name, "an array of another kind", "must be writeable, contiguous, of " + std::to_string(size));
  return static_cast<T*>(x.mutable_data());
}

/// (coordinate, values), (column, values), (places, wrenches), and (column, by_q, by_v, reference, limit)
using Motions = std::vector<std::pair<int, Table>>;
using Forces = std::vector<std::pair<Table, Table>>;
using Loads = std::vector<std::pair<std::vector<Load>, Table>>;
using LawTables = std::vector<std::tuple<Table, Table, Table, Table, Table>>;

void add_drives(BatchProblem& p, const Motions& motions, const Forces& forces, const Loads& loads,
                const LawTables& laws) {
  const Arm& arm = *p.arms[0];
  const py::ssize_t b = p.scenarios, halves = 2 * static_cast<py::ssize_t>(p.lengths.size()) + 1;
  for (const auto& [coordinate, value] : motions) {
    if (coordinate < 0 || coordinate >= arm.nv() || arm.coordinate_of(coordinate) < 0)
      bad_value("motion of coordinate", coordinate, "must be a joint's, and none of a ball");
    p.motions.push_back({coordinate, make_table("motion", value, b, halves, 3)});
  }
  for (const auto& [column, value] : forces)
    p.forces.push_back({make_table("column", column, b, 1, arm.nv()), make_table("force", value, b, halves, 1)});
  for (const auto& [places, wrench] : loads) p.loads.push_back({places, make_table("load", wrench, b, halves, 6)});
  for (const auto& [column, by_q, by_v, reference, limit] : laws)
    p.feedback.push_back({make_table("column", column, b, 1, arm.nv()), make_table("by_q", by_q, b, 1, arm.nq()),
                          make_table("by_v", by_v, b, 1, arm.nv()), make_table("reference", reference, b, halves, 1),
                          make_table("limit", limit, b, 1, 1)});
}

py::dict batch(const std::vector<const Arm*>& arms, py::ssize_t scenarios, const std::vector<double>& lengths,
               const std::vector<double>& times, const std::vector<Eigen::Index>& hold,
               const std::vector<Eigen::Index>& rows, const Table& q0, const Table& v0, const Table& tau,
               const Motions& motions, const Forces& forces, const Loads& loads, const LawTables& laws,
               const std::string& integrator, double spectral_radius, double rtol, bool lanes, py::ssize_t whole,
               py::dict& out, int workers, const py::object& alive) {
  if (arms.empty()) bad_value("arms", "[]", "must be one, or one for each scenario");
  BatchProblem p{arms, scenarios, lengths, times, hold, rows, {}, {}, {}};
  const int nq = arms[0]->nq(), nv = arms[0]->nv();
  p.q0 = make_table("q0", q0, scenarios, 1, nq);
  p.v0 = make_table("v0", v0, scenarios, 1, nv);
  p.tau = make_table("tau", tau, scenarios, tau.shape(1), nv);
  for (Eigen::Index row : hold)
    if (row < 0 || (row >= tau.shape(1) && tau.shape(1) != 1)) bad_value("hold", row, "is no row of tau");
  add_drives(p, motions, forces, loads, laws);
  p.integrator = integrator;
  p.spectral_radius = spectral_radius;
  p.rtol = rtol;
  p.lanes = lanes;
  p.whole = whole;
  const py::ssize_t all = scenarios * static_cast<py::ssize_t>(rows.size());
  BatchOutput o;
  o.q = block<double>(out, "q", all * nq);
  o.v = block<double>(out, "v", all * nv);
  o.a = block<double>(out, "a", all * nv);
  o.tau = block<double>(out, "tau", all * nv);
  o.status = block<int>(out, "status", scenarios);
  o.reached = block<double>(out, "reached", scenarios);
  Lookout lookout(alive);
  const auto look_around = [&lookout](double share) { return lookout(share); };
  BatchStats s;
  {
    const Unlocked free;
    s = run_batch(p, o, workers, look_around);
  }
  py::dict stats;
  stats["steps"] = s.steps;
  stats["evaluations"] = s.evaluations;
  stats["factorisations"] = s.factorisations;
  stats["newton_iterations"] = s.iterations;
  stats["workers"] = s.workers;
  stats["lanes"] = s.lanes;
  stats["interrupted"] = s.interrupted;
  return stats;
}

}  // namespace

void bind_batch(py::module_& m) {
  m.def("batch", &batch, py::arg("arms"), py::arg("scenarios"), py::arg("lengths"), py::arg("times"), py::arg("hold"),
        py::arg("rows"), py::arg("q0"), py::arg("v0"), py::arg("tau"), py::arg("motions"), py::arg("forces"),
        py::arg("loads"), py::arg("laws"), py::arg("integrator"), py::arg("spectral_radius"), py::arg("rtol"),
        py::arg("lanes"), py::arg("whole"), py::arg("out"), py::arg("workers"), py::arg("alive"));
}
