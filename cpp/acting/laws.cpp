#include "flexarm/laws.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <unsupported/Eigen/MatrixFunctions>

#include "flexarm/check.hpp"
#include "flexarm/drive.hpp"

namespace flexarm {

namespace {

double finite_number(const std::string& field, double value) {
  if (!std::isfinite(value)) bad_value(field, value, "must be finite");
  return value;
}

double limit_of(double limit) {
  if (!(limit > 0.0)) bad_value("limit", limit, "must be positive");
  return limit;
}

std::string number(double x) {
  std::ostringstream text;
  text << x;
  return text.str();
}

Eigen::MatrixXd one(double x) { return Eigen::MatrixXd::Constant(1, 1, x); }

/// The coordinate of rate i.
int coordinate(const Arm& arm, int i) {
  if (i < 0 || i >= arm.nv()) bad_value("rate", i, "must be 0 to " + std::to_string(arm.nv() - 1));
  if (arm.coordinate_of(i) < 0) bad_value("rate", i, "is a ball's, which has no angle of its own");
  return arm.coordinate_of(i);
}

/// The limit of u, and that of the motors at the joints of its column.
void limit_law(const Arm& arm, double limit, LinearLaw& law) {
  law.reach = law.limit = one(limit_of(limit));
  for (const AppliedLimit& l : torque_limits(arm))
    if (const double force = law.columns(l.rate, 0); force != 0.0)
      law.reach[0] = std::min(law.reach[0], l.most / std::abs(force));
}

LinearLaw law_of(const Arm& arm, const StateSpace& s, const FeedbackPath& path, double limit,
                 const std::function<double(double)>& reference) {
  if (path.by_q.size() != arm.nq())
    bad_value("by_q", path.by_q.size(), "numbers; must be nq, " + std::to_string(arm.nq()));
  if (path.column.size() != arm.nv())
    bad_value("column", path.column.size(), "numbers; must be nv, " + std::to_string(arm.nv()));
  if (!path.by_q.allFinite()) bad_value("by_q", path.by_q.transpose(), "must be finite");
  if (!path.column.allFinite()) bad_value("column", path.column.transpose(), "must be finite");
  LinearLaw law{s.A, s.B, s.C, s.D, path.column, path.by_q.transpose(), Eigen::MatrixXd::Zero(1, arm.nv()), {}, {}, {}};
  limit_law(arm, limit, law);
  const auto* numbers = reference.target<PolynomialValue>();
  if (reference && !numbers)
    law.reference = [reference](double t, Eigen::VectorXd& r) { r.setConstant(1, reference(t)); };
  else
    law.reference = PolynomialValues{{numbers ? numbers->of : PiecewisePolynomial::constant(0.0)}};
  law.windup = s.windup;
  return law;
}

}  // namespace

StateSpace sampled_law(const StateSpace& of, double period, Discretisation by) {
  const Eigen::Index n = of.A.rows(), nu = of.C.rows(), ny = of.B.cols();
  if (of.A.cols() != n || of.B.rows() != n || of.C.cols() != n || of.D.rows() != nu || of.D.cols() != ny ||
      of.windup.rows() != n || of.windup.cols() != nu)
    bad_value("A", n, "rows; B, C, D or windup do not fit");
  const double h = positive("period", period);
  const Eigen::MatrixXd unit = Eigen::MatrixXd::Identity(n, n);
  if (by == Discretisation::zero_order_hold) {
    Eigen::MatrixXd all = Eigen::MatrixXd::Zero(n + ny + nu, n + ny + nu);
    all.topRows(n) << h * of.A, h * of.B, h * of.windup;
    const Eigen::MatrixXd e = all.exp().topRows(n);
    if (!e.allFinite()) bad_value("period", h, "is so long that exp(A period) is not finite");
    return {e.leftCols(n), e.middleCols(n, ny), of.C, of.D, e.rightCols(nu)};
  }
  const Eigen::MatrixXd inverse = (unit - 0.5 * h * of.A).partialPivLu().solve(unit);
  if (!inverse.allFinite()) bad_value("period", h, "a pole of A is at 2 / period, which Tustin's rule cannot take");
  const Eigen::MatrixXd B = inverse * (h * of.B);
  return {inverse * (unit + 0.5 * h * of.A), B, of.C * inverse, of.D + 0.5 * of.C * B, inverse * (h * of.windup)};
}

StateSpace continuous_law(const PidGains& g, std::optional<double> period) {
  const double kp = finite_number("kp", g.kp), ki = finite_number("ki", g.ki), kd = finite_number("kd", g.kd);
  if (period) positive("period", *period);
  if (!g.filter_time && !period)
    throw std::invalid_argument(
        "filter_time = None: a continuous PID needs the time constant of its derivative's low pass");
  const double tf = positive("filter_time", g.filter_time ? *g.filter_time : 2.0 * *period);
  StateSpace s;  // states: integral of e; low-passed e
  s.A = Eigen::Vector2d(0.0, -1.0 / tf).asDiagonal();
  s.B = Eigen::Vector2d(1.0, 1.0 / tf);
  s.C = Eigen::RowVector2d(ki, -kd / tf);
  s.D = one(kp + kd / tf);
  s.windup = Eigen::Vector2d::Zero();
  if (g.tracking_time) {
    const double time = positive("tracking_time", *g.tracking_time);
    if (period && time < *period)
      bad_value("tracking_time", time, "must be at least a sample, " + number(*period) + " s");
    if (ki == 0.0) throw std::invalid_argument("tracking_time: there is no integral to lead back; ki is zero");
    s.windup(0, 0) = 1.0 / (ki * time);
  }
  return s;
}

std::pair<StateSpace, Eigen::MatrixXd> servo_law(const ServoGains& g, double period) {
  const double kp = finite_number("kp", g.kp), kv = finite_number("kv", g.kv), ki = finite_number("ki", g.ki);
  const double h = positive("period", period);
  StateSpace f{Eigen::MatrixXd::Zero(0, 0), Eigen::MatrixXd::Zero(0, 1), Eigen::MatrixXd::Zero(1, 0), one(1.0),
               Eigen::MatrixXd::Zero(0, 1)};
  if (g.filter) {
    const double w = 4.0 * std::acos(0.0) * positive("filter", *g.filter);
    f = {one(-w), one(w), one(1.0), one(0.0), one(0.0)};
    if (g.damping_ratio) {
      const double zeta = positive("damping_ratio", *g.damping_ratio);
      f.A = (Eigen::Matrix2d() << 0.0, w, -w, -2.0 * zeta * w).finished();
      f.B = Eigen::Vector2d(0.0, w);
      f.C = Eigen::RowVector2d(1.0, 0.0);
      f.windup = Eigen::Vector2d::Zero();
    }
    f = sampled_law(f, h, Discretisation::zero_order_hold);  // the mean rate of a sample is held in it
    f.D = f.C * f.B;
    f.C = f.C * f.A;
  }
  const Eigen::Index n = f.A.rows();  // states: integral; -y, a sample ago; the filter's
  StateSpace s;
  s.A = Eigen::MatrixXd::Zero(2 + n, 2 + n);
  s.B = Eigen::MatrixXd::Zero(2 + n, 4);
  s.C = Eigen::MatrixXd::Zero(1, 2 + n);
  s.D = Eigen::RowVector4d(kp + ki * h, kv * f.D(0, 0) / h, kv, 1.0);
  s.windup = Eigen::VectorXd::Zero(2 + n);
  s.A(0, 0) = s.B(1, 1) = 1.0;
  s.B(0, 0) = h;
  s.C(0, 0) = ki;
  s.A.block(2, 1, n, 1) = -f.B / h;
  s.B.block(2, 1, n, 1) = f.B / h;
  s.A.block(2, 2, n, n) = f.A;
  s.C(0, 1) = -kv * f.D(0, 0) / h;
  s.C.block(0, 2, 1, n) = kv * f.C;
  if (g.tracking_time && positive("tracking_time", *g.tracking_time) < h)
    bad_value("tracking_time", *g.tracking_time, "must be at least a sample, " + number(h) + " s");
  if (ki != 0.0) {
    const double rule = kv / ki > 0.0 ? std::sqrt(kv / ki) : kp / ki;
    s.windup(0, 0) = h / (ki * (g.tracking_time ? *g.tracking_time : std::max(rule, h)));
  }
  Eigen::MatrixXd start = Eigen::MatrixXd::Zero(2 + n, 4);
  start(1, 1) = 1.0;
  return {s, start};
}

StateSpace continuous_law(const PositivePositionGains& g, std::optional<double> period) {
  double w = positive("frequency", g.frequency);
  const double zeta = positive("damping_ratio", g.damping_ratio), gain = finite_number("gain", g.gain);
  if (period) {
    const double half = 0.5 * w * positive("period", *period), right = std::acos(0.0);
    if (half >= right)
      bad_value("period", *period, "must be below " + number(2.0 * right / w) + " s, half that of the filter");
    w *= std::tan(half) / half;  // Tustin's rule maps it to the given frequency
  }
  StateSpace s;
  s.A = (Eigen::Matrix2d() << 0.0, 1.0, -w * w, -2.0 * zeta * w).finished();
  s.B = Eigen::Vector2d(0.0, -w * w);
  s.C = Eigen::RowVector2d(gain, 0.0);
  s.D = one(0.0);
  s.windup = Eigen::Vector2d::Zero();
  return s;
}

StateSpace continuous_law(const IntegralResonantGains& g) {
  const double k = finite_number("gain", g.gain), d = finite_number("feedthrough", g.feedthrough);
  if (!(k * d > 0.0))
    bad_value("gain = " + number(k) + ", feedthrough", d, "must have one sign, or the law is unstable alone");
  return {one(-k * d), one(-k), one(1.0), one(0.0), one(0.0)};
}

Feedback pd(const Arm& arm, int i, double kp, double kd, const std::function<double(double)>& reference, double limit) {
  const int q = coordinate(arm, i);
  Feedback law{Eigen::VectorXd::Unit(arm.nv(), i), finite_number("kp", kp) * Eigen::VectorXd::Unit(arm.nq(), q),
               finite_number("kd", kd) * Eigen::VectorXd::Unit(arm.nv(), i)};
  if (const auto* p = reference.target<PolynomialValue>())
    law.reference = PolynomialValue{{p->of.breaks(), kp * p->of.coefficients()}};
  else if (reference)
    law.reference = [kp, reference](double t) { return kp * reference(t); };
  law.limit = limit_of(limit);
  return law;
}

LinearLaw pid(const Arm& arm, int i, const PidGains& gains, double period,
              const std::function<double(double)>& reference) {
  const int q = coordinate(arm, i);
  return law_of(arm, sampled_law(continuous_law(gains, period), period),
                {Eigen::VectorXd::Unit(arm.nq(), q), Eigen::VectorXd::Unit(arm.nv(), i)}, gains.limit, reference);
}

LinearLaw servo(const Arm& arm, int i, const ServoGains& gains, double period, const Commands& commands, double first) {
  const int q = coordinate(arm, i);
  non_negative("resolution", gains.resolution);
  const auto [s, start] = servo_law(gains, period);
  Eigen::MatrixXd by_q = Eigen::MatrixXd::Zero(4, arm.nq());
  by_q(0, q) = by_q(1, q) = 1.0;
  LinearLaw law{s.A, s.B, s.C, s.D, Eigen::VectorXd::Unit(arm.nv(), i), by_q, Eigen::MatrixXd::Zero(4, arm.nv()),
                {},  {},  {}};
  limit_law(arm, gains.limit, law);
  law.windup = s.windup;
  law.start = start;
  law.first = first;
  law.resolution = Eigen::Vector4d(gains.resolution, gains.resolution, 0.0, 0.0);
  const std::array<std::function<double(double)>, 4> given{commands.position, {}, commands.rate, commands.force};
  PolynomialValues numbers;
  for (const auto& f : given)
    if (const auto* p = f.target<PolynomialValue>(); p || !f)
      numbers.of.push_back(p ? p->of : PiecewisePolynomial::constant(0.0));
  if (numbers.of.size() == given.size())
    law.reference = numbers;
  else
    law.reference = [given](double t, Eigen::VectorXd& r) {
      r.setZero(4);
      for (std::size_t k = 0; k < given.size(); ++k)
        if (given[k]) r[static_cast<Eigen::Index>(k)] = given[k](t);
    };
  return law;
}

LinearLaw positive_position(const Arm& arm, const FeedbackPath& path, const PositivePositionGains& gains,
                            double period) {
  return law_of(arm, sampled_law(continuous_law(gains, period), period), path, gains.limit,
                PolynomialValue{PiecewisePolynomial::constant(finite_number("reference", gains.reference))});
}

LinearLaw integral_resonant(const Arm& arm, const FeedbackPath& path, const IntegralResonantGains& gains,
                            double period) {
  return law_of(arm, sampled_law(continuous_law(gains), period), path, gains.limit,
                PolynomialValue{PiecewisePolynomial::constant(finite_number("reference", gains.reference))});
}

}  // namespace flexarm
