#include "strain_physics.hpp"

#include <numeric>

namespace flexarm {

using Eigen::MatrixXd;

bool is_shear(int strain) { return !is_bending(strain) && strain != extension; }

namespace {

/// I_z, I_y, J, kA, kA; A.
double section_form(int strain, const Section& s) {
  if (strain == bending_y) return s.second_moment_z;
  if (strain == bending_z) return s.second_moment_y;
  if (strain == torsion) return s.torsion_constant;
  if (strain == extension) return s.area;
  return (strain == shear_y ? s.shear_correction.y : s.shear_correction.z) * s.area;
}

}  // namespace

SectionLaw::SectionLaw(const Material& material, const Section& s) : mass(material.density * s.area) {
  rigidity.setZero();
  for (int k = 0; k < kStrains; ++k) {
    const int row = kStrainFields[k].strain;
    rigidity(row, row) = (is_shear(k) ? material.shear_modulus : material.youngs_modulus) * section_form(k, s);
  }
  const double iy = s.second_moment_y, iz = s.second_moment_z;
  inertia = material.density * Eigen::Vector3d(iy + iz, iy, iz).asDiagonal().toDenseMatrix();
}

SectionLaw::SectionLaw(const SectionMatrix& s) : mass(s.mass()), com(s.com()), inertia(s.inertia_about_com()) {
  constexpr int row[] = {StrainRow::eps, StrainRow::phi12, StrainRow::phi13,
                         StrainRow::K1,  StrainRow::K2,    StrainRow::K3};
  for (int i = 0; i < kStrains; ++i)
    for (int j = 0; j < kStrains; ++j) rigidity(row[i], row[j]) = 0.5 * (s.stiffness(i, j) + s.stiffness(j, i));
}

double SectionLaw::rigidity_of(int strain) const {
  const int row = kStrainFields[strain].strain;
  return rigidity(row, row);
}

bool SectionLaw::uncoupled() const { return rigidity.isDiagonal(0.0); }

double SectionLaw::modal_inertia(int strain) const {
  const StrainField& f = kStrainFields[strain];
  return f.position < 0 ? inertia(f.rotation, f.rotation) : mass;
}

Plane plane_of(const StrainCounts& modes, int order) {
  const int all = std::accumulate(modes.begin(), modes.end(), order <= 2 ? 0 : -modes[extension]);
  if (all > 0 && modes[bending_y] + modes[shear_y] == all) return Plane::xy;
  if (all > 0 && modes[bending_z] + modes[shear_z] == all) return Plane::xz;
  return Plane::none;
}

ProductIntegrals::ProductIntegrals(const StrainCounts& n) {
  for (int i = 0; i < kStrains; ++i)
    for (int j = 0; j < kStrains; ++j) slope_slope[i][j] = slope_strain[i][j] = MatrixXd::Zero(n[i], n[j]);
  for (int t : {bending_y, bending_z}) nested[t] = MatrixXd::Zero(n[torsion], n[t]);
}

std::vector<Product> second_order(const ProductIntegrals& I, const StrainCounts& first) {
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
  // and, of a slope and a stretch, int v2' u1' and int v3' u1'
  add(1, torsion, bending_z, -I.nested[bending_z]);
  add(1, torsion, shear_z, -I.slope_strain[torsion][shear_z]);
  add(2, torsion, bending_y, I.nested[bending_y]);
  add(2, torsion, shear_y, I.slope_strain[torsion][shear_y]);
  add(1, bending_y, extension, I.slope_strain[bending_y][extension]);
  add(2, bending_z, extension, I.slope_strain[bending_z][extension]);
  // theta_2 = 1/2 int (v2' v3'' - v3' v2'', v2' alpha' - alpha v2'', v3' alpha' - alpha v3'')
  const auto antisymmetric = [&](int i, int j) -> MatrixXd {
    return 0.5 * (I.slope_strain[i][j] - I.slope_strain[j][i].transpose());
  };
  add(3, bending_y, bending_z, antisymmetric(bending_y, bending_z));
  add(4, bending_y, torsion, antisymmetric(bending_y, torsion));
  add(5, bending_z, torsion, antisymmetric(bending_z, torsion));
  return terms;
}

}  // namespace flexarm
