#include "flexarm/section.hpp"

#include <algorithm>
#include <cmath>

#include "flexarm/check.hpp"

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

}  // namespace flexarm
