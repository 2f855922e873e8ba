// The elastic beam: shape functions, elastic and damping matrices, and the slices that represent its inertia (Sec. 3).
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "flexarm/made_once.hpp"
#include "flexarm/patch.hpp"
#include "flexarm/quadrature.hpp"
#include "flexarm/section.hpp"
#include "flexarm/shape.hpp"
#include "flexarm/slice.hpp"

namespace flexarm {

/// A slice that carries inertia: a Gauss point of the beam.
struct MassSlice {
  SliceTable table;
  double mass = 0.0;                                  ///< rho A dX (kg)
  Eigen::Vector3d com = Eigen::Vector3d::Zero();      ///< of its centre of mass, in the slice's axes (m)
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();  ///< rho I dX about it (kg m^2); zero without rotary inertia

  /// At rest: of the centre of mass, place, turn of the axes, and [J_T; J_R].
  SliceAtRest at_rest() const;
};

/// The body at the end of the modes of the loaded basis.
struct BasisTip {
  double mass = 0.0;                                  ///< kg
  double offset = 0.0;                                ///< of its centre of mass beyond the beam's end (m)
  Eigen::Vector3d inertia = Eigen::Vector3d::Zero();  ///< about its centre of mass (kg m^2)
};

struct BeamOptions {
  StrainCounts modes{};  ///< shape functions of each strain (shape.hpp)
  Basis basis = Basis::clamped_free;
  /// User-given shapes of a strain, if any, in place of the basis: one column each, coefficients in P_0, P_1, ...
  /// (see ShapeSet); `modes` is then their number.
  std::array<Eigen::MatrixXd, kStrains> shapes{};
  BasisTip tip{};  ///< of the loaded basis
  /// Twist and curvatures at rest, K1, K2, K3 (1/m): a column of coefficients in P_0, P_1, ... for each; empty:
  /// straight.
  Eigen::MatrixXd curvature{};
  int order = 2;               ///< of rotation (Eq. 26): 0 (the paper's simplified model), 1, 2, 3 or kExact
  bool rotary_inertia = true;  ///< of the slices
  double damping_ratio = 0.0;  ///< modal, of every mode of the beam clamped at its base
  /// Of each strain, retardation time (s): stress = E (strain + kelvin_voigt dstrain/dt).
  std::array<double, kStrains> kelvin_voigt{};
  Eigen::MatrixXd damping;  ///< further, of the elastic coordinates (ne x ne); or empty
  int gauss_points = 0;     ///< 0: enough for the basis, see `enough_gauss_points`
};

/// All numbers of a beam after integration of its section and material: the content of its file.
struct BeamNumbers {
  double length = 0.0;
  BeamOptions options{};                         ///< without damping and the loaded basis' tip
  std::array<Eigen::MatrixXd, kStrains> loaded;  ///< shapes of the loaded basis, as `BeamOptions::shapes`
  bool uniform = true;                           ///< whether the section is the same from end to end
  bool planar = true;                            ///< whether all its strains are in one plane
  int points = 0;                                ///< see Beam::points
  /// Where the slices are, in parts of the length: those of the beam, then those of each patch with mass.
  std::vector<std::vector<double>> places;
  std::vector<MassSlice> slices;  ///< without their tables
  Eigen::MatrixXd stiffness, damping, patch_forces;
  Eigen::VectorXd patch_capacitances;
};

struct SectionLaw;
struct UnitShapes;
struct RestShape;

/// Beam along x, clamped to its link's hub at X = 0. Immutable; copies share their tables.
class Beam {
 public:
  /// @throws std::invalid_argument naming the field and the value
  Beam(double length, const Section& section, const Material& material, const BeamOptions& options,
       const std::vector<Patch>& patches = {});
  Beam(double length, const SectionMatrix& section, const BeamOptions& options, const std::vector<Patch>& patches = {});
  /// Tapered.
  Beam(double length, const SectionProfile& section, const Material& material, const BeamOptions& options,
       const std::vector<Patch>& patches = {});
  Beam(double length, const SectionMatrixProfile& section, const BeamOptions& options,
       const std::vector<Patch>& patches = {});
  /// The beam of `numbers`, to the last bit.
  explicit Beam(const BeamNumbers& numbers);
  BeamNumbers numbers() const;

  double length() const { return length_; }
  const BeamOptions& options() const { return options_; }
  int order() const { return options_.order; }
  int ne() const { return ne_; }                          ///< elastic coordinates
  int first(int strain) const { return first_[strain]; }  ///< first coordinate of a strain (Eq. 33)
  double mass() const { return mass_; }

