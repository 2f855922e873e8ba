// Patches on a beam: forces per volt, stiffness, and the slices that carry their mass.
#include <algorithm>

#include "flexarm/beam.hpp"
#include "flexarm/check.hpp"

namespace flexarm {

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

StrainMatrix Beam::strains_at(double X) const {
  StrainMatrix out = StrainMatrix::Zero(kStrains, ne_);
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
  int n = enough_gauss_points(options_, shapes_, length_, tapers_, (p.end - p.start) / length_);
  if (options_.gauss_points > 0) n = std::min(n, options_.gauss_points);
  const GaussRule rule = rule_along(p, n);
  const Eigen::VectorXd parts = rule.points / length_;
  places_.emplace_back(parts.data(), parts.data() + parts.size());
  const std::vector<SliceTable> all = tables_at(places_.back());
  for (Eigen::Index g = 0; g < rule.points.size(); ++g) {
    const PatchSection section = p.at(rule.points[g]);
    const double mass = rule.weights[g] * section.mass;
    slices.push_back({all[static_cast<std::size_t>(g)], mass});
    if (options_.rotary_inertia) slices.back().inertia = (rule.weights[g] * section.inertia).asDiagonal();
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
