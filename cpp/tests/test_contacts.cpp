// Contacts of every instruction set, against their law written once more, and virtual work in the oracle.
#include "batches.hpp"
#include "flexarm/derivatives.hpp"
#include "flexarm/kinematics.hpp"
#include "kernels.hpp"

namespace test_contacts {
using namespace flexarm;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using P = Strut::Point;

namespace {

struct Body {
  Vector3d r = Vector3d::Zero();
  Matrix3d R = Matrix3d::Identity();
  Vec6<double> u = Vec6<double>::Zero();
  Vector3d rate(const Vector3d& at) const { return u.head<3>() + Vector3d(u.tail<3>()).cross(Vector3d(at - r)); }
};

/// What is known of a contact: its force on the arm, and where.
struct Known {
  double gap, rate, push;
  Vector3d at, force;
};

Vector3d shortened(const Vector3d& x, double most) { return x.norm() > most ? Vector3d(most / x.norm() * x) : x; }

/// @param before  the frame on the arm as the surface saw it, and the bristles in its axes
Known law(const Contact& c, const Body& arm, const Body& on, const Body* before = nullptr,
          const Vector3d& bent = Vector3d::Zero()) {
  const Matrix3d axes = on.R * c.against.axes;
  const Vector3d origin = on.r + on.R * c.against.at.offset, centre = arm.r + arm.R * c.point.offset;
  const Vector3d y = axes.transpose() * (centre - origin);
  Known out{};
  Vector3d n = Vector3d::UnitZ();
  if (c.against.kind == Surface::plane) {
    out.gap = y.z() - c.radius;
  } else if (c.against.kind == Surface::sphere) {
    n = y.normalized();
    out.gap = y.norm() - c.against.size[0] - c.radius;
  } else {
    const Vector3d half = 0.5 * c.against.size, nearest = y.cwiseMin(half).cwiseMax(-half);
    n = (y - nearest).normalized();
    out.gap = (y - nearest).norm() - c.radius;
  }
  const Vector3d touch = y - c.radius * n;
  out.at = origin + axes * touch;
  const Vector3d u = axes.transpose() * (arm.rate(out.at) - on.rate(out.at));
  out.rate = n.dot(u);
  const double depth = std::max(0.0, -out.gap);
  out.push = std::max(0.0, c.stiffness * std::pow(depth, c.exponent) * (1.0 - c.damping * out.rate));
  const Matrix3d along = Matrix3d::Identity() - n * n.transpose();
  Vector3d moved = Vector3d::Zero();
  if (before) {
    const Eigen::AngleAxisd turn(axes.transpose() * arm.R * before->R.transpose());
    moved = bent + y - before->r - before->R * c.point.offset - c.radius * turn.angle() * turn.axis().cross(n);
  }
  const Vector3d spring = shortened(along * moved, c.coulomb * out.push / c.tangential_stiffness);
  const Vector3d drag =
      shortened(c.tangential_stiffness * spring + c.damping * out.push * along * u, c.coulomb * out.push);
  out.force = axes * (out.push * n - drag);
  return out;
}

/// The arm touching surfaces of each kind, of the world and of a link; where it stands at q.
Arm touching(const Arm& base, const oracle::Oracle& truth, const Eigen::VectorXd& q, double exponent,
             double coulomb = 0.4, double radius = 0.03) {
  std::vector<Contact> contacts;
  const int last = static_cast<int>(base.size()) - 1;
  Matrix3d turned;
  turned = Eigen::AngleAxisd(0.4, Vector3d(1, 2, 2) / 3.0);
  const auto add = [&](const P& point, const P& on, Surface::Kind kind, const Vector3d& size) {
    Contact c{point, radius, {kind, on, turned, size}, exponent == 1.0 ? 2e3 : 2e4, exponent, 0.1, coulomb, 3e3};
    const auto place = [&](const P& p) {
      const SliceTable none{};
      return p.link < 0 ? oracle::Pose{Vector3d::Zero(), Matrix3d::Identity()}
                        : truth.pose(static_cast<std::size_t>(p.link), nullptr, q);
    };
    const oracle::Pose a = place(point), b = place(on);
    const Vector3d centre = a.p + a.R * point.offset, n = b.R * turned.col(2);
    const double out = kind == Surface::plane ? 0.0 : kind == Surface::sphere ? size[0] : 0.5 * size[2];
    c.against.at.offset = b.R.transpose() * (centre - (out + 0.02) * n - b.p);
    contacts.push_back(c);
  };
  add({last, P::end, 0.0, {0.05, 0.02, 0.01}}, {-1, P::end, 0.0, {}}, Surface::plane, {0, 0, 0});
  add({last, P::end, 0.0, {0, 0, 0}}, {-1, P::end, 0.0, {}}, Surface::sphere, {0.2, 0, 0});
  add({0, P::end, 0.0, {0, 0.03, 0}}, {-1, P::end, 0.0, {}}, Surface::box, {0.3, 0.4, 0.2});
  if (last > 0) add({last, P::end, 0.0, {0, 0, 0.02}}, {0, P::end, 0.0, {}}, Surface::sphere, {0.1, 0, 0});
  return Arm(base.links(), base.gravity(), base.seats(), {}, contacts);
}

}  // namespace

TEST_CASE("forces of contacts, their derivatives, and what runs remember") {
  for (const double exponent : {1.0, 1.5})
    for (const Arm& base : {flexarm_test::flat({0, 0, 1}, {2, 0, 0, 0, 0}, 2, 0.02), flexarm_test::flat_tree(kExact),
                            flexarm_test::spatial_arm(3), flexarm_test::floating_arm()}) {
      Eigen::VectorXd q, v, a = flexarm_test::wave(base.nv(), 0.2, 1.0), tau(base.nv());
      flexarm_test::place(base, 0.4, q, v);
      const Arm arm = touching(base, oracle::Oracle(base), q, exponent);
      const std::size_t n = arm.contacts().size();
      std::vector<Load> loads;  // of both sides of each
      for (const Contact& c : arm.contacts())
        for (const int link : {c.point.link, std::max(0, c.against.at.link)})
          loads.push_back(Load::at_end(base, static_cast<std::size_t>(link), true));
      oracle::Oracle truth(base, {}, loads);
      const auto body = [&](int link) {
        Body out;
        if (link < 0) return out;
        const oracle::Pose pose = truth.pose(static_cast<std::size_t>(link), nullptr, q);
        return Body{pose.p, pose.R, truth.jacobian(static_cast<std::size_t>(link), nullptr, q) * v};
      };
      // a past: where the arm was as each surface saw it, and its bristles
      std::vector<double> past;
      for (const bool remembers : {false, true}) {
        std::vector<double> expected_forces;
        for (std::size_t k = 0; k < n; ++k) {
          const Contact& c = arm.contacts()[k];
          const Body on = body(c.against.at.link), on_arm = body(c.point.link);
          const Matrix3d axes = on.R * c.against.axes;
          Body before;
          Matrix3d turn;
          turn = Eigen::AngleAxisd(0.01 * static_cast<double>(k + 1), Vector3d(2, -1, 2) / 3.0);
          before.R = turn * axes.transpose() * on_arm.R;
          before.r = axes.transpose() * (on_arm.r - on.r - on.R * c.against.at.offset) + Vector3d(0.002, -0.001, 0.003);
          const Vector3d bent(1e-3, (k % 2 ? 1e-4 : -2e-3), 5e-4);
          const Known known = law(c, on_arm, on, remembers ? &before : nullptr, bent);
          REQUIRE(known.push > 0.0);
          for (const double x : {known.force.x(), known.force.y(), known.force.z()}) expected_forces.push_back(x);
          if (!remembers) {
            past.push_back(1.0);
            past.insert(past.end(), bent.data(), bent.data() + 3);
            const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> R = before.R;
            past.insert(past.end(), R.data(), R.data() + 9);
            past.insert(past.end(), before.r.data(), before.r.data() + 3);
            past.insert(past.end(), {0.0, 0.0});
          }
          truth.wrenches[2 * k] << known.force, (known.at - on_arm.r).cross(known.force);
          truth.wrenches[2 * k + 1].setZero();
          if (c.against.at.link >= 0) truth.wrenches[2 * k + 1] << -known.force, -(known.at - on.r).cross(known.force);
          Workspace ws(arm);
          Eigen::Matrix3Xd motion;
          contact_motion(arm, ws, q, v, motion);
          CHECK((motion.col(static_cast<Eigen::Index>(k)) - Vector3d(known.gap, known.rate, known.push)).norm() <
                1e-10 * known.push);
        }
        const Eigen::VectorXd expected = truth.inverse(q, v, a);
        const Eigen::Map<const Eigen::VectorXd> right(expected_forces.data(), static_cast<Eigen::Index>(3 * n));
        for (const lanes::Kernels* kernels : flexarm_test::all_kernels()) {
          CAPTURE(std::string(kernels->name));
          flexarm_test::OnKernels on(arm, *kernels, {}, {});
          void* self = on.memory.get();
          if (remembers) kernels->recall(self, past.data());
          const auto forces = [&](const Eigen::VectorXd& at_q, const Eigen::VectorXd& at_v) {
            kernels->inverse(self, at_q.data(), at_v.data(), a.data(), tau.data());
            return Eigen::VectorXd(tau);
          };
          CHECK((forces(q, v) - expected).norm() < 1e-10 * expected.norm());
          Eigen::VectorXd found(3 * n);
          kernels->contacts(self, nullptr, found.data());
          CHECK((found - right).norm() < 1e-9 * right.norm());
          Eigen::VectorXd x = a;
          CHECK(kernels->forward(self, q.data(), v.data(), expected.data(), x.data()) == lanes::Outcome::good);
          CHECK((x - a).norm() < 1e-6 * a.norm());
          kernels->move(self, q.data(), v.data());
          const lanes::KernelArm& known = lanes::KernelArm::of(arm);
          const lanes::KernelArm grouped = known.grouped(kernels->width, {});
          const lanes::SlopesOf of{known.layout(), grouped.layout(), known.numbers().data(), grouped.numbers().data(),
                                   remembers ? past.data() : nullptr};
          const lanes::Memory memory(kernels->slopes_memory(of));
          const int nq = arm.nq(), nv = arm.nv();
          Eigen::MatrixXd slopes(nv, nq + nv), differences(nv, nq + nv);
          kernels->inverse_slopes(of, memory.get(), nullptr, q.data(), v.data(), a.data(), slopes.data(),
                                  slopes.data() + nv * nq, nullptr);
          if (!remembers) {  // else differences begin anew wherever they are
            std::vector<double> here(past.size());
            kernels->contacts(self, here.data(), nullptr);
            kernels->recall(self, here.data());
          }
          for (int k = 0; k < nq; ++k)
            differences.col(k) = flexarm_test::slope([&](const Eigen::VectorXd& at) { return forces(at, v); }, q,
                                                     Eigen::VectorXd::Unit(nq, k), 1e-5);
          for (int k = 0; k < nv; ++k)
            differences.col(nq + k) = flexarm_test::slope([&](const Eigen::VectorXd& at) { return forces(q, at); }, v,
                                                          Eigen::VectorXd::Unit(nv, k), 1e-4);
          CHECK((slopes - differences).norm() < 1e-6 * differences.norm());
        }
      }
    }
}

TEST_CASE("at the end of a step in which a contact touches or lets go, the mean force does the spring's work") {
  const Arm base = flexarm_test::spatial_arm(2);
  Eigen::VectorXd q, v, x(base.nv());
  flexarm_test::place(base, 0.4, q, v);
  for (const double exponent : {1.0, 1.5})
    for (const bool touches : {true, false}) {
      const Arm arm = touching(base, oracle::Oracle(base), q, exponent, 0.0, touches ? 0.03 : 0.015);
      const auto n = static_cast<Eigen::Index>(arm.contacts().size());
      Workspace ws(arm);
      Eigen::Matrix3Xd motion;
      contact_motion(arm, ws, q, v, motion);
      for (const lanes::Kernels* kernels : flexarm_test::all_kernels())
        for (const double by_end : {0.5, 0.8}) {
          flexarm_test::OnKernels on(arm, *kernels, {}, {});
          void* self = on.memory.get();
          std::vector<double> past(static_cast<std::size_t>(n) * lanes::kRemembered);
          Eigen::Matrix3Xd instant(3, n), step(3, n);
          kernels->move(self, q.data(), v.data());
          kernels->contacts(self, past.data(), instant.data());
          const double before = touches ? 0.004 : -0.004, push = touches ? 0.0 : 7.0;
          for (Eigen::Index k = 1; k <= n; ++k) {
            past[static_cast<std::size_t>(k * lanes::kRemembered - 2)] = before;
            past[static_cast<std::size_t>(k * lanes::kRemembered - 1)] = push;
          }
          kernels->recall(self, past.data());
          kernels->step_contacts(self, by_end);
          kernels->move(self, q.data(), v.data());
          kernels->contacts(self, nullptr, step.data());
          CHECK(kernels->met(self));
          for (Eigen::Index k = 0; k < n; ++k) {  // of the potential f d / (exponent + 1), over the way of the gap
            const double gap = motion(0, k), depth = touches ? -gap : -before;
            REQUIRE(gap * before < 0.0);
            const double mean = (touches ? instant.col(k).norm() : push) * depth / (exponent + 1.0) /
                                (std::abs(gap) + std::abs(before));
            CHECK(step.col(k).norm() ==
                  doctest::Approx(std::abs(mean - (1.0 - by_end) * push) / by_end).epsilon(1e-12));
          }
          // slopes of a step, by those of M + h C + h^2 K
          const lanes::Shift shift{1e-3, 1e-6};
          double twice = 0.0;
          Eigen::MatrixXd S(base.nv(), base.nv());
          REQUIRE(kernels->factor(self, shift, v.data(), &twice) == lanes::Outcome::good);
          Eigen::MatrixXd inverse(base.nv(), base.nv());
          for (Eigen::Index i = 0; i < base.nv(); ++i) {
            const Eigen::VectorXd unit = Eigen::VectorXd::Unit(base.nv(), i);
            kernels->solve(self, unit.data(), inverse.col(i).data());
          }
          S = inverse.inverse();
          flexarm_test::OnKernels without(base, *kernels, {}, {});
          kernels->move(without.memory.get(), q.data(), v.data());
          REQUIRE(kernels->factor(without.memory.get(), shift, v.data(), &twice) == lanes::Outcome::good);
          for (Eigen::Index i = 0; i < base.nv(); ++i) {
            const Eigen::VectorXd unit = Eigen::VectorXd::Unit(base.nv(), i);
            kernels->solve(without.memory.get(), unit.data(), inverse.col(i).data());
          }
          S -= inverse.inverse();
          const auto needed = [&](const Eigen::VectorXd& u) {  // of contacts, where all moves by u in the shift's time
            Eigen::VectorXd at_q = q, at_v = v + shift.damping * u, with(base.nv()), bare(base.nv());
            displace(base, q, shift.stiffness * u, at_q);
            const Eigen::VectorXd none = Eigen::VectorXd::Zero(base.nv());
            kernels->inverse(self, at_q.data(), at_v.data(), none.data(), with.data());
            kernels->inverse(without.memory.get(), at_q.data(), at_v.data(), none.data(), bare.data());
            return Eigen::VectorXd(with - bare);
          };
          for (Eigen::Index i = 0; i < base.nv(); ++i) {
            const Eigen::VectorXd unit = Eigen::VectorXd::Unit(base.nv(), i);
            const Eigen::VectorXd slope = 0.5 * (needed(unit) - needed(-unit));
            // up to how the directions of the normal and of the arm's parts turn
            CHECK((S.col(i) - slope).norm() < 0.1 * S.norm());
          }
          kernels->step_contacts(self, -1.0);
          kernels->move(self, q.data(), v.data());
          kernels->contacts(self, nullptr, step.data());
          CHECK((step - instant).norm() <= 1e-12 * instant.norm());
        }
    }
}

TEST_CASE("arms that strike a wall in a pack, each as by itself, and as the steps of one arm") {
  const Arm base = flexarm_test::flat({0, 0, 1}, {2, 0, 0, 0, 0}, 2, 0.01);
  Eigen::VectorXd q, v;
  flexarm_test::place(base, 0.3, q, v);
  const oracle::Pose end = oracle::Oracle(base).pose(base.size() - 1, nullptr, base.zero());
  Contact wall{{static_cast<int>(base.size()) - 1, P::end, 0.0, {0, 0, 0}}, 0.0, {}, 1e5, 1.0, 0.0, 0.3, 1e5};
  wall.against.axes << 0, 1, 0, 0, 0, 1, 1, 0, 0;  // normal along y
  wall.against.at = {-1, P::end, 0.0, end.p + Vector3d(0, 1e-4, 0)};
  const Arm arm(base.links(), base.gravity(), base.seats(), {}, {wall});
  constexpr int kScenarios = 7, kSteps = 60;
  Eigen::MatrixXd q0(arm.nq(), kScenarios), v0(arm.nv(), kScenarios);
  for (int b = 0; b < kScenarios; ++b) {
    q0.col(b) = 1e-2 * (1 + b) * q;
    v0.col(b) = 1e-2 * (1 + b) * v;
  }
  for (const auto& [method, h] :
       {std::pair<const char*, double>{"implicit", 1e-4}, {"implicit", 1e-3}, {"rk4", 1e-4}}) {
    CAPTURE(std::string(method));
    CAPTURE(h);
    const auto run = [&, length = h, name = method](bool side_by_side, Eigen::MatrixXd& force) {
      BatchProblem p = flexarm_test::batch_of(std::vector<const Arm*>(kScenarios, &arm), kScenarios, length, kSteps);
      flexarm_test::begin_at(p, q0, v0, 0);
      p.method.name = name;
      p.lanes = side_by_side;
      Eigen::MatrixXd out_q(2 * arm.nq(), kScenarios);
      force.resize(6, kScenarios);
      std::vector<int> status(kScenarios);
      BatchOutput out;
      out.q = out_q.data();
      out.contacts = force.data();
      out.status = status.data();
      run_batch(p, out, 1);
      for (const int s : status) CHECK(s == 0);
      return out_q;
    };
    Eigen::MatrixXd force, alone_force;
    const Eigen::MatrixXd all = run(true, force), alone = run(false, alone_force);
    CHECK(alone.allFinite());
    CHECK(alone_force.cwiseAbs().maxCoeff() > 0.1);
    CHECK((all - alone).cwiseAbs().maxCoeff() < 1e-9 * alone.cwiseAbs().maxCoeff());
    CHECK((force - alone_force).cwiseAbs().maxCoeff() < 1e-6 * alone_force.cwiseAbs().maxCoeff());
  }
}

TEST_CASE("bad contacts") {
  const Arm base = flexarm_test::flat_tree(2);
  const auto make = [&](const Contact& c) { return Arm(base.links(), base.gravity(), base.seats(), {}, {c}); };
  const P a{0, P::end, 0.0, {0, 0, 0}}, w{-1, P::end, 0.0, {0, 0, 0}};
  const Surface plane{Surface::plane, w};
  CHECK_THROWS_WITH_AS(make({w, 0.0, plane, 1e3, 1.0, 0.0, 0.0, 0.0}),
                       "contacts[0].point.link = -1: must be a link, not the world", std::invalid_argument);
  CHECK_THROWS_WITH_AS(make({a, 0.0, plane, 1e3, 2.0, 0.0, 0.0, 0.0}), "contacts[0].exponent = 2: must be 1 or 1.5",
                       std::invalid_argument);
  CHECK_THROWS_AS(make({a, 0.0, plane, 0.0, 1.0, 0.0, 0.0, 0.0}), std::invalid_argument);
  CHECK_THROWS_AS(make({a, 0.0, plane, 1e3, 1.0, 0.0, 0.5, 0.0}), std::invalid_argument);
  CHECK_THROWS_AS(make({a, 0.0, {Surface::box, w}, 1e3, 1.0, 0.0, 0.0, 0.0}), std::invalid_argument);
  CHECK_THROWS_AS(make({a, 0.0, {Surface::plane, w, 2.0 * Matrix3d::Identity()}, 1e3, 1.0, 0.0, 0.0, 0.0}),
                  std::invalid_argument);
}

}  // namespace test_contacts
