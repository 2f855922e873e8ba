#include "bindings.hpp"
#include "flexarm/laws.hpp"

using namespace flexarm;

namespace {

py::tuple matrices(const StateSpace& s) { return py::make_tuple(s.A, s.B, s.C, s.D, s.windup); }

}  // namespace

void bind_linear_laws(py::module_& m) {
  m.def(
      "pid",
      [](double kp, double ki, double kd, std::optional<double> filter_time, std::optional<double> tracking_time,
         std::optional<double> period) {
        return matrices(continuous_law(PidGains{kp, ki, kd, filter_time, tracking_time}, period));
      },
      py::arg("kp"), py::arg("ki"), py::arg("kd"), py::arg("filter_time"), py::arg("tracking_time"), py::arg("period"));
  m.def(
      "servo",
      [](double kp, double kv, double ki, std::optional<double> filter, std::optional<double> damping_ratio,
         std::optional<double> tracking_time, double period) {
        const auto [law, start] = servo_law(ServoGains{kp, kv, ki, 0.0, filter, damping_ratio, tracking_time}, period);
        return py::make_tuple(law.A, law.B, law.C, law.D, law.windup, start);
      },
      py::arg("kp"), py::arg("kv"), py::arg("ki"), py::arg("filter"), py::arg("damping_ratio"),
      py::arg("tracking_time"), py::arg("period"));
  m.def(
      "positive_position",
      [](double frequency, double damping_ratio, double gain, std::optional<double> period) {
        return matrices(continuous_law(PositivePositionGains{frequency, damping_ratio, gain}, period));
      },
      py::arg("frequency"), py::arg("damping_ratio"), py::arg("gain"), py::arg("period"));
  m.def(
      "integral_resonant",
      [](double gain, double feedthrough) {
        return matrices(continuous_law(IntegralResonantGains{gain, feedthrough}));
      },
      py::arg("gain"), py::arg("feedthrough"));
  m.def(
      "sampled",
      [](const Eigen::MatrixXd& A, const Eigen::MatrixXd& B, const Eigen::MatrixXd& C, const Eigen::MatrixXd& D,
         const Eigen::MatrixXd& windup, double period, bool hold) {
        return matrices(
            sampled_law({A, B, C, D, windup}, period, hold ? Discretisation::zero_order_hold : Discretisation::tustin));
      },
      py::arg("A"), py::arg("B"), py::arg("C"), py::arg("D"), py::arg("windup"), py::arg("period"), py::arg("hold"));
}
