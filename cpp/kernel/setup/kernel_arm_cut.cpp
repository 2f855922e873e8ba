// Set-up of beams of order 0 (beam/cut.hpp): the inertia of a link at rest, and how it changes with its elastic
// coordinates at first.
#include "setup/kernel_arm_builder.hpp"

namespace flexarm {
namespace lanes {

namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::Vector3d;

/// Constants of the kinetic energy.
struct Cut {
  Mass rest;
  Matrix3Xd L, C;            ///< of the momenta, per rate
  std::vector<Matrix3d> dJ;  ///< of J, per coordinate
  MatrixXd Mee;

  explicit Cut(Eigen::Index ne)
      : L(Matrix3Xd::Zero(3, ne)),
        C(L),
        dJ(static_cast<std::size_t>(ne), Matrix3d::Zero()),
        Mee(MatrixXd::Zero(ne, ne)) {}

  /// A body that moves at x by the columns of J, and turns by those of T.
  void add(double m, const Vector3d& x, const Matrix3d& inertia, const Matrix3Xd& J, const Matrix3Xd& T) {
    rest.add(m, x, inertia);
    const Matrix3Xd h = inertia * T;
    L += m * J;
    C += m * tilde(x) * J + h;
    Mee += m * J.transpose() * J + T.transpose() * h;
    for (Eigen::Index k = 0; k < J.cols(); ++k) {
      const Matrix3d xk = tilde(Vector3d(J.col(k))), turn = tilde(Vector3d(T.col(k)));
      dJ[static_cast<std::size_t>(k)] += -m * (xk * tilde(x) + tilde(x) * xk) + turn * inertia - inertia * turn;
    }
  }
};

}  // namespace

void ArmBuilder::add_cut(const Link& link) {
  const Beam& beam = *link.beam();
  find_slices(beam);
  set(node().body, Node::cut);
  const auto place = [&](const SliceTable& t) { return Vector3d(link.hub().end + t.X * Vector3d::UnitX()); };
  Cut cut(beam.ne());
  cut.rest.add(link.hub(), Vector3d::Zero());
  for (const MassSlice& s : beam.slices())
    cut.add(s.mass, place(s.table), s.inertia, s.table.linear.topRows<3>(), s.table.linear.bottomRows<3>());
  const RigidBody& tip = link.tip();
  const Matrix3Xd turned = beam.tip().linear.bottomRows<3>();
  const Matrix3Xd moved = beam.tip().linear.topRows<3>() - tilde(tip.com) * turned;
  const Vector3d at_rest = place(beam.tip()) + tip.com;
  cut.add(tip.mass, at_rest, tip.inertia, moved, turned);

  put(cut.rest);
  in_axes(axes, [&](auto to) {
    put(records::CutTip<decltype(to)>{tip.mass, to.lin(tip.com), to.lin(at_rest)});
    for (Eigen::Index k = 0; k < beam.ne(); ++k)
      put(records::CutCoordinate<decltype(to)>{to.lin(cut.L.col(k)), to.ang(cut.C.col(k)),
                                               to.sym(cut.dJ[static_cast<std::size_t>(k)]),
                                               to.lin(tip.mass * moved.col(k))});
  });
  put_lower(cut.Mee);
  put_stiffness(link);
  begin_end();
  put_end(link);
  begin_points();
  out.layout_.attitudes = true;
}

}  // namespace lanes
}  // namespace flexarm
