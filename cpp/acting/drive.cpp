#include "flexarm/drive.hpp"

#include <algorithm>

#include "flexarm/check.hpp"

namespace flexarm {

PiecewisePolynomial::PiecewisePolynomial(Eigen::VectorXd breaks, Eigen::MatrixXd coefficients)
    : numbers_(std::make_shared<const std::pair<Eigen::VectorXd, Eigen::MatrixXd>>(std::move(breaks),
                                                                                   std::move(coefficients))) {
  const auto& [t, c] = *numbers_;
  if (t.size() < 2 || c.cols() != t.size() - 1 || c.rows() < 1)
    bad_value("breaks", t.size(), "need one more break than columns of coefficients");
  for (Eigen::Index k = 0; k + 1 < t.size(); ++k)
    if (!(t[k + 1] > t[k])) bad_value("t[" + std::to_string(k + 1) + "]", t[k + 1], "must increase");
  if (!t.allFinite() || !c.allFinite()) bad_value("samples", "nan or inf", "must be finite");
}

MotionValue PiecewisePolynomial::operator()(double t) const {
  const auto& [breaks, coefficients] = *numbers_;
  const double* first = breaks.data();
  const auto k = std::clamp<Eigen::Index>(std::upper_bound(first, first + breaks.size(), t) - first - 1, 0,
                                          coefficients.cols() - 1);
  const double x = t - breaks[k];
  MotionValue f{0.0, 0.0, 0.0};
  for (Eigen::Index i = 0; i < coefficients.rows(); ++i) {  // Horner, with both derivatives
    f.a = f.a * x + 2.0 * f.v;
    f.v = f.v * x + f.q;
    f.q = f.q * x + coefficients(i, k);
  }
  return f;
}

PiecewisePolynomial PiecewisePolynomial::standing() const {
  const Eigen::VectorXd& t = breaks();
  const Eigen::Index n = t.size(), degree = coefficients().rows();
  Eigen::VectorXd all(n + 2);
  all << t[0] - 1.0, t, t[n - 1] + 1.0;
  Eigen::MatrixXd pieces = Eigen::MatrixXd::Zero(degree, n + 1);
  pieces.middleCols(1, n - 1) = coefficients();
  pieces(degree - 1, 0) = (*this)(t[0]).q;
  pieces(degree - 1, n) = (*this)(t[n - 1]).q;
  return {all, pieces};
}

PiecewisePolynomial PiecewisePolynomial::constant(double value) {
  return {Eigen::Vector2d(0.0, 1.0), Eigen::MatrixXd::Constant(1, 1, value)};
}

}  // namespace flexarm
