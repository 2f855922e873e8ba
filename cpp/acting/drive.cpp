#include "flexarm/drive.hpp"

#include <algorithm>

#include "flexarm/check.hpp"

namespace flexarm {

PiecewisePolynomial::PiecewisePolynomial(Eigen::VectorXd breaks, Eigen::MatrixXd coefficients)
    : breaks_(std::move(breaks)), coefficients_(std::move(coefficients)) {
  if (breaks_.size() < 2 || coefficients_.cols() != breaks_.size() - 1 || coefficients_.rows() < 1)
    bad_value("breaks", breaks_.size(), "need one more break than columns of coefficients");
  for (Eigen::Index k = 0; k + 1 < breaks_.size(); ++k)
    if (!(breaks_[k + 1] > breaks_[k])) bad_value("t[" + std::to_string(k + 1) + "]", breaks_[k + 1], "must increase");
  if (!breaks_.allFinite() || !coefficients_.allFinite()) bad_value("samples", "nan or inf", "must be finite");
}

MotionValue PiecewisePolynomial::operator()(double t) const {
  const double* first = breaks_.data();
  const auto k = std::clamp<Eigen::Index>(std::upper_bound(first, first + breaks_.size(), t) - first - 1, 0,
                                          coefficients_.cols() - 1);
  const double x = t - breaks_[k];
  MotionValue f{0.0, 0.0, 0.0};
  for (Eigen::Index i = 0; i < coefficients_.rows(); ++i) {  // Horner, with both derivatives
    f.a = f.a * x + 2.0 * f.v;
    f.v = f.v * x + f.q;
    f.q = f.q * x + coefficients_(i, k);
  }
  return f;
}

MotionValue PiecewisePolynomial::within(double t) const {
  const double first = breaks_[0], last = breaks_[breaks_.size() - 1];
  const MotionValue f = (*this)(std::clamp(t, first, last));
  return t < first || t > last ? MotionValue{f.q, 0.0, 0.0} : f;
}

}  // namespace flexarm
