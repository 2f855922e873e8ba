// Inertia of a link with everything outward of it: composite (joints held) and articulated (joints free). Both depend
// on positions alone.
#pragma once

#include <Eigen/Cholesky>
#include <vector>

#include "flexarm/link.hpp"

namespace flexarm {

/// What the elimination of one link's coordinates keeps of its inertia (Eq. 94, 96). Columns: the joint's free
/// coordinates, then the elastic ones.
struct ArticulatedInertia {
  std::vector<int> free;                       ///< joint columns that are not prescribed
  Eigen::Matrix<double, 6, Eigen::Dynamic> U;  ///< articulated M H, the six rigid rows
  Eigen::MatrixXd D;                           ///< H^T M H (Eq. 94)
  Eigen::LLT<Eigen::MatrixXd> factor;
  Eigen::MatrixXd W;  ///< L^-1 U^T, with D = L L^T
  bool lone = false;  ///< one free joint coordinate, no elastic one, no inertia, spring or damper of its own

  ArticulatedInertia(std::vector<int> free_columns, int ne);
  /// U and D of a link from its M, to which it adds what the link above leaves (Eq. 96). Of the last link, `above` and
  /// `left` are null.
  void articulate(const Link& link, const LinkState<double>* above, const ArticulatedInertia* left,
                  LinkState<double>& s);
  /// Adds what belongs to joint coordinate k alone to D.
  void add_to_joint(Eigen::Index k, double inertia);
  /// D = L L^T and W. @return whether D is positive definite
  bool factorise();
};

/// Adds Phi_rfr^T Ma Phi_rfr, the inertia Ma of everything from the link above outward, to the M of the link
/// below (Eq. 96), with Phi_rfr = [Phi, Phi_e; 0, 0] (Eq. 85).
void carry_inertia(const LinkState<double>& above, const Mat6<double>& Ma, LinkState<double>& below);

}  // namespace flexarm
