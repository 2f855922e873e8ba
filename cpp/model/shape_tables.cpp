#include "shape_tables.hpp"

#include <algorithm>
#include <cmath>

#include "flexarm/quadrature.hpp"

namespace flexarm {

namespace {

using Eigen::MatrixXd;

constexpr Eigen::Index kMostCombined = 48;            // Legendre polynomials that shapes are combined of
constexpr std::size_t kRoom = std::size_t(64) << 20;  // bytes of tables that are kept

/// Running integrals from 0 to X of the products of shape functions that the second-order terms are made of.
struct ProductIntegrals {
  using Table = std::array<std::array<MatrixXd, kStrains>, kStrains>;
  Table slope_slope, slope_strain;  ///< int s_i s_j^T and int s_i e_j^T of slopes s and strains e
  std::array<MatrixXd, 2> nested;   ///< int int alpha v''^T for bending y and z

  explicit ProductIntegrals(const std::array<int, kStrains>& n) {
    for (int i = 0; i < kStrains; ++i)
      for (int j = 0; j < kStrains; ++j) slope_slope[i][j] = slope_strain[i][j] = MatrixXd::Zero(n[i], n[j]);
    for (int t : {bending_y, bending_z}) nested[t] = MatrixXd::Zero(n[torsion], n[t]);
  }

  /// Goes on from X = from to X = to.
  template <class Shapes>
  void advance(double from, double to, const Shapes& shapes_at) {
    const GaussRule rule(24, to - from);
    for (int t : {bending_y, bending_z}) nested[t] += (to - from) * slope_strain[torsion][t];
    for (Eigen::Index g = 0; g < rule.points.size(); ++g) {
      const double w = rule.weights[g], left = to - from - rule.points[g];
      const std::array<ShapeValues, kStrains> s = shapes_at(from + rule.points[g]);
      for (int i = 0; i < kStrains; ++i)
        for (int j = 0; j < kStrains; ++j) {
          slope_slope[i][j] += w * s[i].slope * s[j].slope.transpose();
          slope_strain[i][j] += w * s[i].slope * s[j].strain.transpose();
        }
      for (int t : {bending_y, bending_z}) nested[t] += w * left * s[torsion].slope * s[t].strain.transpose();
    }
  }
};

/// The second-order terms of position (Eq. 24-27 with the shear angles, to total order 2) and of the rotation
/// vector (theta_2 = 1/2 int theta_1 x K), with theta_1 = (alpha, -v3', v2') and K = (alpha', -v3'', v2'').
std::vector<Product> second_order(const ProductIntegrals& I, const std::array<int, kStrains>& first) {
  std::vector<Product> terms;
  const auto add = [&](int row, int i, int j, const MatrixXd& C) {
    if (C.size() > 0) terms.push_back({row, first[i], first[j], C});
  };
  // x1 = X - int (v2'^2 + v3'^2)/2 + v2' gamma2' + v3' gamma3': the shortening
  add(0, bending_y, bending_y, -I.slope_slope[bending_y][bending_y]);
  add(0, bending_z, bending_z, -I.slope_slope[bending_z][bending_z]);
  add(0, bending_y, shear_y, -I.slope_strain[bending_y][shear_y]);
  add(0, bending_z, shear_z, -I.slope_strain[bending_z][shear_z]);
  // x2 = v2 + gamma2 - int (int alpha v3'' + alpha gamma3'),  x3 = v3 + gamma3 + int (int alpha v2'' + alpha
  // gamma2')
  add(1, torsion, bending_z, -I.nested[bending_z]);
  add(1, torsion, shear_z, -I.slope_strain[torsion][shear_z]);
  add(2, torsion, bending_y, I.nested[bending_y]);
  add(2, torsion, shear_y, I.slope_strain[torsion][shear_y]);
  // theta_2 = 1/2 int (v2' v3'' - v3' v2'', v2' alpha' - alpha v2'', v3' alpha' - alpha v3'')
  const auto antisymmetric = [&](int i, int j) -> MatrixXd {
    return 0.5 * (I.slope_strain[i][j] - I.slope_strain[j][i].transpose());
  };
  add(3, bending_y, bending_z, antisymmetric(bending_y, bending_z));
  add(4, bending_y, torsion, antisymmetric(bending_y, torsion));
  add(5, bending_z, torsion, antisymmetric(bending_z, torsion));
  return terms;
}

Eigen::Index most_terms(const std::vector<ShapeSet>& shapes) {
  Eigen::Index most = 0;
  for (const ShapeSet& s : shapes) most = std::max({most, s.terms(), static_cast<Eigen::Index>(s.size())});
  return most;
}

std::vector<UnitSlice> make_slices(const UnitShapes& unit, const std::vector<double>& places) {
  std::array<int, kStrains> n;
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

/// Whether some shapes are combinations of not too many Legendre polynomials, which other beams' shapes are, too.
bool combined(const UnitShapes& unit) {
  Eigen::Index most = 0;
  for (const ShapeSet& s : unit.shapes) most = std::max(most, s.terms());
  return most > 0 && most <= kMostCombined;
}

/// The slices of such shapes from those of the polynomials.
std::vector<UnitSlice> combine(const UnitShapes& unit, const std::vector<double>& places) {
  std::vector<ShapeSet> polynomials;
  std::array<int, kStrains> first;
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
  const bool modes = shapes[static_cast<std::size_t>(strain)].clamped_free();
  if (strain == torsion) return modes ? 0 : -1;    // an angle, or a twist per length
  return modes ? 1 : is_bending(strain) ? -1 : 0;  // a deflection, or a curvature, a shear angle
}

UnitShapes unit_shapes(const std::vector<ShapeSet>& shapes, const std::array<int, kStrains>& first, bool quadratic) {
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
