#include <algorithm>

#include "evaluation.hpp"
#include "flexarm/ab.hpp"
#include "flexarm/check.hpp"
#include "flexarm/ci.hpp"

using namespace flexarm;

namespace {

/// Loads with their wrenches [f; m], one per row; of several states those of each after the other, or the same for all.
struct Wrenches {
  const std::vector<Load>& places;
  const Vectors& wrenches;

  void set(Workspace& ws, std::size_t state = 0) const {
    for (std::size_t k = 0; k < places.size(); ++k) ws.loads[k].wrench = at(state * places.size() + k);
  }
  /// The same for a receiver that takes them one by one.
  template <class Taker>
  void tell(Taker& taker) const {
    for (std::size_t k = 0; k < places.size(); ++k) taker.set_wrench(k, at(k));
  }
  Vec6<double> at(std::size_t k) const { return rows(wrenches).row(static_cast<Eigen::Index>(k)); }
};

/// @throws ValueError where forward dynamics at q failed
template <class Q>
void check(Status status, const Arm& arm, const Q& q) {
  const bool cut = std::any_of(arm.links().begin(), arm.links().end(), [](const Link& link) {
    return link.beam() && link.beam()->ne() > 0 && link.beam()->options().order == 0;
  });
  if (status == Status::singular)
    bad_value("mass matrix at q", q,
              std::string("is not positive definite in double precision: ") +
                  (cut ? "at order 0 a beam is deflected beyond what its cut kinetic energy allows, or " : "") +
                  "axes of joints line up, or inertias differ by more than 1e15");
  if (status != Status::ok)
    bad_value("accelerations at q", q, "are not finite; coordinates, rates or forces are too large");
}

/// Accelerations for generalised forces; those of some rates are prescribed.
Vectors forward(const PyArm& arm, const Vectors& q, const Vectors& v, const Vectors& tau, const std::string& method,
                const std::map<int, double>& prescribed, const Wrenches& loads) {
  const bool ab = method == "ab";
  if (!ab && method != "ci") bad_value("method", "\"" + method + "\"", "must be \"ab\" or \"ci\"");
  std::vector<bool> given(prescribed.empty() ? 0 : static_cast<std::size_t>(arm.nv()));
  for (const auto& [rate, value] : prescribed) given.at(static_cast<std::size_t>(rate)) = true;
  const auto lent = arm.workspace({std::move(given), loads.places}, !ab);
  Workspace& ws = *lent;
  loads.set(ws);
  Answers out(v, {arm.nv()});
  for_states(arm, count(q), ab ? 1 : 1 + arm.nv() / 8, [&](Eigen::Index k) {
    for (const auto& [rate, value] : prescribed) ws.a[rate] = value;
    const auto qk = rows(q).row(k);
    const Status status = ab ? forward_dynamics(arm, ws, qk, rows(v).row(k), rows(tau).row(k))
                             : forward_dynamics_ci(arm, ws, qk, rows(v).row(k), rows(tau).row(k));
    check(status, arm, qk);
    out[k] = ws.a.transpose();
  });
  return out.all();
}

/// Runs visit(k, workspace, place) for every state, the arm at rest or moving at v, with the slice of `link` at x
/// metres along its beam, or its end.
template <class Visit>
void at_slice(const PyArm& arm, const Vectors& q, const Vectors* v, std::size_t link, std::optional<double> x,
              const Visit& visit) {
  const PlacedSlice at(arm, link, x);
  Eigen::VectorXd rates = Eigen::VectorXd::Zero(arm.nv());
  const auto lent = arm.workspace();
  Workspace& ws = *lent;
  for_states(arm, count(q), 1, [&](Eigen::Index k) {
    if (v) rates = rows(*v).row(k);
    move_arm(arm, ws, rows(q).row(k), rates);
    visit(k, ws, at);
  });
}

/// Forces and accelerations.
void bind_forces(py::class_<PyArm, Arm>& arm) {
  const py::arg_v no_loads = py::arg("loads") = std::vector<Load>{}, no_wrenches = py::arg("wrenches") = Rows(0, 6);
  arm.def("one_state", &PyArm::one_state, py::arg("named"), py::arg("balls"));

  arm.def(
      "forward_dynamics",
      [](const PyArm& self, const Vectors& q, const Vectors& v, const Vectors& tau, const std::string& method,
         const std::map<int, double>& prescribed, const std::vector<Load>& loads,
         const Vectors& wrenches) { return forward(self, q, v, tau, method, prescribed, {loads, wrenches}); },
      py::arg("q"), py::arg("v"), py::arg("tau"), py::arg("method") = "ab",
      py::arg("prescribed") = std::map<int, double>{}, no_loads, no_wrenches);

  arm.def(
      "inverse_dynamics",
      [](const PyArm& self, const Vectors& q, const Vectors& v, const Vectors& a, const std::vector<Load>& loads,
         const Vectors& wrenches) {
        Answers tau(v, {self.nv()});
        const auto lent = self.workspace({{}, loads});
        Workspace& ws = *lent;
        const Wrenches acting{loads, wrenches};
        const bool each = wrenches.ndim() == 3;
        if (each && wrenches.shape(0) != count(q)) bad_value("wrenches", wrenches.shape(0), "must be of each state");
        acting.set(ws);
        for_states(self, count(q), 1, [&](Eigen::Index k) {
          if (each) acting.set(ws, static_cast<std::size_t>(k));
          inverse_dynamics(self, ws, rows(q).row(k), rows(v).row(k), rows(a).row(k));
          tau[k] = ws.tau.transpose();
        });
        return tau.all();
      },
      py::arg("q"), py::arg("v"), py::arg("a"), no_loads, no_wrenches);

  arm.def(
      "joint_reaction",
      [](const PyArm& self, const Vectors& q, const Vectors& v, const Vectors& a, std::size_t link, bool inboard,
         const std::vector<Load>& loads, const Vectors& wrenches) {
        Answers out(q, {6});
        const auto lent = self.lend<JointReactions>({{}, loads}, false);
        JointReactions& reaction = *lent;
        Wrenches{loads, wrenches}.tell(reaction);
        for_states(self, count(q), 1, [&](Eigen::Index k) {
          out[k] = reaction(self, rows(q).row(k), rows(v).row(k), rows(a).row(k), link, inboard).transpose();
        });
        return out.all();
      },
      py::arg("q"), py::arg("v"), py::arg("a"), py::arg("link"), py::arg("inboard"), no_loads, no_wrenches);

  arm.def(
      "inverse_derivatives",
      [](const PyArm& self, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a,
         const std::vector<Load>& places, const Vectors& wrenches, bool by_v, const Eigen::VectorXd& reactions) {
        const auto lent = self.lend<InverseDerivatives>({{}, places}, true);
        InverseDerivatives& d = *lent;
        d.hold(self, reactions);
        Wrenches{places, wrenches}.tell(d);
        for_states(self, 1, self.nv(), [&](Eigen::Index) { d(self, q, v, a, by_v); });
        return py::make_tuple(Rows(d.dq), Rows(d.dv));
      },
      py::arg("q"), py::arg("v"), py::arg("a"), no_loads, no_wrenches, py::arg("by_v") = true,
      py::arg("reactions") = Eigen::VectorXd());

  arm.def(
      "forward_derivatives",
      [](const PyArm& self, const Vectors& q, const Vectors& v, const Vectors& tau, const std::vector<Load>& places,
         const Vectors& wrenches) {
        const int n = self.nv();
        Answers by_q(q, {n, self.nq()}), by_v(q, {n, n}), by_tau(q, {n, n});
        const auto lent = self.lend<ForwardDerivatives>({{}, places}, true);
        ForwardDerivatives& d = *lent;
        Wrenches{places, wrenches}.tell(d);
        for_states(self, count(q), n, [&](Eigen::Index k) {
          const auto qk = rows(q).row(k);
          check(d(self, qk.transpose(), rows(v).row(k).transpose(), rows(tau).row(k).transpose()), self, qk);
          by_q[k] = d.dq;
          by_v[k] = d.dv;
          by_tau[k] = d.dtau;
        });
        return py::make_tuple(by_q.all(), by_v.all(), by_tau.all());
      },
      py::arg("q"), py::arg("v"), py::arg("tau"), no_loads, no_wrenches);

  arm.def(
      "mass_matrix",
      [](const PyArm& self, const Vectors& q) {
        Answers out(q, {self.nv(), self.nv()});
        const auto lent = self.workspace({}, true);
        for_states(self, count(q), 1 + self.nv() / 8, [&](Eigen::Index k) {
          composite_mass_matrix(self, *lent, rows(q).row(k));
          out[k] = (*lent).M;
        });
        return out.all();
      },
      py::arg("q"));
}

/// Motion of sections.
void bind_motion(py::class_<PyArm, Arm>& arm) {
  arm.def(
      "rates",
      [](const PyArm& self, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
        Eigen::VectorXd dq(self.nq());
        Eigen::MatrixXd by_q(self.nq(), self.nq()), by_v(self.nq(), self.nv());
        coordinate_rates(self, q, v, dq);
        coordinate_rate_jacobians(self, q, v, by_q, by_v);
        return py::make_tuple(dq, Rows(by_q), Rows(by_v));
      },
      py::arg("q"), py::arg("v"));

  arm.def(
      "frame",
      [](const PyArm& self, const Vectors& q, std::size_t link, std::optional<double> x) {
        Answers p(q, {3}), R(q, {3, 3});
        at_slice(self, q, nullptr, link, x, [&](Eigen::Index k, const Workspace& ws, const PlacedSlice& at) {
          const Pose pose = slice_pose(ws, at);
          p[k] = pose.p.transpose();
          R[k] = pose.R;
        });
        return py::make_tuple(p.all(), R.all());
      },
      py::arg("q"), py::arg("link"), py::arg("x"));

  arm.def(
      "jacobian",
      [](const PyArm& self, const Vectors& q, std::size_t link, std::optional<double> x) {
        Answers J(q, {6, self.nv()});
        Mat6X<double> one(6, self.nv());
        at_slice(self, q, nullptr, link, x, [&](Eigen::Index k, const Workspace& ws, const PlacedSlice& at) {
          slice_jacobian(self, ws, at, one);
          J[k] = one;
        });
        return J.all();
      },
      py::arg("q"), py::arg("link"), py::arg("x"));

  arm.def(
      "slice_motion",
      [](const PyArm& self, const Vectors& q, const Vectors& v, const Vectors& a, std::size_t link,
         std::optional<double> x) {
        Answers velocity(q, {6}), acceleration(q, {6});
        at_slice(self, q, &v, link, x, [&](Eigen::Index k, Workspace& ws, const PlacedSlice& at) {
          accelerate_arm(self, ws, rows(a).row(k));
          const SliceMotion m = slice_motion(self, ws, at);
          velocity[k] = m.velocity.transpose();
          acceleration[k] = m.acceleration.transpose();
        });
        return py::make_tuple(velocity.all(), acceleration.all());
      },
      py::arg("q"), py::arg("v"), py::arg("a"), py::arg("link"), py::arg("x"));

  arm.def(
      "motion_derivatives",
      [](const PyArm& self, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& a,
         std::size_t link, std::optional<double> x) {
        MotionDerivatives d(self, link, x);
        for_states(self, 1, self.nv(), [&](Eigen::Index) { d(self, q, v, a); });
        return py::make_tuple(Rows(d.dq), Rows(d.dv));
      },
      py::arg("q"), py::arg("v"), py::arg("a"), py::arg("link"), py::arg("x"));

  arm.def(
      "jacobian_rate",
      [](const PyArm& self, const Vectors& q, const Vectors& v, std::size_t link, std::optional<double> x) {
        Answers out(q, {6, self.nv()});
        MotionDerivatives d(self, link, x);
        for_states(self, count(q), self.nv(),
                   [&](Eigen::Index k) { out[k] = d.jacobian_rate(self, rows(q).row(k), rows(v).row(k)); });
        return out.all();
      },
      py::arg("q"), py::arg("v"), py::arg("link"), py::arg("x"));
}

/// Of its struts.
void bind_struts(py::class_<PyArm, Arm>& arm) {
  arm.def(
      "strut_motion",
      [](const PyArm& self, const Vectors& q, const Vectors& v, const Vectors& driven) {
        const auto n = static_cast<py::ssize_t>(self.struts().size());
        Answers out(q, {n, 3}), jacobian(q, {n, self.nv()});
        const auto lent = self.workspace();
        StrutMotion m;
        for_states(self, count(q), 1, [&](Eigen::Index k) {
          strut_motion(self, *lent, rows(q).row(k), rows(v).row(k), rows(driven).row(k), m);
          out[k] = m.motion.transpose();
          jacobian[k] = m.jacobian.transpose();
        });
        return py::make_tuple(out.all(), jacobian.all());
      },
      py::arg("q"), py::arg("v"), py::arg("driven"));
}

/// Of its contacts.
void bind_contacts(py::class_<PyArm, Arm>& arm) {
  arm.def(
      "contact_motion",
      [](const PyArm& self, const Vectors& q, const Vectors& v) {
        const auto n = static_cast<py::ssize_t>(self.contacts().size());
        Answers out(q, {n, 3});
        const auto lent = self.workspace();
        Eigen::Matrix3Xd m;
        for_states(self, count(q), 1, [&](Eigen::Index k) {
          contact_motion(self, *lent, rows(q).row(k), rows(v).row(k), m);
          out[k] = m.transpose();
        });
        return out.all();
      },
      py::arg("q"), py::arg("v"));
}

/// Of its loops.
void bind_loops(py::class_<PyArm, Arm>& arm) {
  arm.def_property_readonly("loop_rows", [](const PyArm& self) {
    std::vector<std::tuple<int, bool, bool>> out;
    for (std::size_t k = 0; k < self.loops().size(); ++k) {
      const Loop& loop = self.loops()[k];
      for (const Loop::Row& r : loop.rows())
        out.emplace_back(static_cast<int>(k), r.turns, std::isinf(loop.stiffness_of(r)));
    }
    return out;
  });
  arm.def(
      "loop_motion",
      [](const PyArm& self, const Vectors& q, const Vectors& v) {
        py::ssize_t n = 0;
        for (const Loop& loop : self.loops()) n += static_cast<py::ssize_t>(loop.rows().size());
        Answers out(q, {n, 2});
        const auto lent = self.workspace();
        Eigen::Matrix2Xd m;
        for_states(self, count(q), 1, [&](Eigen::Index k) {
          loop_motion(self, *lent, rows(q).row(k), rows(v).row(k), m);
          out[k] = m.transpose();
        });
        return out.all();
      },
      py::arg("q"), py::arg("v"));
}

/// Of the whole arm, and of its beams.
void bind_sums(py::class_<PyArm, Arm>& arm) {
  arm.def(
      "energy",
      [](const PyArm& self, const Vectors& q, const Vectors& v) {
        Answers out(q, {2});
        const auto lent = self.workspace();
        for_states(self, count(q), 1, [&](Eigen::Index k) {
          const Energy e = energy(self, *lent, rows(q).row(k), rows(v).row(k));
          out[k] << e.kinetic, e.potential;
        });
        return out.all();
      },
      py::arg("q"), py::arg("v"));

  arm.def(
      "momentum",
      [](const PyArm& self, const Vectors& q, const Vectors& v) {
        Answers out(q, {6}), centre(q, {3});
        const auto lent = self.workspace();
        for_states(self, count(q), 1, [&](Eigen::Index k) {
          const Momentum m = momentum(self, *lent, rows(q).row(k), rows(v).row(k));
          out[k] = m.momentum.transpose();
          centre[k] = m.centre_of_mass.transpose();
        });
        return py::make_tuple(out.all(), centre.all());
      },
      py::arg("q"), py::arg("v"));

  arm.def(
      "deflection",
      [](const PyArm& self, const Vectors& q, std::size_t link, double x) {
        Answers u(q, {3});
        const Eigen::Vector3d rest = self.link(link).hub().end + self.link(link).slice_at(x).rest.x;
        at_slice(self, q, nullptr, link, x, [&](Eigen::Index k, const Workspace& ws, const PlacedSlice& at) {
          u[k] = (slice_in_link(ws, at).p - rest).transpose();
        });
        return u.all();
      },
      py::arg("q"), py::arg("link"), py::arg("x"));

  arm.def(
      "strain",
      [](const PyArm& self, const Vectors& q, std::size_t link, double x) {
        const Link& l = self.link(link);
        if (!l.beam()) bad_value("link", link, "has no beam, so no strain");
        const SliceTable table = l.beam()->slice_at(x);
        Answers out(q, {kStrains});
        for (Eigen::Index k = 0; k < count(q); ++k)
          out[k] = rows(q).row(k).segment(self.first_q(link) + l.joint().nq(), l.ne()) * table.strains.transpose();
        return out.all();
      },
      py::arg("q"), py::arg("link"), py::arg("x"));
}

}  // namespace

void bind_dynamics(py::class_<PyArm, Arm>& arm) {
  bind_forces(arm);
  bind_motion(arm);
  bind_struts(arm);
  bind_contacts(arm);
  bind_loops(arm);
  bind_sums(arm);
}
