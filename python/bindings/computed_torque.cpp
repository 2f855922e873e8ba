#include "flexarm/check.hpp"
#include "interpreter.hpp"
#include "laws.hpp"

using namespace flexarm;

namespace {

/// (rate, reference, kp, kv, limit) of each freedom of a joint.
using Axes = std::vector<std::tuple<int, py::object, double, double, double>>;
/// Of the arm that is moved, (coordinate, rate) of each.
using Moved = std::vector<std::pair<int, int>>;

void check(Status status, double t) {
  const std::string where = "computed torque at t = " + std::to_string(t);
  if (status == Status::not_converged)
    bad_value(where, "no static balance", "the elastic coordinates find none there; take elastic=\"zero\"");
  if (status != Status::ok) bad_value(where, "nan or inf", "q, v and the reference must be finite");
}

}  // namespace

Eigen::VectorXd ComputedLaw::operator()(double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  Eigen::VectorXd own_q = of.arm().zero(), own_v = Eigen::VectorXd::Zero(of.arm().nv());
  for (const Axis& x : axes) {
    own_q[x.own_q] = q[x.q];
    own_v[x.own_v] = v[x.v];
  }
  check(of(t, own_q, own_v), t);
  Eigen::VectorXd out = Eigen::VectorXd::Zero(size);
  for (const Axis& x : axes) out[x.v] = of.tau[x.own_v];
  return out;
}

void bind_laws(py::module_& m) {
  py::class_<ComputedLaw>(m, "ComputedTorque")
      .def(py::init([](const Arm& arm, const Axes& axes, bool sags, const Moved& moved, Eigen::Index size) {
             std::vector<ComputedTorque::Axis> all;
             std::vector<ComputedLaw::Axis> at;
             AllAsked asked;
             for (const auto& [rate, law, kp, kv, limit] : axes)
               all.push_back(
                   {rate, make_drive({rate, true, law, {}}, Eigen::Vector2d(0.0, 1.0), asked).motion, kp, kv, limit});
             ComputedTorque of(arm, all, sags);
             for (std::size_t k = 0; k < all.size(); ++k) {
               const int v = all[k].rate, q = arm.coordinate_of(v);
               at.push_back(moved.empty() ? ComputedLaw::Axis{q, v, q, v}
                                          : ComputedLaw::Axis{moved.at(k).first, moved.at(k).second, q, v});
               size = std::max<Eigen::Index>(size, at.back().v + 1);
             }
             return ComputedLaw{std::move(of), std::move(at), size};
           }),
           py::arg("arm"), py::arg("axes"), py::arg("sags"), py::arg("moved"), py::arg("size"), py::keep_alive<1, 2>())
      .def(
          "__call__",
          [](ComputedLaw& law, double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const py::object&) {
            for (const auto& x : law.axes)
              if (x.q < 0 || x.q >= q.size() || x.v < 0 || x.v >= v.size())
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