  const Eigen::MatrixXd& stiffness() const { return stiffness_; }  ///< Eq. 62, ne x ne
  const Eigen::MatrixXd& damping() const { return damping_; }      ///< ne x ne
  /// Gauss points over which strains are integrated beyond order 2.
  int points() const { return static_cast<int>(rule_.points.size()); }
  /// The same beam with as many such points, for comparison.
  Beam with_points(int points) const;
  const ShapeSet& shapes(int strain) const { return shapes_[strain]; }
  bool curved() const { return rest_ != nullptr; }  ///< at rest
  /// Whether that turns sections about one axis alone.
  bool curved_about(int axis) const;
  bool damped() const { return !damping_.isZero(0.0); }
  const std::vector<MassSlice>& slices() const { return *slices_; }
  /// A slot for the data that a higher room derives from the beam.
  const MadeOnce& kept() const { return kept_; }
  const SliceTable& tip() const { return tip_; }  ///< the slice at X = L

  /// Generalised forces of the patches per volt (Eq. 61), ne x their number, and their capacitances with the beam's
  /// coordinates held (F).
  const Eigen::MatrixXd& patch_forces() const { return patch_forces_; }
  const Eigen::VectorXd& patch_capacitances() const { return patch_capacitances_; }
  /// The same of a patch that is not part of the beam. @throws std::invalid_argument naming the field and the value
  Eigen::VectorXd patch_force(const Patch& patch, double* capacitance = nullptr) const;

  /// The slice at any X in [0, L]. @throws std::invalid_argument outside
  SliceTable slice_at(double X) const;
  /// The slices at places that increase: in one sweep.
  std::vector<SliceTable> tables(const std::vector<double>& stations) const;
  /// The same at parts of the length, 0 to 1; or without weights.
  std::vector<SliceTable> tables_at(const std::vector<double>& parts, bool weights = true) const;
  /// Whether the slices are those of a section that is the same from end to end.
  bool uniform() const { return uniform_; }
  /// The shape functions at length 1.
  const UnitShapes& unit() const { return *unit_; }

 private:
  /// Section and material along the beam.
  struct Profile;
  Beam(double length, const Profile& profile, const BeamOptions& options, const std::vector<Patch>& patches);
  std::vector<MassSlice> build_slices(const Profile& profile);
  void keep(std::vector<MassSlice> slices);
  bool off_axis(const Profile& profile) const;
  void check_section(const SectionLaw& law, double X) const;
  void build_stiffness(const Profile& profile, const std::vector<Patch>& patches);
  /// @param loaded  of the loaded basis
  void take_shapes(const std::array<Eigen::MatrixXd, kStrains>& loaded);
  /// @param profile  null: is not known
  void curve(const Profile* profile);
  SliceAtRest rest_at(double X) const;
  void check_patch(const Patch& patch) const;
  void add_patch_slices(const Patch& patch, std::vector<MassSlice>& slices);
  Eigen::MatrixXd patch_stiffness(const Patch& patch) const;
  int points_for_strains() const;
  /// Per coordinate (Eq. 28-32).
  StrainMatrix strains_at(double X) const;

  double length_;
  bool uniform_ = true, tapers_ = false;
  BeamOptions options_;
  std::vector<ShapeSet> shapes_;  ///< one for each strain
  std::vector<std::vector<double>> places_;
  Plane plane_ = Plane::none;
  int ne_ = 0;
  StrainCounts first_{};
  double mass_ = 0.0;
  Eigen::MatrixXd stiffness_, damping_, patch_forces_;
  Eigen::VectorXd patch_capacitances_;
  SliceTable tip_;
  // large data are shared by copies: a chain of equal beams reads one table, which stays in the processor's cache
  std::shared_ptr<const std::vector<MassSlice>> slices_;
  MadeOnce kept_;
  std::shared_ptr<const UnitShapes> unit_;
  std::shared_ptr<const RestShape> rest_;  ///< of a curved beam
  GaussRule rule_{1};                      ///< of the points, and of the slices of a uniform beam
};

/// Gauss points that integrate the inertia of the beam's slices to about 1e-12: exactly for the polynomials of the
/// Legendre basis, from the wave number of the highest mode for clamped-free modes and loaded ones of a beam that
/// does not taper, else by trial. For slices on a part of the length alone, clamped-free modes need fewer.
/// A beam that is curved at rest needs more.
int enough_gauss_points(const BeamOptions& options, const std::vector<ShapeSet>& shapes, double length, bool tapers,
                        double part = 1.0);

}  // namespace flexarm
