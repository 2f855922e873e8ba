// Derivatives of steps, and along tapes.
#include "flexarm/rollout_tape.hpp"
#include "flexarm/run_derivatives.hpp"
#include "flexarm/step_derivatives.hpp"
#include "laws.hpp"

using namespace flexarm;

void bind_gradients(py::module_& m) {
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
        (*lent).limits.clear();  // which are those of steps, not of the arm's dynamics
        return py::make_tuple(end_q.all(), end_v.all(), by_state.all(), by_tau.all(), status);
      },
      py::arg("arm"), py::arg("q"), py::arg("v"), py::arg("tau"), py::arg("integrator"), py::arg("step"),
      py::arg("rtol"), py::arg("spectral_radius"), py::arg("loads"), py::arg("wrenches"));

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
      .def_property_readonly("occurrences",
                             [](const Tape& tape) {
                               py::list out;
                               for (const Tape::Occurrence& o : tape.occurrences)
                                 out.append(py::make_tuple(o.event, o.t, o.before, o.after));
                               return out;
                             })
      .def_property_readonly("points",
                             [](const Tape& tape) {
                               std::vector<Eigen::Index> out;
                               for (const Tape::Row& row : tape.rows) out.push_back(row.point);
                               return out;
                             })
      .def_property_readonly("switches",
                             [](const Tape& tape) {
                               Eigen::VectorXd ends(static_cast<Eigen::Index>(tape.switches.size()));
                               for (Eigen::Index k = 0; k < ends.size(); ++k) {
                                 const Tape::Switch& s = tape.switches[static_cast<std::size_t>(k)];
                                 ends[k] = s.t + s.h;
                               }
                               return ends;
                             })
      .def_property_readonly("sides",
                             [](const Tape& tape) {
                               const auto height = static_cast<py::ssize_t>(tape.points());
                               const auto width = height > 0 ? static_cast<py::ssize_t>(tape.sides.size()) / height : 0;
                               return py::array_t<signed char>({height, width}, tape.sides.data());
                             })
      .def(
          "complete",
          [](Tape& tape, const PyProblem& of) {
            const Unlocked free;
            complete(of.problem, tape);
          },
          py::arg("problem"))
      .def(
          "weigh",
          [](const Tape& tape, const PyProblem& of, const std::vector<Parameter>& parameters, const Rows& needed,
             const Rows& applied, int threads) {
            const Unlocked free;
            return weigh(of.problem, parameters, tape, needed, applied, threads);
          },
          py::arg("problem"), py::arg("parameters"), py::arg("needed"), py::arg("applied"), py::arg("threads"))
      .def(
          "repeat_switches",
          [](const Tape& tape, const PyProblem& of, double rtol, double spectral_radius) {
            Repeated found;
            {
              const Unlocked free;
              found = repeat_switches(of.problem, tape, {spectral_radius, rtol});
            }
            return py::make_tuple(found.ends, found.ways);
          },
          py::arg("problem"), py::arg("rtol"), py::arg("spectral_radius"))
      .def(
          "repeat_looks",
          [](const Tape& tape, const PyProblem& of, const PyProblem& run) {
            const Unlocked free;
            return repeat_looks(of.problem, run.problem, tape);
          },
          py::arg("problem"), py::arg("run"))
      .def(
          "tangents",
          [](const Tape& tape, const PyProblem& of, double rtol, double spectral_radius,
             const std::vector<Rows>& switches, const std::vector<Parameter>& parameters, bool accelerations,
             int threads) {
            std::vector<Trajectory::Tangent> found;
            {
              const Unlocked free;
              found = tangents(of.problem, tape, {spectral_radius, rtol}, switches, parameters, accelerations, threads);
            }
            return tangent_rows(found, static_cast<Eigen::Index>(tape.rows.size()));
          },
          py::arg("problem"), py::arg("rtol"), py::arg("spectral_radius"), py::arg("switches"), py::arg("parameters"),
          py::arg("accelerations"), py::arg("threads"))
      .def(
          "adjoint",
          [](const Tape& tape, const PyProblem& of, double rtol, double spectral_radius, const Rows& q, const Rows& v,
             const Rows& a, const Rows& tau, int threads, bool rough) {
            Adjoint found;
            {
              const Unlocked free;
              found = adjoint(of.problem, tape, {spectral_radius, rtol}, q, v, a, tau, threads, rough);
            }
            return py::make_tuple(found.q0, found.v0, found.needed, found.applied, found.switches, found.held,
                                  found.looks);
          },
          py::arg("problem"), py::arg("rtol"), py::arg("spectral_radius"), py::arg("q"), py::arg("v"), py::arg("a"),
          py::arg("tau"), py::arg("threads"), py::arg("rough") = false);

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
