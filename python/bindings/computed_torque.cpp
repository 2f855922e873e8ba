#include "flexarm/check.hpp"
#include "interpreter.hpp"
#include "laws.hpp"

using namespace flexarm;

namespace {

/// (rate, reference, kp, kv, limit) of each freedom of a joint.
using Axes = std::vector<std::tuple<int, py::object, double, double, double>>;
/// Of the arm that is moved, (coordinate, rate) of each axis.
using Moved = std::vector<std::pair<int, int>>;

}  // namespace

void bind_laws(py::module_& m) {
  py::class_<TorqueLaw>(m, "ComputedTorque")
      .def(py::init([](const Arm& arm, const Axes& axes, bool sags, const Moved& moved, int size) {
             std::vector<ComputedTorque::Axis> all;
             std::vector<TorqueLaw::Place> at;
             AllAsked asked;
             for (const auto& [rate, law, kp, kv, limit] : axes)
               all.push_back(
                   {rate, make_drive({rate, true, law, {}}, Eigen::Vector2d(0.0, 1.0), asked).motion, kp, kv, limit});
             for (std::size_t k = 0; k < all.size(); ++k) {
               const int rate = all[k].rate;
               at.push_back(moved.empty() ? TorqueLaw::Place{arm.coordinate_of(rate), rate}
                                          : TorqueLaw::Place{moved.at(k).first, moved.at(k).second});
             }
             return TorqueLaw(std::shared_ptr<const Arm>(std::shared_ptr<void>(), &arm), all, sags, at, size);
           }),
           py::arg("arm"), py::arg("axes"), py::arg("sags"), py::arg("moved"), py::arg("size"), py::keep_alive<1, 2>())
      .def(
          "__call__",
          [](TorqueLaw& law, double t, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const py::object&) {
            for (const auto& x : law.places)
              if (x.q >= q.size() || x.v >= v.size())
                bad_value("lengths of q and v", std::min(q.size(), v.size()), "must be the arm's");
            Eigen::VectorXd force;
            law(t, q, v, v, force);
            return force;
          },
          py::arg("t"), py::arg("q"), py::arg("v"), py::arg("a") = py::none())
      .def(
          "feed_forward",
          [](TorqueLaw& law, const Eigen::VectorXd& t, bool inertia) {
            Rows out(t.size(), law.of.tau.size());
            for (Eigen::Index k = 0; k < t.size(); ++k) {
              TorqueLaw::check(law.of.feed_forward(t[k], inertia), t[k]);
              out.row(k) = law.of.tau;
            }
            return out;
          },
          py::arg("t"), py::arg("inertia"))
      .def(
          "at_rest",
          [](TorqueLaw& law, const Eigen::VectorXd& t) {
            Rows out(t.size(), law.of.q().size());
            for (Eigen::Index k = 0; k < t.size(); ++k) {
              TorqueLaw::check(law.of.feed_forward(t[k], false), t[k]);
              out.row(k) = law.of.q();
            }
            return out;
          },
          py::arg("t"));
}
