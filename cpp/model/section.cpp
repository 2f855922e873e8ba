#include "flexarm/section.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "flexarm/check.hpp"
#include "flexarm/spatial.hpp"

namespace flexarm {

namespace {
constexpr double kPi = 3.14159265358979323846;
}

Material::Material(double rho, double youngs, std::optional<double> poisson, std::optional<double> shear)
    : density(non_negative("density", rho)), youngs_modulus(positive("youngs_modulus", youngs)), shear_modulus(0.0) {
  if (poisson && shear) bad_value("shear_modulus", *shear, "give either poisson_ratio or shear_modulus, not both");
  if (poisson) {
    if (!(*poisson > -1.0 && *poisson <= 0.5)) bad_value("poisson_ratio", *poisson, "must be above -1 and at most 0.5");
    shear_modulus = youngs_modulus / (2.0 * (1.0 + *poisson));
  }
  if (shear) shear_modulus = positive("shear_modulus", *shear);
}

Section::Section(double a, double iy, double iz, double j, double k)
    : area(positive("area", a)),
      second_moment_y(positive("second_moment_y", iy)),
      second_moment_z(positive("second_moment_z", iz)),
      torsion_constant(positive("torsion_constant", j)),
      shear_correction(positive("shear_correction", k)) {}

Section Section::rectangle(double y, double z, double k) {
  positive("y", y);
  positive("z", z);
  // Saint-Venant: J = (1/3) b h^3 (1 - 192/pi^5 (h/b) sum over odd n of tanh(n pi b / 2h) / n^5), h <= b
  const double h = std::min(y, z), b = std::max(y, z);
  double sum = 0.0;
  for (int n = 401; n >= 1; n -= 2) sum += std::tanh(n * kPi * b / (2.0 * h)) / std::pow(n, 5);
  const double j = b * h * h * h / 3.0 * (1.0 - 192.0 / std::pow(kPi, 5) * h / b * sum);
  return Section(y * z, y * z * z * z / 12.0, z * y * y * y / 12.0, j, k);
}

Section Section::circle(double radius, double inner, double k) {
  positive("radius", radius);
  non_negative("inner_radius", inner);
  if (inner >= radius) bad_value("inner_radius", inner, "must be smaller than the radius");
  const double i = kPi / 4.0 * (std::pow(radius, 4) - std::pow(inner, 4));
  return Section(kPi * (radius * radius - inner * inner), i, i, 2.0 * i, k);
}

namespace {

constexpr double kRounding = 1e-9;  // of the size of what is compared

/// Entries by the roots of the diagonal's, so that they compare whatever their units.
Eigen::MatrixXd scaled(const Eigen::MatrixXd& m) {
  const Eigen::VectorXd size = m.diagonal().cwiseAbs().cwiseSqrt();
  const Eigen::VectorXd by = (size.array() > 0.0).select(size.cwiseInverse(), 1.0);
  return by.asDiagonal() * m * by.asDiagonal();
}

void check_matrix(const std::string& field, const SectionMatrix::Matrix& m) {
  if (!m.allFinite()) bad_value(field, m.sum(), "must be finite");
  const Eigen::MatrixXd s = scaled(m);
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < i; ++j)
      if (std::abs(s(i, j) - s(j, i)) > kRounding * (std::abs(s(i, j)) + 1.0))
        bad_value(field + "[" + std::to_string(i) + "][" + std::to_string(j) + "]", m(i, j),
                  "must be as at [" + std::to_string(j) + "][" + std::to_string(i) + "], " + std::to_string(m(j, i)) +
                      ": the matrix must be symmetric");
  const double least = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(s, Eigen::EigenvaluesOnly).eigenvalues()[0];
  if (least < -kRounding)
    bad_value(field, least, "its least eigenvalue, scaled to a diagonal of ones, must not be negative");
}

}  // namespace

SectionMatrix::SectionMatrix(const Matrix& of_stiffness, const Matrix& of_inertia)
    : stiffness(of_stiffness), inertia(of_inertia) {
  check_matrix("stiffness", stiffness);
  check_matrix("inertia", inertia);
  const double size = inertia.cwiseAbs().maxCoeff();
  Matrix form = inertia;
  form.topLeftCorner<3, 3>() = mass() * Eigen::Matrix3d::Identity();
  form.topRightCorner<3, 3>() = -mass() * tilde(com());
  form.bottomLeftCorner<3, 3>() = form.topRightCorner<3, 3>().transpose();
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < 6; ++j)
      if (std::abs(form(i, j) - inertia(i, j)) > kRounding * size)
        bad_value("inertia[" + std::to_string(i) + "][" + std::to_string(j) + "]", inertia(i, j),
                  "must be " + std::to_string(form(i, j)) +
                      ": the matrix is [m 1, -m c~; m c~, J], with m the mass per length and c the centre of mass");
  if (std::abs(com()[0]) > kRounding * com().norm())
    bad_value("inertia", com().transpose(), "is the centre of mass: must lie in the section; x is along the beam");
  const Eigen::Matrix3d J = inertia_about_com();
  const double least = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(J, Eigen::EigenvaluesOnly).eigenvalues()[0];
  if (least < -kRounding * size)
    bad_value("inertia", least, "is a principal moment about the centre of mass: must not be negative");
}

Eigen::Vector3d SectionMatrix::com() const {
  if (!(mass() > 0.0)) return Eigen::Vector3d::Zero();
  const auto of = [&](int i, int j) { return inertia(i, 3 + j) - inertia(j, 3 + i); };
  return Eigen::Vector3d(of(1, 2), of(2, 0), of(0, 1)) / (2.0 * mass());
}

Eigen::Matrix3d SectionMatrix::inertia_about_com() const {
  const Eigen::Matrix3d J = inertia.bottomRightCorner<3, 3>(), c = tilde(com());
  return 0.5 * (J + J.transpose()) + mass() * c * c;
}

}  // namespace flexarm
