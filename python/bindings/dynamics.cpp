#include "flexarm/ab.hpp"
#include "flexarm/check.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/derivatives.hpp"
#include "interpreter.hpp"

using namespace flexarm;

namespace {

using Cube = py::array_t<double, py::array::c_style>;

Cube cube(Eigen::Index n, Eigen::Index rows, Eigen::Index columns) { return Cube({n, rows, columns}); }
Eigen::Map<Rows> page(Cube& c, Eigen::Index k) {
  return {c.mutable_data() + k * c.shape(1) * c.shape(2), static_cast<Eigen::Index>(c.shape(1)),
          static_cast<Eigen::Index>(c.shape(2))};
}

/// Loads with their wrenches [f; m], one per row.
struct Loads {
  const std::vector<Load>& places;
  const Rows& wrenches;

  template <class S>
  void set(SweepWorkspace<S>& ws) const {
    for (std::size_t k = 0; k < places.size(); ++k) ws.loads[k].wrench = wrenches.row(static_cast<Eigen::Index>(k));
  }
};

/// Accelerations of a batch. Columns of `a` that are prescribed are inputs.
Rows forward(const Arm& arm, const Rows& q, const Rows& v, const Rows& tau, const std::string& method,
             const std::vector<bool>& prescribed, Rows a, const Loads& loads, Lookout& look) {
  const bool ab = method == "ab";
  if (!ab && method != "ci") bad_value("method", "\"" + method + "\"", "must be \"ab\" or \"ci\"");
  Workspace ws(arm, prescribed, loads.places);
  loads.set(ws);
  for (Eigen::Index k = 0; k < q.rows(); ++k) {
    look();
    ws.a = a.row(k);
    const Status status = ab ? forward_dynamics(arm, ws, q.row(k), v.row(k), tau.row(k))
                             : forward_dynamics_ci(arm, ws, q.row(k), v.row(k), tau.row(k));
    if (status == Status::singular)
      bad_value("mass matrix at q", q.row(k),
                "is not positive definite in double precision (at order 0: deflected beyond what its cut kinetic "
                "energy allows)");
    if (status != Status::ok)
      bad_value("accelerations at q", q.row(k), "are not finite; coordinates, rates or forces are too large");
    a.row(k) = ws.a;
  }
  return a;
}

/// Runs visit(row, place) for every row of q, the arm at rest or moving at v. Without the interpreter's lock.
template <class Visit>
void at_slice(const Arm& arm, const Rows& q, const Rows* v, std::size_t link, std::optional<double> x, Workspace& ws,
              const Visit& visit) {
  const PlacedSlice at(arm, link, x);
  Eigen::VectorXd rates = Eigen::VectorXd::Zero(arm.nv());
  Lookout look;
  const Unlocked free;
  for (Eigen::Index k = 0; k < q.rows(); ++k) {
    look();
    if (v) rates = v->row(k);
    move_arm(arm, ws, q.row(k), rates);
    visit(k, at);
  }
}

/// Forces and accelerations.
void bind_forces(py::class_<Arm>& arm) {
  arm.def(
      "forward_dynamics",
      [](const Arm& self, const Rows& q, const Rows& v, const Rows& tau, const std::string& method,
         const std::vector<bool>& prescribed, const Rows& a, const std::vector<Load>& loads, const Rows& wrenches) {
        Lookout look;  // while the thread has the lock
        const Unlocked free;
        return forward(self, q, v, tau, method, prescribed, a, {loads, wrenches}, look);
      },
      py::arg("q"), py::arg("v"), py::arg("tau"), py::arg("method"), py::arg("prescribed"), py::arg("a"),
      py::arg("loads") = std::vector<Load>{}, py::arg("wrenches") = Rows(0, 6));

  arm.def(
      "inverse_dynamics",
      [](const Arm& self, const Rows& q, const Rows& v, const Rows& a, const std::vector<Load>& loads,
         const Rows& wrenches) {
        Lookout look;
        const Unlocked free;
        SweepWorkspace<double> ws(self, loads);
        Loads{loads, wrenches}.set(ws);
        Rows tau(v.rows(), v.cols());
        for (Eigen::Index k = 0; k < q.rows(); ++k) {
          look();
          inverse_dynamics<double>(self, ws, q.row(k), v.row(k), a.row(k));
          tau.row(k) = ws.tau;
        }
        return tau;
      },
      py::arg("q"), py::arg("v"), py::arg("a"), py::arg("loads") = std::vector<Load>{},
      py::arg("wrenches") = Rows(0, 6));

  arm.def(
      "joint_reaction",
      [](const Arm& self, const Rows& q, const Rows& v, const Rows& a, std::size_t link, bool inboard,
         const std::vector<Load>& loads, const Rows& wrenches) {
        Lookout look;
        const Unlocked free;
        SweepWorkspace<double> ws(self, loads);
        Loads{loads, wrenches}.set(ws);
        Rows out(q.rows(), 6);
        for (Eigen::Index k = 0; k < q.rows(); ++k) {
          look();
          inverse_dynamics<double>(self, ws, q.row(k), v.row(k), a.row(k));
          const LinkState<double>& s = ws.links[link];
          Phi<double> joint;
          if (inboard) {
            joint.R = s.joint.R;
            joint.r = s.joint.p;
          }
          out.row(k) = joint.inward(s.F);
        }
        return out;
      },
      py::arg("q"), py::arg("v"), py::arg("a"), py::arg("link"), py::arg("inboard"),
      py::arg("loads") = std::vector<Load>{}, py::arg("wrenches") = Rows(0, 6));

  arm.def(
      "inverse_derivatives",
      [](const Arm& self, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a,
         const std::vector<Load>& loads, const Rows& wrenches, bool by_v) {
        InverseDerivatives d(self, loads);
        {
          const Unlocked free;
          for (std::size_t k = 0; k < loads.size(); ++k) d.set_wrench(k, wrenches.row(static_cast<Eigen::Index>(k)));
          d(self, q, v, a, by_v);
        }
        return py::make_tuple(Rows(d.dq), Rows(d.dv));
      },
      py::arg("q"), py::arg("v"), py::arg("a"), py::arg("loads") = std::vector<Load>{},
      py::arg("wrenches") = Rows(0, 6), py::arg("by_v") = true);

  arm.def(
      "mass_matrix",
      [](const Arm& self, const Rows& q) {
        Cube out = cube(q.rows(), self.nv(), self.nv());
        Lookout look;
        const Unlocked free;
        Workspace ws(self);
        const Eigen::VectorXd zero = Eigen::VectorXd::Zero(self.nv());
        for (Eigen::Index k = 0; k < q.rows(); ++k) {
          look();
          move_arm<double>(self, ws, q.row(k), zero);
          composite_mass_matrix(self, ws);
          page(out, k) = ws.M;
        }
        return out;
      },
      py::arg("q"));
}

/// How sections move.
void bind_motion(py::class_<Arm>& arm) {
  arm.def(
      "rates",
      [](const Arm& self, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
        Eigen::VectorXd dq(self.nq());
        Eigen::MatrixXd by_q(self.nq(), self.nq()), by_v(self.nq(), self.nv());
        coordinate_rates(self, q, v, dq);
        coordinate_rate_jacobians(self, q, v, by_q, by_v);
        return py::make_tuple(dq, Rows(by_q), Rows(by_v));
      },
      py::arg("q"), py::arg("v"));

  arm.def(
      "frame",
      [](const Arm& self, const Rows& q, std::size_t link, std::optional<double> x) {
        Rows p(q.rows(), 3);
        Cube R = cube(q.rows(), 3, 3);
        Workspace ws(self);
        at_slice(self, q, nullptr, link, x, ws, [&](Eigen::Index k, const PlacedSlice& at) {
          const Pose<double> pose = slice_pose(ws, at);
          p.row(k) = pose.p;
          page(R, k) = pose.R;
        });
        return py::make_tuple(p, R);
      },
      py::arg("q"), py::arg("link"), py::arg("x"));

  arm.def(
      "jacobian",
      [](const Arm& self, const Rows& q, std::size_t link, std::optional<double> x) {
        Cube J = cube(q.rows(), 6, self.nv());
        Workspace ws(self);
        Mat6X<double> one(6, self.nv());
        at_slice(self, q, nullptr, link, x, ws, [&](Eigen::Index k, const PlacedSlice& at) {
          slice_jacobian(self, ws, at, one);
          page(J, k) = one;
        });
        return J;
      },
      py::arg("q"), py::arg("link"), py::arg("x"));

  arm.def(
      "slice_motion",
      [](const Arm& self, const Rows& q, const Rows& v, const Rows& a, std::size_t link, std::optional<double> x) {
        Rows velocity(q.rows(), 6), acceleration(q.rows(), 6);
        Workspace ws(self);
        at_slice(self, q, &v, link, x, ws, [&](Eigen::Index k, const PlacedSlice& at) {
          accelerate_arm(self, ws, a.row(k));
          const SliceMotion<double> m = slice_motion(self, ws, at);
          velocity.row(k) = m.velocity;
          acceleration.row(k) = m.acceleration;
        });
        return py::make_tuple(velocity, acceleration);
      },
      py::arg("q"), py::arg("v"), py::arg("a"), py::arg("link"), py::arg("x"));

  arm.def(
      "motion_derivatives",
      [](const Arm& self, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a,
         std::size_t link, std::optional<double> x) {
        MotionDerivatives d(self, link, x);
        {
          const Unlocked free;
          d(self, q, v, a);
        }
        return py::make_tuple(Rows(d.dq), Rows(d.dv));
      },
      py::arg("q"), py::arg("v"), py::arg("a"), py::arg("link"), py::arg("x"));

  arm.def(
      "jacobian_rate",
      [](const Arm& self, const Rows& q, const Rows& v, std::size_t link, std::optional<double> x) {
        Cube out = cube(q.rows(), 6, self.nv());
        MotionDerivatives d(self, link, x);
        Lookout look;
        const Unlocked free;
        for (Eigen::Index k = 0; k < q.rows(); ++k) {
          look();
          page(out, k) = d.jacobian_rate(self, q.row(k), v.row(k));
        }
        return out;
      },
      py::arg("q"), py::arg("v"), py::arg("link"), py::arg("x"));
}

/// Of the whole arm, and of its beams.
void bind_sums(py::class_<Arm>& arm) {
  arm.def(
      "energy",
      [](const Arm& self, const Rows& q, const Rows& v) {
        Lookout look;
        const Unlocked free;
        Workspace ws(self);
        Rows out(q.rows(), 2);
        for (Eigen::Index k = 0; k < q.rows(); ++k) {
          look();
          const Energy e = energy(self, ws, q.row(k), v.row(k));
          out.row(k) << e.kinetic, e.potential;
        }
        return out;
      },
      py::arg("q"), py::arg("v"));

  arm.def(
      "momentum",
      [](const Arm& self, const Rows& q, const Rows& v) {
        Rows out(q.rows(), 6), centre(q.rows(), 3);
        Workspace ws(self);
        Lookout look;
        {
          const Unlocked free;
          for (Eigen::Index k = 0; k < q.rows(); ++k) {
            look();
            const Momentum m = momentum(self, ws, q.row(k), v.row(k));
            out.row(k) = m.momentum;
            centre.row(k) = m.centre_of_mass;
          }
        }
        return py::make_tuple(out, centre);
      },
      py::arg("q"), py::arg("v"));

  arm.def(
      "deflection",
      [](const Arm& self, const Rows& q, std::size_t link, double x) {
        Rows u(q.rows(), 3);
        Workspace ws(self);
        const Eigen::Vector3d rest = self.link(link).hub().end + x * Eigen::Vector3d::UnitX();
        at_slice(self, q, nullptr, link, x, ws,
                 [&](Eigen::Index k, const PlacedSlice& at) { u.row(k) = slice_in_link(ws, at).p - rest; });
        return u;
      },
      py::arg("q"), py::arg("link"), py::arg("x"));

  arm.def(
      "strain",
      [](const Arm& self, const Rows& q, std::size_t link, double x) {
        const Link& l = self.link(link);
        if (!l.beam()) bad_value("link", link, "has no beam, so no strain");
        const SliceTable table = l.beam()->slice_at(x);
        return Rows(q.middleCols(self.first_q(link) + l.joint().nq(), l.ne()) * table.strains.transpose());
      },
      py::arg("q"), py::arg("link"), py::arg("x"));
}

}  // namespace

void bind_dynamics(py::class_<Arm>& arm) {
  bind_forces(arm);
  bind_motion(arm);
  bind_sums(arm);
}
