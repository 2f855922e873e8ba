#include "flexarm/kalman.hpp"

#include "evaluation.hpp"
#include "laws.hpp"

using namespace flexarm;

namespace {

/// by_q, by_v, offset, noise, (link, x) of a place or None, along, F, before, after
using Row = std::tuple<Eigen::VectorXd, Eigen::VectorXd, double, double,
                       std::optional<std::pair<std::size_t, std::optional<double>>>, Eigen::Vector3d, Eigen::MatrixXd,
                       Eigen::VectorXd, Eigen::VectorXd>;
/// kind, rate, start, deviation, drift
using Unknown = std::tuple<int, int, double, double, double>;

std::unique_ptr<KalmanFilter> make_kalman(const PyProblem& of, double step, const std::vector<Row>& rows,
                                          const std::vector<Unknown>& unknowns, const Eigen::VectorXd& force_noise,
                                          double friction_speed) {
  std::vector<KalmanSensor> sensors;
  for (const auto& [by_q, by_v, offset, noise, place, along, F, before, after] : rows) {
    sensors.push_back({by_q, by_v, offset, noise, {}, along, F, before, after});
    if (place) sensors.back().at.emplace(*of.problem.arm, place->first, place->second);
  }
  std::vector<KalmanParameter> parameters;
  for (const auto& [kind, rate, start, deviation, drift] : unknowns)
    parameters.push_back({static_cast<KalmanParameter::Kind>(kind), rate, start, deviation, drift});
  KalmanOptions options;
  options.friction_speed = friction_speed;
  return std::make_unique<KalmanFilter>(of.problem, step, sensors, parameters, force_noise, options);
}

Eigen::VectorXd deviations(const KalmanFilter& f) { return f.root().rowwise().norm(); }

/// Over rows: readings at each time, forces from it to the next. `progress` is given the share of them that is done.
py::dict run_filter(KalmanFilter& f, const Rows& tau, const Rows& y, int links, const py::object& progress) {
  const Eigen::Index n = tau.rows(), nv = f.v().size(), m = f.parameters().size(), k = y.cols();
  Rows q(n, f.q().size()), v(n, nv), p(n, m), std(n, f.states()), innovations(n, k), expected(n, k), tip(n, 3),
      tip_std(n, 3);
  Eigen::VectorXd nis(n);
  Eigen::VectorXi used(n);
  Eigen::Index done = 0;
  Status status = Status::ok;
  {
    Lookout look(progress);
    const Unlocked free;
    const PlacedSlice end(f.arm(), static_cast<std::size_t>(links) - 1);
    Eigen::Vector3d place;
    Eigen::Matrix3d covariance;
    for (; done < n; ++done) {
      if (!look(static_cast<double>(done) / static_cast<double>(n))) throw flexarm::Interrupted();
      if (done > 0) status = f.predict(tau.row(done - 1));
      if (status == Status::ok) status = f.update(y.row(done));
      if (status != Status::ok) break;
      q.row(done) = f.q();
      v.row(done) = f.v();
      p.row(done) = f.parameters();
      std.row(done) = deviations(f);
      innovations.row(done) = f.innovations();
      expected.row(done) = f.innovation_deviations();
      nis[done] = f.nis();
      used[done] = f.used();
      f.place(end, place, covariance);
      tip.row(done) = place;
      tip_std.row(done) = covariance.diagonal().cwiseSqrt();
    }
  }
  py::dict out;
  const auto head = [&](const Rows& x) { return Rows(x.topRows(done)); };
  out["q"] = head(q);
  out["v"] = head(v);
  out["p"] = head(p);
  out["std"] = head(std);
  out["innovations"] = head(innovations);
  out["innovation_std"] = head(expected);
  out["nis"] = Eigen::VectorXd(nis.head(done));
  out["used"] = Eigen::VectorXi(used.head(done));
  out["tip"] = head(tip);
  out["tip_std"] = head(tip_std);
  out["status"] = static_cast<int>(status);
  return out;
}

}  // namespace

void bind_kalman(py::module_& m) {
  py::class_<KalmanFilter>(m, "KalmanFilter")
      .def(py::init(&make_kalman), py::arg("problem"), py::arg("step"), py::arg("sensors"), py::arg("parameters"),
           py::arg("force_noise"), py::arg("friction_speed"), py::keep_alive<1, 2>())
      .def("start", &KalmanFilter::start, py::arg("q"), py::arg("v"), py::arg("q_deviation"), py::arg("v_deviation"),
           py::arg("t"))
      .def(
          "predict", [](KalmanFilter& f, const Eigen::VectorXd& tau) { return static_cast<int>(f.predict(tau)); },
          py::arg("tau"))
      .def(
          "update", [](KalmanFilter& f, const Eigen::VectorXd& y) { return static_cast<int>(f.update(y)); },
          py::arg("y"))
      .def("run", &run_filter, py::arg("tau"), py::arg("y"), py::arg("links"), py::arg("progress"))
      .def(
          "place",
          [](KalmanFilter& f, std::size_t link, std::optional<double> x) {
            Eigen::Vector3d p;
            Eigen::Matrix3d covariance;
            f.place(PlacedSlice(f.arm(), link, x), p, covariance);
            return py::make_tuple(p, covariance);
          },
          py::arg("link"), py::arg("x"))
      .def("transition", [](const KalmanFilter& f) { return Eigen::MatrixXd(f.transition()); })
      .def("state", &KalmanFilter::state)
      .def("resume", &KalmanFilter::resume, py::arg("state"))
      .def_property_readonly("t", &KalmanFilter::t)
      .def_property_readonly("q", [](const KalmanFilter& f) { return Eigen::VectorXd(f.q()); })
      .def_property_readonly("v", [](const KalmanFilter& f) { return Eigen::VectorXd(f.v()); })
      .def_property_readonly("p", [](const KalmanFilter& f) { return Eigen::VectorXd(f.parameters()); })
      .def_property_readonly("root", [](const KalmanFilter& f) { return Eigen::MatrixXd(f.root()); })
      .def_property_readonly("deviations", &deviations)
      .def_property_readonly("innovations", [](const KalmanFilter& f) { return Eigen::VectorXd(f.innovations()); })
      .def_property_readonly("innovation_std",
                             [](const KalmanFilter& f) { return Eigen::VectorXd(f.innovation_deviations()); })
      .def_property_readonly("nis", &KalmanFilter::nis)
      .def_property_readonly("used", &KalmanFilter::used);
}
