#include "flexarm/patch.hpp"

#include <algorithm>
#include <cmath>

#include "flexarm/beam.hpp"
#include "flexarm/check.hpp"

namespace flexarm {

namespace {

constexpr double kPi = 3.14159265358979323846;
enum Row { K1, K2, K3, phi12, phi13 };

}  // namespace

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
  // Strains in the layer: at +-r along the normal, xx = bend K_b + ..., xs = phi_s + turn K1, xn = phi_n
  const bool y = l.across == 1;
  const Row bend = y ? K3 : K2, flap = y ? K2 : K3, in_plane = y ? phi13 : phi12, normal = y ? phi12 : phi13;
  const double bend_sign = y ? -1.0 : 1.0, turn_sign = (y ? 1.0 : -1.0) * l.twist;
  PatchSection out;
  for (int side : {1, -1}) {
    if (!(side > 0 ? l.plus : l.minus)) continue;
    const bool second = side < 0 && l.plus;
    const double volts = second && l.opposed ? -1.0 : 1.0;
    const double angle = second && !l.opposed ? -l.angle : l.angle;
    const double c = std::cos(angle), s = std::sin(angle);
    const double xx = c * c * m.d31 + s * s * m.d32, xs = 2.0 * s * c * (m.d31 - m.d32), xn = c * m.d15;
    out.rigidity(bend, bend) += E * across;
    out.rigidity(flap, flap) += E * along;
    out.rigidity(K1, K1) += G * l.twist * l.twist * across;
    out.rigidity(in_plane, in_plane) += G * area;
    const double coupling = side * G * turn_sign * area * (l.inner + 0.5 * l.thickness);
    out.rigidity(K1, in_plane) += coupling;
    out.rigidity(in_plane, K1) += coupling;
    if (m.d15 != 0.0) out.rigidity(normal, normal) += G * area;
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

// -- on a beam
// ---------------------------------------------------------------------------------------------------------

namespace {

/// n points on each stretch of a patch.
GaussRule rule_along(const Patch& p, int n) {
  std::vector<double> breaks;
  for (double b : p.breaks) breaks.push_back(b - p.start);
  GaussRule rule(n, p.end - p.start, breaks);
  rule.points.array() += p.start;
  return rule;
}

}  // namespace

Eigen::Matrix<double, 5, Eigen::Dynamic> Beam::strains_at(double X) const {
  Eigen::Matrix<double, 5, Eigen::Dynamic> out = Eigen::MatrixXd::Zero(5, ne_);
  for (int i = 0; i < kStrains; ++i) {
    const StrainField& f = kStrainFields[i];
    const Eigen::VectorXd strain = shapes_[i].at(X).strain;
    out.block(f.strain, first_[i], 1, strain.size()) = f.sign * strain.transpose();
  }
  return out;
}

void Beam::check_patch(const Patch& p) const {
  if (!(p.start >= 0.0 && p.start < length_))
    bad_value("start", p.start, "must be on the beam, from 0 to below its length, " + std::to_string(length_) + " m");
  if (!(p.end > p.start && p.end <= length_ * (1.0 + 1e-12)))
    bad_value("end", p.end,
              "must be beyond the start and at most the beam's length, " + std::to_string(length_) + " m");
  double from = p.start;
  for (double b : p.breaks) {
    if (!(b > from && b < p.end)) bad_value("break", b, "must increase, between start and end");
    from = b;
  }
}

/// Points that integrate a product of two strains over any stretch of the beam.
int Beam::points_for_strains() const {
  Eigen::Index most = 0;
  for (const ShapeSet& s : shapes_) most = std::max({most, s.terms(), static_cast<Eigen::Index>(s.size())});
  return 24 + 2 * static_cast<int>(most);
}

Eigen::VectorXd Beam::patch_force(const Patch& p, double* capacitance) const {
  check_patch(p);
  Eigen::VectorXd force = Eigen::VectorXd::Zero(ne_);
  double farads = 0.0;
  const GaussRule rule = rule_along(p, points_for_strains());
  for (Eigen::Index g = 0; g < rule.points.size(); ++g) {
    const PatchSection section = p.at(rule.points[g]);
    force += rule.weights[g] * strains_at(rule.points[g]).transpose() * section.force;
    farads += rule.weights[g] * section.capacitance;
  }
  if (capacitance) *capacitance = farads;
  return force;
}

void Beam::add_patch_slices(const Patch& p, std::vector<MassSlice>& slices) {
  check_patch(p);
  int n = enough_gauss_points(options_, shapes_, length_, (p.end - p.start) / length_);
  if (options_.gauss_points > 0) n = std::min(n, options_.gauss_points);
  const GaussRule rule = rule_along(p, n);
  const std::vector<SliceTable> all = tables({rule.points.data(), rule.points.data() + rule.points.size()});
  for (Eigen::Index g = 0; g < rule.points.size(); ++g) {
    const PatchSection section = p.at(rule.points[g]);
    const double mass = rule.weights[g] * section.mass;
    if (!(mass > 0.0)) continue;
    Eigen::Vector3d inertia = Eigen::Vector3d::Zero();
    if (options_.rotary_inertia) inertia = rule.weights[g] * section.inertia;
    slices.push_back({all[static_cast<std::size_t>(g)], mass, inertia});
    mass_ += mass;
  }
}

Eigen::MatrixXd Beam::patch_stiffness(const Patch& p) const {
  Eigen::MatrixXd K = Eigen::MatrixXd::Zero(ne_, ne_);
  const GaussRule rule = rule_along(p, points_for_strains());
  for (Eigen::Index g = 0; g < rule.points.size(); ++g) {
    const auto strains = strains_at(rule.points[g]);
    K += rule.weights[g] * strains.transpose() * p.at(rule.points[g]).rigidity * strains;
  }
  return K;
}

}  // namespace flexarm
