#include "flexarm/beam.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "beam_profile.hpp"
#include "flexarm/check.hpp"
#include "flexarm/quadrature.hpp"
#include "flexarm/spatial.hpp"
#include "shape_tables.hpp"

namespace flexarm {

namespace {

using Eigen::MatrixXd;

/// For shapes of any form: by trial, until the Gram matrix of the slices' motions (with the link, deflections, slopes,
/// and the running integrals of their products that shorten the beam) is right to 1e-12.
/// Order 3 and above take half as many more, as clamped-free modes do.
int gauss_points_by_trial(const BeamOptions& o, const std::vector<ShapeSet>& shapes, double length) {
  Eigen::Index terms = 0;
  for (const ShapeSet& s : shapes) terms = std::max(terms, std::max<Eigen::Index>(s.terms(), s.size()));
  const GaussRule fine(2 * static_cast<int>(terms) + 8, length);
  const auto samples = [&](const Eigen::VectorXd& points) {  // one row for each function
    std::vector<Eigen::VectorXd> rows;
    const auto add = [&](const Eigen::MatrixXd& m) {
      for (Eigen::Index k = 0; k < m.cols(); ++k) rows.push_back(m.col(k));
    };
    add(Eigen::VectorXd::Ones(points.size()));
    for (int strain = 0; strain < kStrains; ++strain) {
      const ShapeSet& set = shapes[strain];
      const auto slopes_at = [&](const Eigen::VectorXd& at) {
        MatrixXd m(at.size(), set.size());
        for (Eigen::Index g = 0; g < at.size(); ++g) m.row(g) = set.at(at[g]).slope.transpose();
        return m;
      };
      add(slopes_at(points));
      if (!is_bending(strain)) continue;
      MatrixXd deflection(points.size(), set.size());
      for (Eigen::Index g = 0; g < points.size(); ++g) deflection.row(g) = set.at(points[g]).deflection.transpose();
      add(deflection);
      if (o.order < 2) continue;
      MatrixXd integral(points.size(), fine.points.size());
      for (Eigen::Index g = 0; g < points.size(); ++g) integral.row(g) = integral_weights(fine, length, points[g]);
      const MatrixXd slope = slopes_at(fine.points);
      for (Eigen::Index i = 0; i < slope.cols(); ++i)
        add(integral * (slope.rightCols(slope.cols() - i).array().colwise() * slope.col(i).array()).matrix());
    }
    MatrixXd all(static_cast<Eigen::Index>(rows.size()), points.size());
    for (std::size_t k = 0; k < rows.size(); ++k) all.row(static_cast<Eigen::Index>(k)) = rows[k].transpose();
    return all;
  };
  const auto gram = [&](const GaussRule& rule) -> MatrixXd {
    const MatrixXd f = samples(rule.points);
    return f * rule.weights.asDiagonal() * f.transpose();
  };
  const MatrixXd truth = gram(fine);
  const Eigen::VectorXd size = truth.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const int most = static_cast<int>(fine.points.size());
  for (int n = 4; n < most; n += 1 + n / 8) {
    const MatrixXd wrong = gram(GaussRule(n, length)) - truth;
    if ((size.asDiagonal() * wrong * size.asDiagonal()).cwiseAbs().maxCoeff() > 1e-12) continue;
    const bool products_turn = o.order > 2 || (o.order == 1 && o.rotary_inertia);
    if (o.order == kExact && plane_of(o.modes, o.order) == Plane::none) return 2 * n + 2;
    return products_turn ? n + n / 2 + 2 : n;
  }
  return most;
}

}  // namespace

/// Additional points of a curved beam: sections that turn by k at rest bring exp(i k X/L) into the integrands, which
/// takes e k / 4 points more, and as many as the curvature has degrees.
int points_at_rest(const Eigen::MatrixXd& curvature, double length) {
  if (curvature.size() == 0) return 0;
  const double k = length * curvature.cwiseAbs().colwise().sum().norm();
  return static_cast<int>(std::ceil(0.7 * k)) + static_cast<int>(curvature.rows()) - 1;
}

/// Of a straight beam.
int enough_when_straight(const BeamOptions& o, const std::vector<ShapeSet>& shapes, double length, bool tapers,
                         double part) {
  bool by_trial = o.basis == Basis::loaded && tapers;  // its modes bend at slender places
  for (const Eigen::MatrixXd& given : o.shapes) by_trial = by_trial || given.size() > 0;
  if (by_trial) return gauss_points_by_trial(o, shapes, length);
  int bending = 0, simple = 0;  // most modes of a strain that is integrated twice, and once
  for (int s = 0; s < kStrains; ++s) {
    int& most = is_bending(s) ? bending : simple;
    most = std::max(most, o.modes[s]);
  }
  if (o.basis == Basis::legendre) {
    // degree of a slice's position: deflection n + 1; shortening 2n + 1; alpha, gamma and u n; at order i products of i
    const int linear = std::max(bending + 1, simple), m = std::max(bending, simple);
    const int quadratic = std::max({linear, 2 * bending + 1, bending + simple + 1});
    const int degree = o.order < 2 ? linear : o.order == 2 ? quadratic : 3 * m + 1;
    // The rotation is no polynomial: in space these points resolve, to 1e-10, a whole turn of all shapes together, or
    // most of a radian of the highest alone.
    if (o.order == kExact) return plane_of(o.modes, o.order) != Plane::none ? 4 * m + 12 : 6 * m + 12;
    return o.order > 0 && o.rotary_inertia ? std::max(degree, quadratic) + 3 + (bending + simple) / 2 : degree + 1;
  }
  // The integrand holds products of two (order i: 2 i) modes of wave number beta ~ (n - 1/2) pi over the
  // length. n points integrate cos(k X/L) to (e k / 8n)^2n.
  const double beta = kPi * std::max(bending - 0.5, simple - 0.5);
  const int products = o.order == 1 && o.rotary_inertia ? 2 : std::clamp(o.order, 1, 3);
  const double k = 2.0 * products * std::max(beta, 1.9) * part;
  int n = 4;
  while (2.0 * n * std::log(std::exp(1.0) * k / (8.0 * n)) > std::log(1e-12)) ++n;
  return n;
}

int enough_gauss_points(const BeamOptions& o, const std::vector<ShapeSet>& shapes, double length, bool tapers,
                        double part) {
  return enough_when_straight(o, shapes, length, tapers, part) + points_at_rest(o.curvature, length);
}

void check_options(const BeamOptions& o, bool shears) {
  for (int s = 0; s < kStrains; ++s)
    if (o.modes[s] < 0 || o.modes[s] > kMostModes)
      bad_value(std::string("modes.") + kStrainFields[s].name, o.modes[s],
                "must be from 0 to " + std::to_string(kMostModes));
  if (o.order < 0 || o.order > kExact) bad_value("order", o.order, "must be 0, 1, 2, 3 or \"exact\"");
  non_negative("damping_ratio", o.damping_ratio);
  if (o.damping_ratio > 1.0) bad_value("damping_ratio", o.damping_ratio, "2 % is 0.02; is it in per cent?");
  for (double time : o.kelvin_voigt) non_negative("kelvin_voigt", time);
  if (o.gauss_points < 0 || o.gauss_points > 400)
    bad_value("gauss_points", o.gauss_points, "must be from 1 to 400, or 0 to let the basis choose");
  non_negative("basis_tip.mass", o.tip.mass);
  if (!std::isfinite(o.tip.offset)) bad_value("basis_tip.com", o.tip.offset, "must be finite");
  for (double moment : o.tip.inertia) non_negative("basis_tip.inertia", moment);
  bool needs_shear = false;
  for (int s = 0; s < kStrains; ++s) needs_shear = needs_shear || (is_shear(s) && o.modes[s] > 0);
  if (needs_shear && !shears)
    bad_value("shear_modulus", "not given", "torsion and shear need the material's poisson_ratio or shear_modulus");
}

namespace {

void check_damping(const MatrixXd& D, int ne) {
  if (D.rows() != ne || D.cols() != ne)
    bad_value("damping", std::to_string(D.rows()) + " x " + std::to_string(D.cols()),
              "must be a matrix of the beam's " + std::to_string(ne) + " elastic coordinates");
  const double size = D.cwiseAbs().maxCoeff();
  if (!D.allFinite()) bad_value("damping", size, "must be finite");
  if ((D - D.transpose()).cwiseAbs().maxCoeff() > 1e-9 * size)
    bad_value("damping", D.reshaped().transpose(), "must be symmetric");
  const double least = Eigen::SelfAdjointEigenSolver<MatrixXd>(D, Eigen::EigenvaluesOnly).eigenvalues()[0];
  if (least < -1e-9 * size) bad_value("damping", least, "no eigenvalue may be negative: it would drive the beam");
}

/// Modes 1..n of one strain of the clamped beam with a body on its end, as coefficients of Legendre strains, by Ritz;
/// each scaled so that its largest deflection (or turn) is 1, positive at the end.
template <class Profile>
MatrixXd loaded_modes(const Profile& profile, const BasisTip& tip, int strain, int n, double length) {
  const int terms = 2 * n + 14;  // mode n has up to n/2 waves, and a polynomial takes pi degrees for each, and some
  const ShapeSet ritz(strain, Basis::legendre, terms, length);
  const auto moved = [&](const ShapeValues& v) { return is_bending(strain) ? v.deflection : v.slope; };
  MatrixXd M = MatrixXd::Zero(terms, terms), K = M;
  const GaussRule fine = profile.fine(terms + 16, length);
  const double stiff = profile.at(0.5 * length).rigidity_of(strain);  // any value for a uniform beam
  for (Eigen::Index g = 0; g < fine.points.size(); ++g) {
    const SectionLaw law = profile.at(fine.points[g]);
    const ShapeValues v = ritz.at(fine.points[g]);
    K += fine.weights[g] * (law.rigidity_of(strain) / stiff) * v.strain * v.strain.transpose();
    M += fine.weights[g] * law.modal_inertia(strain) * moved(v) * moved(v).transpose();
  }
  const StrainField& field = kStrainFields[strain];
  const ShapeValues end = ritz.at(length);
  if (is_bending(strain)) {
    const Eigen::VectorXd centre = end.deflection + tip.offset * end.slope;
    M += tip.mass * centre * centre.transpose() + tip.inertia[field.rotation] * end.slope * end.slope.transpose();
  } else {
    M += (field.position < 0 ? tip.inertia[field.rotation] : tip.mass) * end.slope * end.slope.transpose();
  }
  // The largest mu of M x = mu K x, for accurate lowest frequencies.
  const Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd> modes(M, K);
  if (modes.info() != Eigen::Success || !(modes.eigenvalues()[terms - 1] > 0.0))
    bad_value("basis", "loaded", "the clamped beam has no mode: give it, or its basis_tip, a mass");
  MatrixXd shapes = modes.eigenvectors().rowwise().reverse().leftCols(n);
  Eigen::VectorXd largest = Eigen::VectorXd::Zero(n);
  for (int k = 0; k <= 400; ++k)
    largest = largest.cwiseMax((shapes.transpose() * moved(ritz.at(length * k / 400.0))).cwiseAbs());
  const Eigen::VectorXd at_end = shapes.transpose() * moved(end);
  for (int k = 0; k < n; ++k) shapes.col(k) *= (at_end[k] < 0.0 ? -1.0 : 1.0) / largest[k];
  return shapes;
}

/// The same, made once for a uniform beam of any Young's and shear modulus.
template <class Profile>
MatrixXd kept_loaded_modes(const Profile& profile, const BasisTip& tip, int strain, int n, double length) {
  const auto make = [&] { return std::make_shared<const MatrixXd>(loaded_modes(profile, tip, strain, n, length)); };
  if (!profile.uniform) return *make();
  std::string key = std::to_string(strain) + "," + std::to_string(n) + ":";
  for (double x : {length, profile.at(0.0).modal_inertia(strain), tip.mass, tip.offset, tip.inertia[0], tip.inertia[1],
                   tip.inertia[2]})
    append(key, &x, 1);
  static auto& kept = *new Kept<MatrixXd>(std::size_t(1) << 20);
  return *kept.get(key, make, [](const MatrixXd& m) { return static_cast<std::size_t>(8 * m.size()); });
}

/// A profile that is uniform from end to end.
template <class Any>
Along<Any> same(const Any& section) {
  return {[section](double) { return section; }, {}};
}

}  // namespace

Beam::Beam(double length, const Section& section, const Material& material, const BeamOptions& options,
           const std::vector<Patch>& patches)
    : Beam(length, Profile(same(section), true, material), options, patches) {}

Beam::Beam(double length, const SectionMatrix& section, const BeamOptions& options, const std::vector<Patch>& patches)
    : Beam(length, Profile(same(section), true), options, patches) {}

Beam::Beam(double length, const SectionProfile& section, const Material& material, const BeamOptions& options,
           const std::vector<Patch>& patches)
    : Beam(length, Profile(section, false, material), options, patches) {}

Beam::Beam(double length, const SectionMatrixProfile& section, const BeamOptions& options,
           const std::vector<Patch>& patches)
    : Beam(length, Profile(section, false), options, patches) {}

Beam::Beam(double length, const Profile& profile, const BeamOptions& options, const std::vector<Patch>& patches)
    : length_(positive("length", length)), tapers_(!profile.uniform), options_(options) {
  double from = 0.0;
  for (double b : profile.breaks) {
    if (!(b > from && b < length_)) bad_value("section: break", b, "must increase, between 0 and the length");
    from = b;
  }
  for (int s = 0; s < kStrains; ++s)
    if (options_.shapes[s].size() > 0) options_.modes[s] = static_cast<int>(options_.shapes[s].cols());
  check_options(options_, profile.shears);
  if (profile.uniform) check_section(profile.at(0.0), 0.0);
  std::array<MatrixXd, kStrains> loaded;
  for (int s = 0; s < kStrains; ++s)
    if (options_.basis == Basis::loaded && options_.modes[s] > 0 && options_.shapes[s].size() == 0)
      loaded[s] = kept_loaded_modes(profile, options_.tip, s, options_.modes[s], length_);
  take_shapes(loaded);
  plane_ = plane_of(options_.modes, options_.order);
  if (profile.matrices && off_axis(profile)) {
    if (options_.order <= 2 && ne_ > 0)
      bad_value("order", options_.order,
                "must be 3 or \"exact\" where the section's inertia has a centre of mass off the axis or products");
    plane_ = Plane::none;
  }
  if (options_.curvature.size() > 0) curve(&profile);
  unit_ = std::make_shared<const UnitShapes>(unit_shapes(shapes_, first_, options_.order == 2));
  uniform_ = profile.uniform;
  std::vector<MassSlice> slices = build_slices(profile);
  patch_forces_.resize(ne_, static_cast<Eigen::Index>(patches.size()));
  patch_capacitances_.resize(patch_forces_.cols());
  for (Eigen::Index k = 0; k < patch_forces_.cols(); ++k) {
    const Patch& p = patches[static_cast<std::size_t>(k)];
    patch_forces_.col(k) = patch_force(p, &patch_capacitances_[k]);
    if (p.mass && p.at(0.5 * (p.start + p.end)).mass > 0.0) {
      add_patch_slices(p, slices);
      uniform_ = false;
    }
  }
  keep(std::move(slices));
  build_stiffness(profile, patches);
}

void Beam::take_shapes(const std::array<MatrixXd, kStrains>& loaded) {
  for (int s = 0; s < kStrains; ++s) {
    const MatrixXd& given = options_.shapes[s].size() > 0 ? options_.shapes[s] : loaded[s];
    if (given.size() > 0)
      shapes_.emplace_back(s, given, length_);
    else
      shapes_.emplace_back(s, options_.basis, options_.modes[s], length_);
    first_[s] = ne_;
    ne_ += shapes_.back().size();
  }
}

/// Checks that the beam has a stiffness for each of its strains.
void Beam::check_section(const SectionLaw& law, double X) const {
  std::vector<int> rows;
  std::string names;
  for (int s = 0; s < kStrains; ++s) {
    if (options_.modes[s] == 0) continue;
    rows.push_back(kStrainFields[s].strain);
    names += (names.empty() ? "" : ", ") + std::string(kStrainFields[s].name);
  }
  const MatrixXd used = law.rigidity(rows, rows);
  const Eigen::VectorXd size = used.diagonal().cwiseMax(0.0).cwiseSqrt();
  if (rows.empty()) return;
  double least = 0.0;
  if (size.minCoeff() > 0.0) {
    const MatrixXd one = size.cwiseInverse().asDiagonal() * used * size.cwiseInverse().asDiagonal();
    least = Eigen::SelfAdjointEigenSolver<MatrixXd>(one, Eigen::EigenvaluesOnly).eigenvalues()[0];
  }
  if (!(least > 1e-12))
    bad_value("section: stiffness", least,
              "its least eigenvalue at x = " + std::to_string(X) + " m, scaled to a diagonal of ones, of the strains " +
                  names + ": must be positive");
}

void Beam::build_stiffness(const Profile& profile, const std::vector<Patch>& patches) {
  // Elastic forces (Eq. 62) and, for modal damping, the mass of the clamped beam at rest.
  stiffness_ = damping_ = MatrixXd::Zero(ne_, ne_);
  const auto block = [&](int s) {
    return stiffness_.block(first_[s], first_[s], options_.modes[s], options_.modes[s]);
  };
  const SectionLaw at_clamp = profile.at(0.0);
  if (profile.uniform && at_clamp.uncoupled()) {
    const std::shared_ptr<const std::array<MatrixXd, kStrains>> unit = unit_stiffness(*unit_);
    for (int s = 0; s < kStrains; ++s)  // a curvature is one over the length, a shear angle none
      block(s) = at_clamp.rigidity_of(s) *
                 std::pow(length_, (kStrainFields[s].is_curvature() ? -1 : 1) - 2 * unit_->power(s)) *
                 (*unit)[static_cast<std::size_t>(s)];
  } else {
    int most = *std::max_element(options_.modes.begin(), options_.modes.end());
    for (const ShapeSet& s : shapes_) most = std::max(most, static_cast<int>(s.terms()));
    const GaussRule fine = profile.fine(2 * most + 16, length_);
    for (Eigen::Index g = 0; g < fine.points.size(); ++g) {
      const SectionLaw law = profile.at(fine.points[g]);
      if (!profile.uniform) check_section(law, fine.points[g]);
      const StrainMatrix strains = strains_at(fine.points[g]);
      stiffness_ += fine.weights[g] * strains.transpose() * law.rigidity * strains;
    }
  }
  for (const Patch& p : patches)
    if (p.stiffness) stiffness_ += patch_stiffness(p);
  Eigen::VectorXd share(ne_);  // for coupled strains, the geometric mean of their retardation times
  for (int s = 0; s < kStrains; ++s)
    share.segment(first_[s], options_.modes[s]).setConstant(std::sqrt(options_.kelvin_voigt[s]));
  damping_ = share.asDiagonal() * stiffness_ * share.asDiagonal();
  if (options_.damping.size() > 0) {
    check_damping(options_.damping, ne_);
    damping_ += 0.5 * (options_.damping + options_.damping.transpose());
  }
  if (options_.damping_ratio > 0.0 && ne_ > 0) {
    MatrixXd M = MatrixXd::Zero(ne_, ne_);
    for (const MassSlice& s : *slices_) {
      const SliceAtRest at = s.at_rest();
      const MatrixXd Jx = at.J.topRows<3>(), Jt = at.R.transpose() * at.J.bottomRows<3>();
      M += s.mass * Jx.transpose() * Jx + Jt.transpose() * s.inertia * Jt;
    }
    const Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd> modes(stiffness_, M);
    if (modes.info() != Eigen::Success || !modes.eigenvalues().allFinite())
      bad_value("damping_ratio", options_.damping_ratio, "the clamped beam has a mode without inertia");
    const MatrixXd MV = M * modes.eigenvectors();
    const Eigen::VectorXd d = 2.0 * options_.damping_ratio * modes.eigenvalues().cwiseMax(0.0).cwiseSqrt();
    damping_ += MV * d.asDiagonal() * MV.transpose();
  }
}

std::vector<SliceTable> Beam::tables(const std::vector<double>& stations) const {
  std::vector<double> parts;
  for (double X : stations) parts.push_back(X / length_);
  std::vector<SliceTable> out = tables_at(parts);
  for (std::size_t k = 0; k < stations.size(); ++k) out[k].X = stations[k];
  return out;
}

std::vector<SliceTable> Beam::tables_at(const std::vector<double>& parts, bool weights) const {
  const std::shared_ptr<const std::vector<UnitSlice>> unit = unit_slices(*unit_, parts);
  std::array<double, kStrains> shrink;  // of a strain's coordinates to those at length 1
  const auto strain_of = [&](int coordinate) {
    int s = kStrains - 1;
    while (first_[s] > coordinate || options_.modes[s] == 0) --s;
    return s;
  };
  for (int i = 0; i < kStrains; ++i) shrink[i] = std::pow(length_, -unit_->power(i));
  std::vector<SliceTable> out;
  for (std::size_t k = 0; k < parts.size(); ++k) {
    const UnitSlice& at = (*unit)[k];
    SliceTable t;
    t.X = length_ * parts[k];
    t.plane = plane_;
    t.linear = MatrixXd::Zero(6, ne_);
    t.strains = StrainMatrix::Zero(kStrains, ne_);
    for (int i = 0; i < kStrains; ++i) {
      const StrainField& f = kStrainFields[i];
      const ShapeValues& s = at.values[i];
      const auto columns = [&](auto& m, int row) { return m.block(row, first_[i], 1, options_.modes[i]); };
      if (f.position >= 0)
        columns(t.linear, f.position) = length_ * shrink[i] * (f.bending ? s.deflection : s.slope).transpose();
      if (f.rotation >= 0) columns(t.linear, 3 + f.rotation) = f.sign * shrink[i] * s.slope.transpose();
      columns(t.strains, f.strain) =
          f.sign * (f.is_curvature() ? shrink[i] / length_ : shrink[i]) * s.strain.transpose();
    }
    t.products = at.products;
    for (Product& p : t.products) p.C *= (p.row < 3 ? length_ : 1.0) * shrink[strain_of(p.i)] * shrink[strain_of(p.j)];
    t.rest = rest_at(t.X);
    if (weights && options_.order > 2) t.weights = integral_weights(rule_, length_, t.X);
    out.push_back(std::move(t));
  }
  return out;
}

Beam Beam::with_points(int points) const {
  Beam out = *this;
  out.kept_ = MadeOnce();
  out.rule_ = GaussRule(points, length_);
  out.tip_ = out.slice_at(length_);
  std::vector<MassSlice> slices = *slices_;
  for (MassSlice& s : slices) s.table = out.slice_at(s.table.X);
  out.slices_ = std::make_shared<const std::vector<MassSlice>>(std::move(slices));
  return out;
}

SliceTable Beam::slice_at(double X) const {
  if (!(X >= 0.0 && X <= length_))
    bad_value("x", X, "must be on the beam, from 0 to its length, " + std::to_string(length_) + " m");
  return tables({X}).front();
}

}  // namespace flexarm
