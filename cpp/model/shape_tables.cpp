#include "shape_tables.hpp"

#include <algorithm>
#include <cmath>

#include "flexarm/quadrature.hpp"
#include "strain_physics.hpp"

namespace flexarm {

namespace {

using Eigen::MatrixXd;

constexpr Eigen::Index kMostCombined = 48;            // Legendre polynomials that shapes are combined of
constexpr std::size_t kRoom = std::size_t(64) << 20;  // bytes of stored tables

Eigen::Index most_terms(const std::vector<ShapeSet>& shapes) {
  Eigen::Index most = 0;
  for (const ShapeSet& s : shapes) most = std::max({most, s.terms(), static_cast<Eigen::Index>(s.size())});
  return most;
}

std::vector<UnitSlice> make_slices(const UnitShapes& unit, const std::vector<double>& places) {
  StrainCounts n;
  for (int i = 0; i < kStrains; ++i) n[i] = unit.shapes[i].size();
  const auto shapes_at = [&](double x) {
    std::array<ShapeValues, kStrains> s;
    for (int i = 0; i < kStrains; ++i) s[i] = unit.shapes[i].at(x);
    return s;
  };
  const double step =
      1.0 / (2.0 + 0.5 * static_cast<double>(most_terms(unit.shapes)));  // the integrals' longest stride
  ProductIntegrals integrals(n);
  std::vector<UnitSlice> out;
  double from = 0.0;
  for (double x : places) {
    if (unit.quadratic && x > from) {
      const int strides = static_cast<int>(std::ceil((x - from) / step));
      for (int k = 0; k < strides; ++k)
        integrals.advance(from + (x - from) * k / strides, from + (x - from) * (k + 1) / strides, shapes_at);
      from = x;
    }
    out.push_back({shapes_at(x), {}});
    if (unit.quadratic) out.back().products = second_order(integrals, unit.first);
  }
  return out;
}

/// Whether shapes are combinations of a few Legendre polynomials, as other beams' shapes are.
bool combined(const UnitShapes& unit) {
  Eigen::Index most = 0;
  for (const ShapeSet& s : unit.shapes) most = std::max(most, s.terms());
  return most > 0 && most <= kMostCombined;
}

/// The slices of such shapes from those of the polynomials.
std::vector<UnitSlice> combine(const UnitShapes& unit, const std::vector<double>& places) {
  std::vector<ShapeSet> polynomials;
  StrainCounts first;
  int n = 0;
  for (int i = 0; i < kStrains; ++i) {
    const ShapeSet& s = unit.shapes[i];
    if (s.terms() > 0)
      polynomials.emplace_back(i, Basis::legendre, static_cast<int>(s.terms()), 1.0);
    else
      polynomials.push_back(s);
    first[i] = n;
    n += polynomials.back().size();
  }
  const auto strain_of = [&](int coordinate) {
    int s = kStrains - 1;
    while (first[s] > coordinate || polynomials[s].size() == 0) --s;
    return s;
  };
  std::vector<UnitSlice> out = *unit_slices(unit_shapes(polynomials, first, unit.quadratic), places);
  for (UnitSlice& slice : out) {
    for (int i = 0; i < kStrains; ++i) {
      const MatrixXd& c = unit.shapes[i].coefficients();
      if (c.size() == 0) continue;
      ShapeValues& v = slice.values[i];
      if (v.deflection.size() > 0) v.deflection = (c.transpose() * v.deflection).eval();
      v.slope = (c.transpose() * v.slope).eval();
      v.strain = (c.transpose() * v.strain).eval();
    }
    for (Product& p : slice.products) {
      const int i = strain_of(p.i), j = strain_of(p.j);
      const MatrixXd &left = unit.shapes[i].coefficients(), &right = unit.shapes[j].coefficients();
      if (left.size() > 0) p.C = (left.transpose() * p.C).eval();
      if (right.size() > 0) p.C = (p.C * right).eval();
      p.i = unit.first[i];
      p.j = unit.first[j];
    }
  }
  return out;
}

std::size_t bytes_of(const std::vector<UnitSlice>& slices) {
  std::size_t numbers = 0;
  for (const UnitSlice& s : slices) {
    for (const ShapeValues& v : s.values)
      numbers += static_cast<std::size_t>(v.deflection.size() + v.slope.size() + v.strain.size());
    for (const Product& p : s.products) numbers += static_cast<std::size_t>(p.C.size()) + 8;
  }
  return 8 * numbers;
}

}  // namespace

void append(std::string& key, const double* x, Eigen::Index n) {
  key.append(reinterpret_cast<const char*>(x), static_cast<std::size_t>(n) * sizeof(double));
}

int UnitShapes::power(int strain) const {
  const StrainField& f = kStrainFields[strain];
  const int motion = f.position < 0 ? 0 : 1;  // of modes, whose coordinates are angles or deflections
  if (shapes[static_cast<std::size_t>(strain)].clamped_free()) return motion;
  return f.is_curvature() ? -1 : 0;  // else they are curvatures, twists per length, shear angles or stretches
}

UnitShapes unit_shapes(const std::vector<ShapeSet>& shapes, const StrainCounts& first, bool quadratic) {
  UnitShapes out{{}, first, quadratic, quadratic ? "2" : "1"};
  for (const ShapeSet& s : shapes) {
    out.shapes.push_back(s.at_length(1.0));
    out.key += s.clamped_free() ? 'c' : 'l';
    out.key += std::to_string(s.size()) + "," + std::to_string(s.terms()) + ":";
    append(out.key, s.coefficients().data(), s.coefficients().size());
  }
  return out;
}

std::shared_ptr<const std::vector<UnitSlice>> unit_slices(const UnitShapes& unit, const std::vector<double>& places) {
  static auto& kept = *new Kept<std::vector<UnitSlice>>(kRoom);
  std::string key = unit.key;
  append(key, places.data(), static_cast<Eigen::Index>(places.size()));
  const auto make = [&] {
    return std::make_shared<const std::vector<UnitSlice>>(combined(unit) ? combine(unit, places)
                                                                         : make_slices(unit, places));
  };
  return kept.get(key, make, bytes_of);
}

std::shared_ptr<const std::array<MatrixXd, kStrains>> unit_stiffness(const UnitShapes& unit) {
  // Never destroyed, as a thread may be building a beam when the process ends.
  static auto& kept = *new Kept<std::array<MatrixXd, kStrains>>(kRoom / 8);
  const auto make = [&] {
    std::array<MatrixXd, kStrains> out;
    for (int s = 0; s < kStrains; ++s) out[s] = MatrixXd::Zero(unit.shapes[s].size(), unit.shapes[s].size());
    const GaussRule fine(2 * static_cast<int>(most_terms(unit.shapes)) + 16);
    for (Eigen::Index g = 0; g < fine.points.size(); ++g)
      for (int s = 0; s < kStrains; ++s) {
        const Eigen::VectorXd e = unit.shapes[s].at(fine.points[g]).strain;
        out[s] += fine.weights[g] * e * e.transpose();
      }
    return std::make_shared<const std::array<MatrixXd, kStrains>>(std::move(out));
  };
  return kept.get(unit.key, make, [](const std::array<MatrixXd, kStrains>& all) {
    std::size_t numbers = 0;
    for (const MatrixXd& m : all) numbers += static_cast<std::size_t>(m.size());
    return 8 * numbers;
  });
}

}  // namespace flexarm
