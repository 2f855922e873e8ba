#include "flexarm/shape.hpp"

#include <cmath>

#include "flexarm/check.hpp"
#include "flexarm/spatial.hpp"

namespace flexarm {

namespace {

/// Whether the table has the enumerators in their order, and one strain on each row.
constexpr bool is_sound() {
  bool taken[kStrains] = {};
  for (int s = 0; s < kStrains; ++s) {
    const StrainField& f = kStrainFields[s];
    if (f.which != s || f.strain < 0 || f.strain >= kStrains || taken[f.strain]) return false;
    taken[f.strain] = true;
  }
  return true;
}
static_assert(is_sound(), "kStrainFields");

/// Root i = 0, 1, ... of cos(b) cosh(b) = -1, the Euler-Bernoulli clamped-free equation.
double clamped_free_root(int i) {
  double b = i == 0 ? 1.875104 : (i + 0.5) * kPi;
  for (int it = 0; it < 8; ++it) b -= (std::cos(b) + 1.0 / std::cosh(b)) / (-std::sin(b) - std::tanh(b) / std::cosh(b));
  return b;
}

/// phi = cosh - cos - sigma (sinh - sin), written with sigma = 1 + eps so that cosh - sigma sinh = exp(-) -
/// eps sinh keeps its digits in high modes. Scaled to 1 at the free end.
void clamped_free_mode(int i, double length, double x, double& deflection, double& slope, double& curvature) {
  const double b = clamped_free_root(i), k = b / length;
  const double eps = (std::exp(-b) + std::cos(b) - std::sin(b)) / (std::sinh(b) + std::sin(b));
  const auto phi = [&](double z, double& d0, double& d1, double& d2) {
    const double e = std::exp(-z), sh = eps * std::sinh(z), ch = eps * std::cosh(z);
    const double c = std::cos(z), s = std::sin(z), sigma = 1.0 + eps;
    d0 = e - sh - c + sigma * s;
    d1 = -e - ch + s + sigma * c;
    d2 = e - sh + c - sigma * s;
  };
  double end, unused1, unused2;
  phi(b, end, unused1, unused2);
  phi(k * x, deflection, slope, curvature);
  deflection /= end;
  slope *= k / end;
  curvature *= k * k / end;
}

/// Legendre polynomials P_0 .. P_{n-1} at s, and P_n.
Eigen::VectorXd legendre(int n, double s) {
  Eigen::VectorXd p = Eigen::VectorXd::Ones(n + 1);
  if (n >= 1) p[1] = s;
  for (int k = 2; k <= n; ++k) p[k] = ((2 * k - 1) * s * p[k - 1] - (k - 1) * p[k - 2]) / k;
  return p;
}

/// From values f_0 .. f_n of a family with int f_k ~ (f_{k+1} - f_{k-1})/(2k + 1), the integrals from X = 0.
/// P_{-1} is read as -P_0: so that the integral of P_0 vanishes at s = -1.
Eigen::VectorXd integrate_legendre(const Eigen::VectorXd& f, double length) {
  const Eigen::Index n = f.size() - 1;
  Eigen::VectorXd out(n);
  for (Eigen::Index k = 0; k < n; ++k)
    out[k] = 0.5 * length * (f[k + 1] - (k == 0 ? -f[0] : f[k - 1])) / (2.0 * static_cast<double>(k) + 1.0);
  return out;
}

/// Strains P_0 .. P_{n-1}, and their integrals.
ShapeValues legendre_shapes(bool bending, int n, double length, double x) {
  const Eigen::VectorXd p = legendre(n + 1, 2.0 * x / length - 1.0);
  ShapeValues v{{}, integrate_legendre(p, length), p.head(n)};
  if (bending) v.deflection = integrate_legendre(v.slope, length);
  v.slope.conservativeResize(n);
  return v;
}

/// Bending: Euler-Bernoulli modes. Torsion, shear and extension: sin((2i - 1) pi X / 2L), scaled to 1 at X = L.
ShapeValues clamped_free_shapes(bool bending, int n, double length, double x) {
  ShapeValues v{Eigen::VectorXd(bending ? n : 0), Eigen::VectorXd(n), Eigen::VectorXd(n)};
  for (int i = 0; i < n; ++i) {
    if (bending) {
      clamped_free_mode(i, length, x, v.deflection[i], v.slope[i], v.strain[i]);
      continue;
    }
    const double k = (2 * i + 1) * kPi / (2.0 * length), sign = i % 2 == 0 ? 1.0 : -1.0;
    v.slope[i] = sign * std::sin(k * x);
    v.strain[i] = sign * k * std::cos(k * x);
  }
  return v;
}

}  // namespace

Basis basis_from_name(const std::string& name) {
  if (name == "clamped-free") return Basis::clamped_free;
  if (name == "legendre") return Basis::legendre;
  if (name == "loaded") return Basis::loaded;
  bad_value("basis", "\"" + name + "\"", "must be \"clamped-free\", \"legendre\" or \"loaded\"");
}

ShapeSet::ShapeSet(int strain, Basis basis, int n, double length)
    : strain_(strain), basis_(basis), n_(n), length_(length) {}

ShapeSet::ShapeSet(int strain, Eigen::MatrixXd coefficients, double length)
    : strain_(strain),
      basis_(Basis::legendre),
      n_(static_cast<int>(coefficients.cols())),
      length_(length),
      legendre_(std::move(coefficients)) {
  // Orthonormal in the mean square of the strain: each shape less its projection on those before it.
  Eigen::MatrixXd left = legendre_;
  for (Eigen::Index k = 0; k < left.rows(); ++k) left.row(k) /= std::sqrt(2.0 * static_cast<double>(k) + 1.0);
  for (Eigen::Index k = 0; k < left.cols(); ++k) {
    const std::string shape = std::string("modes.") + kStrainFields[strain_].name + "[" + std::to_string(k) + "]";
    const double size = left.col(k).norm();
    if (!(size > 0.0) || !std::isfinite(size))
      bad_value(shape, size, "its strain must be finite, and not zero throughout");
    left.col(k) /= size;
    for (int twice = 0; twice < 2; ++twice)
      left.col(k) -= left.leftCols(k) * (left.leftCols(k).transpose() * left.col(k));
    const double independent = left.col(k).norm();
    if (independent < 1e-6)
      bad_value(shape, independent, "is this share of it independent: it is a combination of the shapes before it");
    left.col(k) /= independent;
  }
}

ShapeSet ShapeSet::at_length(double length) const {
  ShapeSet out = *this;
  out.length_ = length;
  return out;
}

ShapeValues ShapeSet::at(double x) const {
  const bool bending = is_bending(strain_);
  if (legendre_.size() == 0)
    return basis_ == Basis::clamped_free ? clamped_free_shapes(bending, n_, length_, x)
                                         : legendre_shapes(bending, n_, length_, x);
  const ShapeValues p = legendre_shapes(bending, static_cast<int>(legendre_.rows()), length_, x);
  const auto combine = [&](const Eigen::VectorXd& v) -> Eigen::VectorXd { return legendre_.transpose() * v; };
  return {bending ? combine(p.deflection) : Eigen::VectorXd(), combine(p.slope), combine(p.strain)};
}

}  // namespace flexarm
