#include "flexarm/check.hpp"
#include "interpreter.hpp"
#include "laws.hpp"

using namespace flexarm;

namespace {

/// (rate, reference, kp, kv, limit) of each freedom of a joint.
using Axes = std::vector<std::tuple<int, py::object, double, double, double>>;

void check(Status status, double t) {
  const std::string where = "computed torque at t = " + std::to_string(t);
  if (status == Status::not_converged)
    bad_value(where, "no static balance", "the elastic coordinates find none there; take elastic=\"zero\"");
  if (status != Status::ok) bad_value(where, "nan or inf", "q, v and the reference must be finite");
}

}  // namespace

Eigen::VectorXd ComputedLaw::operator()(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  check(of(t, q, v), t);
  Eigen::VectorXd out = Eigen::VectorXd::Zero(size);
  out.head(of.tau.size()) = of.tau;
  return out;
}

void bind_laws(py::module_& m) {
  py::class_<ComputedLaw>(m, "ComputedTorque")
      .def(py::init([](const Arm& arm, const Axes& axes, bool sags, Eigen::Index size) {
             std::vector<ComputedTorque::Axis> all;
             AllAsked asked;
             for (const auto& [rate, law, kp, kv, limit] : axes)
               all.push_back(
                   {rate, make_drive(rate, true, law, {}, Eigen::Vector2d(0.0, 1.0), asked).motion, kp, kv, limit});
             return ComputedLaw{ComputedTorque(arm, std::move(all), sags), std::max<Eigen::Index>(size, arm.nv())};
           }),
           py::arg("arm"), py::arg("axes"), py::arg("sags"), py::arg("size") = 0, py::keep_alive<1, 2>())
      .def(
          "__call__",
          [](ComputedLaw& law, double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const py::object&) {
            const Arm& arm = law.of.arm();
            if (q.size() < arm.nq() || v.size() < arm.nv())
              bad_value("lengths of q and v", std::min(q.size(), v.size()), "must be the arm's");
            return law(t, q, v);
          },
          py::arg("t"), py::arg("q"), py::arg("v"), py::arg("a") = py::none())
      .def(
          "feed_forward",
          [](ComputedLaw& law, const Eigen::VectorXd& t, bool inertia) {
            Rows out(t.size(), law.of.tau.size());
            for (Eigen::Index k = 0; k < t.size(); ++k) {
              check(law.of.feed_forward(t[k], inertia), t[k]);
              out.row(k) = law.of.tau;
            }
            return out;
          },
          py::arg("t"), py::arg("inertia"))
      .def(
          "at_rest",
          [](ComputedLaw& law, const Eigen::VectorXd& t) {
            Rows out(t.size(), law.of.q().size());
            for (Eigen::Index k = 0; k < t.size(); ++k) {
              check(law.of.feed_forward(t[k], false), t[k]);
              out.row(k) = law.of.q();
            }
            return out;
          },
          py::arg("t"));
}
