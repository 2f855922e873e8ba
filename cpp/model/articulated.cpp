#include "flexarm/articulated.hpp"

#include <utility>

namespace flexarm {

ArticulatedInertia::ArticulatedInertia(std::vector<int> free_columns, int ne) : free(std::move(free_columns)) {
  const Eigen::Index width = static_cast<Eigen::Index>(free.size()) + ne;
  U = Eigen::MatrixXd::Zero(6, width);
  W = Eigen::MatrixXd::Zero(width, 6);
  D = Eigen::MatrixXd::Identity(width, width);
  factor.compute(D);
}

void carry_inertia(const LinkState<double>& above, const Mat6<double>& Ma, LinkState<double>& below) {
  below.M.topLeftCorner<6, 6>() += above.phi.inward_inertia(Ma);
  const Eigen::Index ne = above.phi_e.cols();
  for (Eigen::Index k = 0; k < ne; ++k) {
    const Vec6<double> Mk = Ma * above.phi_e.col(k), Fk = above.phi.inward(Mk);
    below.M.block<6, 1>(0, 6 + k) += Fk;
    below.M.block<1, 6>(6 + k, 0) += Fk.transpose();
    for (Eigen::Index i = k; i < ne; ++i) {
      below.M(6 + i, 6 + k) += above.phi_e.col(i).dot(Mk);
      below.M(6 + k, 6 + i) = below.M(6 + i, 6 + k);
    }
  }
}

void ArticulatedInertia::add_to_joint(Eigen::Index k, double inertia) {
  D(k, k) += inertia;
  lone = lone && inertia == 0.0;
}

void ArticulatedInertia::articulate(const Link& link, const LinkState<double>* above, const ArticulatedInertia* left,
                                    LinkState<double>& s) {
  const int ne = link.ne(), nf = static_cast<int>(free.size());
  if (above) {  // what the link above leaves after its elimination, through Phi^T
    Mat6<double> Ma = above->M.topLeftCorner<6, 6>();
    Ma.noalias() -= left->W.transpose() * left->W;
    if (left->lone) {
      // M~ H = 0: nothing is left along the free coordinate of a rigid link, not even rounding, of which a heavy one
      // leaves much
      const Vec6<double> h = above->H.col(left->free[0]).normalized();
      Vec6<double> rest = Ma * h;
      rest -= (0.5 * h.dot(rest)) * h;
      Ma.noalias() -= rest * h.transpose();
      Ma.noalias() -= h * rest.transpose();
    }
    carry_inertia(*above, Ma, s);
  }
  const auto Mrr = s.M.topLeftCorner<6, 6>();
  for (int k = 0; k < nf; ++k) U.col(k).noalias() = Mrr * s.H.col(free[k]);
  U.rightCols(ne) = s.M.topRightCorner(6, ne);
  for (int k = 0; k < nf; ++k)
    for (int i = 0; i < nf + ne; ++i) D(i, k) = D(k, i) = s.H.col(free[k]).dot(U.col(i));
  lone = nf == 1 && ne == 0;
  if (link.joint().passive())
    for (int k = 0; k < nf; ++k) add_to_joint(k, link.joint().forces()[free[k]].reflected_inertia);
  D.bottomRightCorner(ne, ne) = s.M.bottomRightCorner(ne, ne);
}

bool ArticulatedInertia::factorise() {
  factor.compute(D);
  if (factor.info() != Eigen::Success) return false;
  W = U.transpose();
  factor.matrixL().solveInPlace(W);
  return true;
}

}  // namespace flexarm
