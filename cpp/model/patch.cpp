#include "flexarm/patch.hpp"

#include <algorithm>
#include <cmath>

#include "flexarm/check.hpp"
#include "flexarm/spatial.hpp"

namespace flexarm {

Piezo::Piezo(double youngs, double poisson, double rho, double along, double across, double shear, double epsilon)
    : youngs_modulus(positive("youngs_modulus", youngs)),
      poisson_ratio(poisson),
      density(non_negative("density", rho)),
      d31(along),
      d32(across),
      d15(shear),
      permittivity(non_negative("permittivity", epsilon)) {
  if (!(poisson > -1.0 && poisson <= 0.5)) bad_value("poisson_ratio", poisson, "must be above -1 and at most 0.5");
  for (const auto& [name, d] : {std::pair{"d31", d31}, {"d32", d32}, {"d15", d15}})
    if (!std::isfinite(d)) bad_value(name, d, "must be finite");
}

PatchSection patch_section(const Piezo& m, const PatchLayer& l) {
  positive("width", l.width);
  positive("thickness", l.thickness);
  non_negative("offset", l.inner);
  if (!(std::abs(l.electrode) <= 1.0 + 1e-9)) bad_value("profile", l.electrode, "must be from -1 to 1, of the width");
  const double E = m.youngs_modulus, G = E / (2.0 * (1.0 + m.poisson_ratio));
  const double outer = l.inner + l.thickness, area = l.width * l.thickness;
  const double across = l.width * (std::pow(outer, 3) - std::pow(l.inner, 3)) / 3.0;  // int r^2 dA
  const double along = area * l.width * l.width / 12.0;                               // int s^2 dA
  const double arm = l.electrode * l.width * (l.inner + 0.5 * l.thickness);           // int r dA / t of the electrode
  // Strains in the layer: at +-r along the normal, xx = eps + bend K_b + ..., xs = phi_s + turn K1, xn = phi_n
  const bool y = l.across == 1;
  const auto K1 = StrainRow::K1, bend = y ? StrainRow::K3 : StrainRow::K2, flap = y ? StrainRow::K2 : StrainRow::K3;
  const auto eps = StrainRow::eps, in_plane = y ? StrainRow::phi13 : StrainRow::phi12,
             normal = y ? StrainRow::phi12 : StrainRow::phi13;
  const double bend_sign = y ? -1.0 : 1.0, turn_sign = (y ? 1.0 : -1.0) * l.twist;
  PatchSection out;
  for (int side : {1, -1}) {
    if (!(side > 0 ? l.plus : l.minus)) continue;
    const bool second = side < 0 && l.plus;
    const double volts = second && l.opposed ? -1.0 : 1.0;
    const double angle = second && !l.opposed ? -l.angle : l.angle;
    const double c = std::cos(angle), s = std::sin(angle);
    const double xx = c * c * m.d31 + s * s * m.d32, xs = 2.0 * s * c * (m.d31 - m.d32), xn = c * m.d15;
    const double lever = side * area * (l.inner + 0.5 * l.thickness);  // int r dA
    out.rigidity(eps, eps) += E * area;
    out.rigidity(eps, bend) += E * bend_sign * lever;
    out.rigidity(bend, eps) += E * bend_sign * lever;
    out.rigidity(bend, bend) += E * across;
    out.rigidity(flap, flap) += E * along;
    out.rigidity(K1, K1) += G * l.twist * l.twist * across;
    out.rigidity(in_plane, in_plane) += G * area;
    const double coupling = G * turn_sign * lever;
    out.rigidity(K1, in_plane) += coupling;
    out.rigidity(in_plane, K1) += coupling;
    if (m.d15 != 0.0) out.rigidity(normal, normal) += G * area;
    out.force[eps] += volts * E * xx * l.electrode * l.width;
    out.force[bend] += volts * E * xx * bend_sign * side * arm;
    out.force[K1] += volts * G * xs * turn_sign * side * arm;
    out.force[in_plane] += volts * G * xs * l.electrode * l.width;
    out.force[normal] += volts * G * xn * l.electrode * l.width;
    const double held = m.permittivity - E * xx * xx - G * (xs * xs + xn * xn);
    if (m.permittivity > 0.0 && !(held > 0.0))
      bad_value("permittivity", m.permittivity,
                "at constant stress must be above what stress alone gives, E d^2 = " +
                    std::to_string((m.permittivity - held) * 1e9) + "e-9 F/m");
    if (m.permittivity > 0.0) out.capacitance += held * std::abs(l.electrode) * l.width / l.thickness;
    out.mass += m.density * area;
    out.inertia += m.density * Eigen::Vector3d(across + along, y ? along : across, y ? across : along);
  }
  return out;
}

double surface_twist(double depth, double breadth, double width) {
  positive("depth", depth);
  positive("breadth", breadth);
  if (!(width > 0.0 && width <= breadth * (1.0 + 1e-9)))
    bad_value("width", width, "must be positive, and at most the face's " + std::to_string(breadth) + " m");
  // gamma = K1 h (1 - 8/pi^2 sum over odd n of cosh(n pi s/h) / (n^2 cosh(n pi b/2h))), and its mean over the width
  double sum = 0.0;
  for (int n = 4001; n >= 1; n -= 2) {
    const double k = n * kPi / depth;
    const double ratio =
        std::exp(-0.5 * k * (breadth - width)) * -std::expm1(-k * width) / (1.0 + std::exp(-k * breadth));
    sum += 2.0 / (k * width) * ratio / (static_cast<double>(n) * n);
  }
  return 2.0 * (1.0 - 8.0 / (kPi * kPi) * sum);
}

}  // namespace flexarm
