#include "mpc.hpp"

#include "flexarm/check.hpp"
#include "flexarm/drive.hpp"
#include "laws.hpp"

#ifdef FLEXARM_MPC

using namespace flexarm;

namespace {

/// by_q, (link, x, along) of a place or None, weight, rate_weight, lower, upper, rate_lower, rate_upper
using Output =
    std::tuple<Eigen::VectorXd, std::optional<std::tuple<std::size_t, std::optional<double>, Eigen::Vector3d>>, double,
               double, double, double, double, double>;

/// A piecewise polynomial for each output, constant outside its breaks; or a callable t -> (2, ny).
Mpc::Reference make_reference(const py::object& given, std::size_t count) {
  if (py::isinstance<py::list>(given)) {
    auto parts = given.cast<std::vector<PiecewisePolynomial>>();
    for (PiecewisePolynomial& p : parts) p = p.standing();
    if (parts.size() != count) bad_value("reference", parts.size(), "must be one for each output");
    return [parts](double t, Eigen::VectorXd& value, Eigen::VectorXd& rate) {
      Eigen::Index k = 0;
      for (const PiecewisePolynomial& p : parts) {
        const MotionValue at = p(t);
        value[k] = at.q;
        rate[k++] = at.v;
      }
    };
  }
  return [law = std::make_shared<py::object>(given), count](double t, Eigen::VectorXd& value, Eigen::VectorXd& rate) {
    const Locked lock;
    const auto both = call(*law, t).cast<Rows>();
    if (both.rows() != 2 || both.cols() != static_cast<Eigen::Index>(count) || !both.allFinite())
      bad_value("reference at t", t,
                "gave nan, inf or a wrong shape; must be finite, a number for each that is tracked");
    value = both.row(0);
    rate = both.row(1);
  };
}

std::shared_ptr<MpcLaw> make_mpc(const PyProblem& of, const std::vector<Output>& given, const Eigen::MatrixXd& columns,
                                 const std::vector<Eigen::VectorXd>& of_inputs, double period, double horizon,
                                 int stages, int blocks, double terminal, double soft, bool delayed, int iterations,
                                 int carried, const py::object& reference, const Eigen::MatrixXd& to_q,
                                 const Eigen::MatrixXd& to_v, const Eigen::MatrixXd& forces, const py::object& failed) {
  std::vector<MpcOutput> outputs;
  for (const auto& [by_q, place, weight, rate_weight, lower, upper, rate_lower, rate_upper] : given) {
    MpcOutput o;
    if (place) o = MpcOutput::place(*of.problem.arm, std::get<0>(*place), std::get<1>(*place), std::get<2>(*place));
    if (!place) o.by_q = by_q;
    o.weight = weight;
    o.rate_weight = rate_weight;
    o.lower = lower;
    o.upper = upper;
    o.rate_lower = rate_lower;
    o.rate_upper = rate_upper;
    outputs.push_back(o);
  }
  MpcOptions o;
  o.period = period;
  o.horizon = horizon;
  o.stages = stages;
  o.blocks = blocks;
  o.terminal = terminal;
  o.soft = soft;
  o.delayed = delayed;
  o.iterations = iterations;
  o.carried = carried;
  o.columns = columns;
  o.lower = of_inputs.at(0);
  o.upper = of_inputs.at(1);
  o.rate_limit = of_inputs.at(2);
  o.effort = of_inputs.at(3);
  o.rate_effort = of_inputs.at(4);
  auto law = std::make_shared<MpcLaw>();
  law->mpc = std::make_unique<Mpc>(of.problem, outputs, o, make_reference(reference, outputs.size()));
  law->to_q = to_q;
  law->to_v = to_v;
  law->forces = forces;
  law->failed = std::make_shared<py::object>(failed);
  return law;
}

}  // namespace

Eigen::VectorXd MpcLaw::operator()(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  const Status status = mpc->feedback(t, to_q * q, to_v * v);
  const Eigen::VectorXd out = forces * mpc->u();
  if (status != Status::ok) {
    const Locked lock;
    call(*failed, t, static_cast<int>(status));
  }
  mpc->prepare();
  return out;
}

void bind_mpc(py::module_& m) {
  py::class_<MpcLaw, std::shared_ptr<MpcLaw>>(m, "Mpc")
      .def(py::init(&make_mpc), py::arg("problem"), py::arg("outputs"), py::arg("columns"), py::arg("of_inputs"),
           py::arg("period"), py::arg("horizon"), py::arg("stages"), py::arg("blocks"), py::arg("terminal"),
           py::arg("soft"), py::arg("delayed"), py::arg("iterations"), py::arg("carried"), py::arg("reference"),
           py::arg("to_q"), py::arg("to_v"), py::arg("forces"), py::arg("failed"), py::keep_alive<1, 2>())
      .def(
          "feedback",
          [](MpcLaw& law, double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
            return static_cast<int>(law.mpc->feedback(t, law.to_q * q, law.to_v * v));
          },
          py::arg("t"), py::arg("q"), py::arg("v"))
      .def("prepare", [](MpcLaw& law) { return static_cast<int>(law.mpc->prepare()); })
      .def("reset", [](MpcLaw& law) { law.mpc->reset(); })
      .def_property_readonly("u", [](const MpcLaw& law) { return Eigen::VectorXd(law.mpc->u()); })
      .def_property_readonly("forces", [](const MpcLaw& law) { return Rows(law.forces); })
      .def_property_readonly("plan", [](const MpcLaw& law) { return Rows(law.mpc->plan().transpose()); })
      .def_property_readonly("block_times", [](const MpcLaw& law) { return Eigen::VectorXd(law.mpc->block_times()); })
      .def_property_readonly("predicted", [](const MpcLaw& law) { return Rows(law.mpc->predicted().transpose()); })
      .def_property_readonly("stage_times", [](const MpcLaw& law) { return Eigen::VectorXd(law.mpc->stage_times()); })
      .def_property_readonly("qp_iterations", [](const MpcLaw& law) { return law.mpc->qp_iterations(); });
}

#else

void bind_mpc(py::module_&) {}

#endif
