// The slices of a beam that carry its inertia.
#include <algorithm>
#include <utility>

#include "beam_profile.hpp"
#include "flexarm/quadrature.hpp"
#include "flexarm/spatial.hpp"

namespace flexarm {

using Eigen::MatrixXd;

SliceAtRest MassSlice::at_rest() const {
  SliceAtRest out = table.rest;
  out.J = table.at_rest();
  const Eigen::Vector3d r = out.R * com;
  out.x += r;
  out.J.topRows<3>() -= tilde(r) * out.J.bottomRows<3>().eval();
  return out;
}

namespace {

/// Gives slices, which are the Gauss rule of the mass, the centres of mass and inertia of laws at other points, so that
/// sums over them are those over the other points.
void share_inertia(const std::vector<SectionLaw>& laws, const MatrixXd& shares, bool rotary,
                   std::vector<MassSlice>& slices) {
  MatrixXd of = MatrixXd::Zero(static_cast<Eigen::Index>(laws.size()), 12);  // by mass: centre; inertia about the axis
  for (Eigen::Index f = 0; f < of.rows(); ++f) {
    const SectionLaw& law = laws[static_cast<std::size_t>(f)];
    if (!(law.mass > 0.0)) continue;
    Eigen::Matrix3d J = -tilde(law.com) * tilde(law.com);
    if (rotary) J += law.inertia / law.mass;
    of.row(f) << law.com.transpose(), J.reshaped().transpose();
  }
  const MatrixXd at = shares * of;
  std::vector<MassSlice> out = slices;
  for (std::size_t g = 0; g < out.size(); ++g) {
    const auto row = at.row(static_cast<Eigen::Index>(g));
    out[g].com = row.head<3>();
    out[g].inertia =
        out[g].mass * (Eigen::Matrix3d(row.tail<9>().reshaped(3, 3)) + tilde(out[g].com) * tilde(out[g].com));
    if (out[g].com.isZero(0.0) && out[g].inertia.diagonal().minCoeff() < 0.0) return;  // too steep
  }
  slices = std::move(out);
}

}  // namespace

std::vector<MassSlice> Beam::build_slices(const Profile& profile) {
  const int n =
      options_.gauss_points > 0 ? options_.gauss_points : enough_gauss_points(options_, shapes_, length_, tapers_);
  rule_ = GaussRule(n, length_);
  // Where the section varies, points and masses are the Gauss rule of the mass along the beam, so that they are as few.
  GaussRule masses = rule_;
  std::vector<SectionLaw> laws;
  MatrixXd shares;
  if (profile.uniform) {
    masses.weights *= profile.at(0.0).mass;
  } else {
    GaussRule along = profile.fine(2 * n + 16, length_);
    for (Eigen::Index g = 0; g < along.points.size(); ++g) {
      laws.push_back(profile.at(along.points[g]));
      along.weights[g] *= laws.back().mass;
    }
    if (along.weights.sum() > 0.0)
      masses = gauss_rule_of(along, n, profile.breaks.empty() ? nullptr : &shares);
    else
      masses.weights.setZero();
  }
  const Eigen::VectorXd parts = profile.uniform ? GaussRule(n).points : Eigen::VectorXd(masses.points / length_);
  std::vector<double> stations(parts.data(), parts.data() + n);
  places_ = {stations};
  stations.push_back(1.0);
  std::vector<SliceTable> all = tables_at(stations);
  const bool heavy = masses.weights.sum() > 0.0;
  std::vector<MassSlice> slices;
  for (int g = 0; g < n; ++g) {
    const SectionLaw law = profile.at(masses.points[g]);
    slices.push_back({all[g], masses.weights[g], law.com});
    if (options_.rotary_inertia && heavy) slices.back().inertia = masses.weights[g] / law.mass * law.inertia;
    if (profile.uniform && options_.order > 2) slices.back().table.point = g;
  }
  if (shares.size() > 0) share_inertia(laws, shares, options_.rotary_inertia, slices);
  tip_ = all[n];
  return slices;
}

void Beam::keep(std::vector<MassSlice> slices) {
  for (const MassSlice& s : slices) mass_ += s.mass;
  slices_ = std::make_shared<const std::vector<MassSlice>>(std::move(slices));
}

/// Whether the centres of mass lie off it, or sections have products of inertia.
bool Beam::off_axis(const Profile& profile) const {
  const auto off = [&](double X) {
    const SectionLaw law = profile.at(X);
    return !law.com.isZero(0.0) || (options_.rotary_inertia && !law.inertia.isDiagonal(0.0));
  };
  if (profile.uniform) return off(0.0);
  const GaussRule fine = profile.fine(8, length_);
  return std::any_of(fine.points.begin(), fine.points.end(), off);
}

}  // namespace flexarm
