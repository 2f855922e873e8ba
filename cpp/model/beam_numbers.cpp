// Conversion of a beam to its numbers, and back.
#include "beam_profile.hpp"
#include "flexarm/check.hpp"
#include "shape_tables.hpp"

namespace flexarm {

using Eigen::MatrixXd;

namespace {

constexpr int kMostPoints = 2000;

void check_size(const char* field, const MatrixXd& m, Eigen::Index rows, Eigen::Index cols) {
  if (m.rows() != rows || m.cols() != cols)
    bad_value(field, std::to_string(m.rows()) + " x " + std::to_string(m.cols()),
              "must be " + std::to_string(rows) + " x " + std::to_string(cols));
}

}  // namespace

Beam::Beam(const BeamNumbers& n)
    : length_(positive("length", n.length)), uniform_(n.uniform), tapers_(!n.uniform), options_(n.options) {
  check_options(options_, true);
  for (int s = 0; s < kStrains; ++s)
    for (const MatrixXd& given : {options_.shapes[s], n.loaded[s]})
      if (given.size() > 0) check_size("shapes", given, given.rows(), options_.modes[s]);
  take_shapes(n.loaded);
  if (n.planar) plane_ = plane_of(options_.modes, options_.order);
  if (options_.curvature.size() > 0) curve(nullptr);
  unit_ = std::make_shared<const UnitShapes>(unit_shapes(shapes_, first_, options_.order == 2));
  if (n.points < 1 || n.points > kMostPoints)
    bad_value("points", n.points, "must be from 1 to " + std::to_string(kMostPoints));
  rule_ = GaussRule(n.points, length_);
  std::vector<MassSlice> slices = n.slices;
  std::size_t first = 0;
  for (std::vector<double> sweep : n.places) {
    const std::size_t count = sweep.size();
    for (std::size_t k = 0; k < count; ++k)
      if (!(sweep[k] >= (k == 0 ? 0.0 : sweep[k - 1]) && sweep[k] <= 1.0))
        bad_value("places", sweep[k], "must not decrease, and be from 0 to 1");
    if (count > slices.size() - first) bad_value("slices", slices.size(), "must be one for each place");
    if (first == 0) sweep.push_back(1.0);
    const std::vector<SliceTable> all = tables_at(sweep);
    for (std::size_t k = 0; k < count; ++k) slices[first + k].table = all[k];
    if (first == 0) tip_ = all.back();
    if (first == 0 && uniform_ && options_.order > 2 && count == static_cast<std::size_t>(n.points))
      for (std::size_t k = 0; k < count; ++k) slices[k].table.point = static_cast<int>(k);
    first += count;
  }
  if (first == 0 || first != slices.size()) bad_value("slices", slices.size(), "must be one for each place");
  uniform_ = uniform_ && n.places.size() == 1;
  places_ = n.places;
  keep(std::move(slices));
  check_size("stiffness", n.stiffness, ne_, ne_);
  check_size("damping", n.damping, ne_, ne_);
  check_size("patch_forces", n.patch_forces, ne_, n.patch_capacitances.size());
  stiffness_ = n.stiffness;
  damping_ = n.damping;
  patch_forces_ = n.patch_forces;
  patch_capacitances_ = n.patch_capacitances;
}

BeamNumbers Beam::numbers() const {
  BeamNumbers n{length_,
                options_,
                {},
                !tapers_,
                plane_ == plane_of(options_.modes, options_.order),
                points(),
                places_,
                *slices_,
                stiffness_,
                damping_,
                patch_forces_,
                patch_capacitances_};
  for (int s = 0; s < kStrains; ++s)
    if (options_.shapes[s].size() == 0) n.loaded[s] = shapes_[s].coefficients();
  return n;
}

}  // namespace flexarm
