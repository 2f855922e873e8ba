#include "flexarm/section.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "flexarm/check.hpp"
#include "flexarm/spatial.hpp"

namespace flexarm {

Material::Material(double rho, double youngs, std::optional<double> poisson, std::optional<double> shear)
    : density(non_negative("density", rho)), youngs_modulus(positive("youngs_modulus", youngs)), shear_modulus(0.0) {
  if (poisson && shear) bad_value("shear_modulus", *shear, "give either poisson_ratio or shear_modulus, not both");
  if (poisson) {
    if (!(*poisson > -1.0 && *poisson <= 0.5)) bad_value("poisson_ratio", *poisson, "must be above -1 and at most 0.5");
    shear_modulus = youngs_modulus / (2.0 * (1.0 + *poisson));
  }
  if (shear) shear_modulus = positive("shear_modulus", *shear);
}

Section::Section(double a, double iy, double iz, double j, ShearCorrection k)
    : area(positive("area", a)),
      second_moment_y(positive("second_moment_y", iy)),
      second_moment_z(positive("second_moment_z", iz)),
      torsion_constant(positive("torsion_constant", j)),
      shear_correction(positive("shear_correction", k.y), positive("shear_correction", k.z)) {}

namespace {

/// Saint-Venant: J = (1/3) b h^3 (1 - 192/pi^5 (h/b) sum over odd n of tanh(n pi b / 2h) / n^5), h <= b.
double rectangle_torsion(double y, double z) {
  const double h = std::min(y, z), b = std::max(y, z);
  double sum = 0.0;
  for (int n = 401; n >= 1; n -= 2) sum += std::tanh(n * kPi * b / (2.0 * h)) / std::pow(n, 5);
  return b * h * h * h / 3.0 * (1.0 - 192.0 / std::pow(kPi, 5) * h / b * sum);
}

/// Harmonic function from 0 to 1 across a right-angled corner between walls a and b thick: its flux (the walls' own are
/// length over thickness). By conformal mapping; 1 - (2/pi) log 2 = 0.559 of equal walls.
double corner_flux(double a, double b) {
  const double r = a / b;
  return 1.0 / r - 2.0 / kPi * std::log(4.0 * r / (r * r + 1.0)) +
         (r * r - 1.0) / (kPi * r) * std::acos((r * r - 1.0) / (r * r + 1.0));
}

/// Bredt: 4 A^2 / (flux of Prandtl's function across the wall), plus the walls' own, each with a share of the corners.
/// The flux is exact; the other constants are fitted to finite elements.
double box_torsion(double y, double z, double t, double s) {
  const double iy = y - 2.0 * t, iz = z - 2.0 * s, d = t - s, ts = t * s;
  const double flux = 2.0 * iy / s + 2.0 * iz / t + 4.0 * corner_flux(t, s);
  const double enclosed = iy * iz + iy * s + iz * t + 4.0 * (0.1440 * ts - 0.1236 * d * d);
  const double corners = 0.4141 * ts * ts + 0.4406 * ts * d * d - 0.1221 * std::pow(t * t - s * s, 2);
  return 4.0 * enclosed * enclosed / flux + 2.0 / 3.0 * (iy * s * s * s + iz * t * t * t) + 4.0 * corners;
}

/// The web to its full depth and the flanges beside it, rectangles each, and the junctions: the last term, fitted to
/// finite elements.
double i_beam_torsion(double y, double z, double f, double w) {
  const double s = std::min(w / f, 4.0), f3 = f * f * f;
  const double junction = s * (0.34444 + s * (0.10676 + s * (-0.06331 + s * 0.00923)));
  return rectangle_torsion(y, w) + 2.0 * (rectangle_torsion(z, f) - w * f3 / 3.0) + 2.0 * f3 * f * junction;
}

/// Shear along the webs, of thickness w altogether, between flanges f thick, y over all; b of each flange's breadth z
/// lies beside the webs. Shear flow: I^2 / (A int q^2 / t ds), in the webs, up through the flanges and along these.
double web_shear(double y, double z, double b, double f, double w, double area, double second_moment) {
  const double h = y - f, inner = y - 2.0 * f, c = 0.5 * z * f * h, i3 = inner * inner * inner;
  const double webs = (c * c * (inner + 2.0 / 3.0 * f) + c * w * i3 / 6.0 + w * w * i3 * inner * inner / 120.0) / w;
  const double flanges = h * h * b * b * b * f / 24.0;
  return second_moment * second_moment / (area * (webs + flanges));
}

/// Shear along the flanges of an I-beam: parabolic in each, and relieved by the web where they meet (0.2: fitted).
double flange_shear(double z, double f, double w, double area, double second_moment) {
  const auto flow = [&](double s) {
    return f / 4.0 * s * (std::pow(z, 4) / 16.0 + s * s * (s * s / 5.0 - z * z / 6.0));
  };
  const double relieved = f / (f + 0.2 * w);
  const double flanges = 4.0 * (flow(0.5 * z) - (1.0 - relieved) * flow(0.5 * w));
  return second_moment * second_moment / (area * flanges);
}

void below(const std::string& field, double value, double limit, const std::string& what) {
  if (positive(field, value) >= limit) bad_value(field, value, "must be less than " + what);
}

}  // namespace

Section Section::rectangle(double y, double z, ShearCorrection k) {
  positive("y", y);
  positive("z", z);
  Section out(y * z, y * z * z * z / 12.0, z * y * y * y / 12.0, rectangle_torsion(y, z), k);
  out.reach = {y / 2.0, z / 2.0};
  out.faces = {Face{y / 2.0, z, {}}, Face{z / 2.0, y, {}}};
  return out;
}

Section Section::circle(double radius, double inner, ShearCorrection k) {
  positive("radius", radius);
  non_negative("inner_radius", inner);
  if (inner >= radius) bad_value("inner_radius", inner, "must be smaller than the radius");
  const double i = kPi / 4.0 * (std::pow(radius, 4) - std::pow(inner, 4));
  Section out(kPi * (radius * radius - inner * inner), i, i, 2.0 * i, k);
  out.reach = {radius, radius};
  out.faces = {Face{radius, 2.0 * radius, 1.0}, Face{radius, 2.0 * radius, 1.0}};
  return out;
}

Section Section::tube(double radius, double thickness, std::optional<ShearCorrection> k) {
  positive("radius", radius);
  below("thickness", thickness, radius, "the radius; of a full section it is a Circle");
  const double m = 1.0 - thickness / radius, m2 = std::pow(1.0 + m * m, 2);
  return circle(radius, radius - thickness, k.value_or(6.0 * m2 / (7.0 * m2 + 20.0 * m * m)));
}

Section Section::ellipse(double y, double z, std::optional<ShearCorrection> k) {
  const double a = positive("y", y) * y, b = positive("z", z) * z, yz = y * z;
  const ShearCorrection own(3.0 * (3.0 * a + b) / (10.0 * a + 4.0 * b), 3.0 * (3.0 * b + a) / (10.0 * b + 4.0 * a));
  Section out(kPi / 4.0 * yz, kPi / 64.0 * yz * b, kPi / 64.0 * yz * a, kPi / 16.0 * yz * yz * yz / (a + b),
              k.value_or(own));
  out.reach = {y / 2.0, z / 2.0};
  return out;
}

Section Section::box(double y, double z, double t, double s, std::optional<ShearCorrection> k) {
  positive("y", y);
  positive("z", z);
  below("thickness", t, y / 2.0, "half of y; a full section is a Rectangle");
  below("thickness", s, z / 2.0, "half of z; a full section is a Rectangle");
  const double iy = y - 2.0 * t, iz = z - 2.0 * s, area = y * z - iy * iz;
  const double about_y = (y * z * z * z - iy * iz * iz * iz) / 12.0,
               about_z = (z * y * y * y - iz * iy * iy * iy) / 12.0;
  const ShearCorrection own(web_shear(y, z, iz, t, 2.0 * s, area, about_z),
                            web_shear(z, y, iy, s, 2.0 * t, area, about_y));
  Section out(area, about_y, about_z, box_torsion(y, z, t, s), k.value_or(own));
  out.reach = {y / 2.0, z / 2.0};
  // Bredt's flow, through the middle of the wall, and the wall's own torsion at its surface
  const double flow = (y - t) * (z - s) / ((y - t) / s + (z - s) / t);
  out.faces = {Face{y / 2.0, z, (flow / t + t) / (y / 2.0)}, Face{z / 2.0, y, (flow / s + s) / (z / 2.0)}};
  return out;
}

Section Section::i_beam(double y, double z, double f, double w, std::optional<ShearCorrection> k) {
  positive("y", y);
  positive("z", z);
  below("flange", f, y / 2.0, "half of y; a full section is a Rectangle");
  below("web", w, z, "z, the flanges' width; a full section is a Rectangle");
  const double inner = y - 2.0 * f, area = 2.0 * z * f + inner * w;
  const double about_y = (2.0 * f * z * z * z + inner * w * w * w) / 12.0;
  const double about_z = (z * y * y * y - (z - w) * inner * inner * inner) / 12.0;
  const ShearCorrection own(web_shear(y, z, z - w, f, w, area, about_z), flange_shear(z, f, w, area, about_y));
  Section out(area, about_y, about_z, i_beam_torsion(y, z, f, w), k.value_or(own));
  out.reach = {y / 2.0, z / 2.0};
  out.faces[0] = Face{y / 2.0, z, 2.0 * f / y};
  return out;
}

namespace {

constexpr double kRounding = 1e-9;  // of the size of the compared values

/// Entries over the roots of the diagonal's, so that they are comparable without units.
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
