#include <doctest/doctest.h>

#include <cstdint>
#include <cstdio>
#include <fstream>

#include "arms.hpp"
#include "flexarm/computed_torque.hpp"
#include "flexarm/laws.hpp"
#include "flexarm/scene.hpp"
#include "flexarm/simulate.hpp"

namespace test_scene {
using namespace flexarm;
using Eigen::VectorXd;

#ifdef FLEXARM_SCENES

namespace {

using flexarm_test::body;

/// A parabola in two pieces, the second of which goes on with the curvature of the first or its negative.
PiecewisePolynomial pieces(double size, double then = 1.0) {
  const double a = 0.3, b = 1.0 / 3.0, c = 0.01, x = 0.0123;
  Eigen::MatrixXd m(3, 2);
  m << a, then * a, b, 2.0 * a * x + b, c, (a * x + b) * x + c;
  return {Eigen::Vector3d(0.0, x, 0.05), size * m};
}

/// Friction, stops, a spring, and limits of motors; a tapered beam in space, a curved one, one with loaded modes and a
/// patch; drives, loads, and controllers of each kind.
Scene whole() {
  JointForce rough;
  rough.stiffness = 0.3;
  rough.rest = 0.1;
  rough.damping = 0.02;
  rough.coulomb = 0.05;
  rough.stiction = 0.07;
  rough.lower = -0.01;
  rough.limit_stiffness = 40.0;
  rough.torque_limit = 3.0;
  rough.reflected_inertia = 0.01;
  const Eigen::Vector3d y = Eigen::Vector3d::UnitY(), z = Eigen::Vector3d::UnitZ();
  Placement turned;
  turned.position = {0.1, 0.2, 0.3};
  turned.rotation = Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 2).normalized()).toRotationMatrix();
  BeamOptions tapered, curved, loaded;
  tapered.modes = {2, 1, 1, 0, 0, 0};
  tapered.order = 3;
  tapered.damping_ratio = 0.01;
  curved.modes = {1, 1, 0, 0, 0, 0};
  curved.order = kExact;
  curved.basis = Basis::legendre;
  curved.curvature = Eigen::RowVector3d(0.2, 0.0, 1.5);
  loaded.basis = Basis::loaded;
  loaded.modes = {2, 0, 1, 0, 0, 0};
  loaded.tip.mass = 0.2;
  const SectionProfile wedge{[](double x) { return Section::rectangle(0.01 - 0.01 * x, 0.02); }, {0.2}};
  const PatchSection piezo = patch_section({6e10, 0.3, 7800.0, -1.8e-10, -1e-10, 0.0, 3e-8},
                                           {1, true, true, true, 0.2, 0.008, 3e-4, 0.002, 1.0, 1.0});
  const Patch patch{0.05, 0.15, [piezo](double) { return piezo; }};
  std::vector<Link> links;
  links.emplace_back(Joint({{true, z}, {false, {0.6, 0.0, 0.8}}}, false, {"rz", "t"}, {rough, rough}, turned),
                     body(0.5, {0.1, 0, 0}), Beam(0.4, wedge, flexarm_test::steel(), tapered), std::nullopt);
  links.emplace_back(Joint::revolute(Eigen::Vector3d(0.3, 0.2, 0.9)), std::nullopt,
                     Beam(0.3, Section::circle(0.01), flexarm_test::steel(), curved), body(0.2, {0, 0, 0.01}));
  links.emplace_back(Joint::revolute(y), body(0.1, {0, 0, 0}),
                     Beam(0.3, Section::rectangle(0.004, 0.01), flexarm_test::steel(), loaded, {patch}), std::nullopt);
  const Strut spring{{{-1, Strut::Point::end, 0.0, {0.2, 0.1, 0.5}}, {1, Strut::Point::end, 0.0, {0.0, 0.01, 0.0}}},
                     5.0,
                     0.2,
                     0.4,
                     0.1,
                     false};
  const Strut rope{
      {{0, Strut::Point::slice, 0.07}, {0, Strut::Point::end}, {2, Strut::Point::origin, 0.0, {0, 0, 0.1}}},
      3.0,
      0.1,
      0.2,
      -0.3,
      true};
  const Arm arm(links, {0.1, 0.0, -9.81}, {-1, 0, {0, 0.25}}, {spring, rope});
  Scene out{Problem(arm)};
  Problem& p = out.problem;
  const int second = arm.first(1), third = arm.first(2);
  p.q0 = 0.01 * flexarm_test::wave(arm.nq(), 0.1);
  p.v0 = 0.01 * flexarm_test::wave(arm.nv(), 0.4);
  p.tau = flexarm_test::wave(arm.nv(), 0.6);
  p.q0[second] = pieces(1.0)(0.0).q;
  p.v0[second] = pieces(1.0)(0.0).v;
  p.drives.push_back({second, pieces(1.0), {}, pieces(1.0).breaks()});
  p.drives.push_back({0, {}, PolynomialValue{pieces(2.0, -3.0)}, pieces(1.0).breaks()});
  p.drives.push_back({-1, {}, PolynomialValue{pieces(50.0, -1.0)}, pieces(1.0).breaks(), arm.patch_matrix().col(0)});
  const PolynomialWrench wrench{{pieces(1.0), pieces(-2.0), pieces(0.5), pieces(0.1), pieces(0.2), pieces(0.3)}};
  p.loads.push_back({Load::along(arm, 0, 0.1, 0.3, true), wrench, pieces(1.0).breaks()});
  p.loads.push_back({Load::at_slice(arm, 2, 0.123, false), wrench, pieces(1.0).breaks()});
  p.loads.push_back({Load::at_end(arm, 1, true), wrench, pieces(1.0).breaks()});
  p.loads.push_back({Load::on_strut(arm, 1), wrench, pieces(1.0).breaks()});
  p.feedback = {pd(arm, 0, 2.0, 0.1, PolynomialValue{pieces(1.0)}, 0.7), pd(arm, third, 1.0, 0.05)};
  PidGains gains{0.4, 0.9, 0.01};
  gains.tracking_time = 0.1;
  gains.limit = 0.02;
  p.samplers.push_back({0.0, 3e-3, 1e-3, pid(arm, third, gains, 3e-3, PolynomialValue{pieces(-1.0)})});
  std::vector<Link> rigid;
  for (const Link& link : links) rigid.emplace_back(link.joint(), body(0.6, {0.4, 0, 0}), std::nullopt, std::nullopt);
  std::vector<ComputedTorque::Axis> axes;
  for (int k = 0; k < 4; ++k) axes.push_back({k, pieces(0.1), 10.0, 2.0, 0.05});
  p.samplers.push_back({0.0, 5e-3, 0.0,
                        TorqueLaw(std::make_shared<const Arm>(rigid), axes, true,
                                  {{0, 0}, {1, 1}, {third, third}, {third, third}}, arm.nv())});
  ServoGains drive{0.3, 0.02, 0.5, 1e-4, 60.0};
  drive.limit = 0.01;
  p.samplers.push_back({0.0, 4e-3, 2e-3, servo(arm, third, drive, 4e-3, {PolynomialValue{pieces(-0.5)}})});
  out.t = VectorXd::LinSpaced(6, 0.0, 0.05);
  out.method = {"gauss", 1e-9, 0.9, 3};
  out.step = 1e-3;
  return out;
}

/// What a run of it gives by some method.
Eigen::MatrixXd run(const Scene& scene, const std::string& name) {
  Method method = scene.method;
  method.name = name;
  const auto made = method.on(*scene.problem.arm, scene.step);
  const Trajectory r = simulate_fixed(scene.problem, scene.t, *made, scene.step);
  CHECK(r.failure == "");
  return r.q;
}

std::string said(const std::string& text) {
  try {
    parse_scene(text);
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "";
}

/// The text with its k-th `from` replaced.
std::string with(std::string text, const std::string& from, const std::string& to, int k = 0) {
  std::size_t at = text.find(from);
  for (; k > 0; --k) at = text.find(from, at + 1);
  REQUIRE(at != std::string::npos);
  return text.replace(at, from.size(), to);
}

}  // namespace

TEST_CASE("a scene comes back from its file to the last bit") {
  const Scene scene = whole();
  const std::string text = scene_text(scene);
  const Scene back = parse_scene(text);
  CHECK(scene_text(back) == text);
  CHECK(back.method.name == "gauss");
  CHECK(back.method.stages == 3);
  CHECK(back.step == scene.step);
  CHECK(back.t == scene.t);
  for (const char* method : {"gauss", "implicit"}) CHECK(run(scene, method) == run(back, method));
  Simulation one(scene.problem, {"implicit"}, 1e-3), two(back.problem, {"implicit"}, 1e-3);
  for (int k = 0; k < 30; ++k) {
    REQUIRE(one.step() == Status::ok);
    REQUIRE(two.step() == Status::ok);
  }
  CHECK(one.q() == two.q());
  CHECK(one.v() == two.v());
  CHECK(one.tau() == two.tau());
  CHECK((one.q() - scene.problem.q0).norm() > 1e-4);
}

TEST_CASE("steps that are long for the modes find what dry friction does") {
  Scene scene = whole();
  scene.problem.drives.clear();
  const Eigen::MatrixXd coarse = run(scene, "gauss");
  scene.step = 1e-4;
  const Eigen::MatrixXd fine = run(scene, "rk4");
  REQUIRE(coarse.allFinite());
  CHECK((coarse - fine).leftCols(2).cwiseAbs().maxCoeff() < 0.01 * fine.leftCols(2).cwiseAbs().maxCoeff());
}

TEST_CASE("options of IDA are in the file") {
  Scene scene{Problem(flexarm_test::spatial_arm())};
  scene.t = Eigen::Vector2d(0.0, 1.0);
  scene.method.name = "ida";
  scene.ida.atol = 1.0 / 3.0;
  scene.ida.linear_solver = LinearSolver::chain;
  const Scene back = parse_scene(scene_text(scene));
  CHECK(back.ida.atol == scene.ida.atol);
  CHECK(back.ida.rtol == scene.ida.rtol);
  CHECK(back.ida.linear_solver == LinearSolver::chain);
  CHECK(said(with(scene_text(scene), "\"chain\"", "\"chains\"")) ==
        "linear_solver = chains: must be \"auto\", \"dense\" or \"chain\"");
}

TEST_CASE("what is wrong in a file is named with its path, its value and what would be right") {
  const std::string text = scene_text(whole());
  const auto names = [&](const std::string& from, const std::string& to, const std::string& right, int k = 0) {
    const std::string message = said(with(text, from, to, k));
    CHECK_MESSAGE(message.find(right) == 0, message);
  };
  names("\"version\":6", "\"version\":3", "version = 3: this flexarm reads 6; compile the scene again");
  names("flexarm scene", "flexarm run", "format = \"flexarm run\": must be \"flexarm scene\"");
  names("\"version\":6", "\"version\":6,\"version\":5", "the key 'version' is there twice");
  names("\"arm\":", "\"ram\":", "the file: missing key 'arm'");
  names("\"version\":6", "\"version\":6,\"wings\":2",
        "the file: unknown key \"wings\"; known are format, version, arm");
  names("\"length\":", "\"lenght\":", "arm.links[0].beam: missing key 'length'");
  names("\"length\":0.3", "\"length\":\"0.3\"", "arm.links[1].beam.length = \"0.3\": must be a number");
  names("\"length\":0.3", "\"length\":-0.3", "arm.links[1].beam: length = -0.3: must be positive");
  names("\"bending_y\":2", "\"bending_y\":2.5", "arm.links[0].beam.modes.bending_y = 2.5: must be a whole number");
  names("\"bending_y\":2", "\"bending_y\":99", "arm.links[0].beam", 0);
  names("\"bending_y\":2", "\"bending_y\":3000000000",
        "arm.links[0].beam.modes.bending_y = 3000000000: must be a whole");
  names("\"ball\":false", "\"ball\":0", "arm.links[0].joint.ball = 0: must be true or false");
  names("\"mass\":0.5", "\"mass\":null", "arm.links[0].hub.mass = null: must be a number");
  names("\"mass\":0.5", "\"mass\":\"inf\"", "arm.links[0].hub.mass = \"inf\": must be a number");
  names("\"upper\":\"inf\"", "\"upper\":\"infinite\"",
        "arm.links[0].joint.forces[0].upper = \"infinite\": must be a number, \"inf\"");
  names("\"damping\":0.02", "\"damping\":-0.02", "arm.links[0].joint: damping[0] = -0.02: must not be negative");
  names("\"gravity\":[0.1,", "\"gravity\":[", "arm.gravity = 2 numbers: must be 3 numbers");
  names("\"rotation\":[[", "\"rotation\":[[1,", "arm.links[0].joint.inboard.rotation");
  names("\"q0\":[", "\"q0\":[0,", "q0 length = ");
  names("\"breaks\":[0.0,", "\"breaks\":[", "drives[0].motion: breaks = 2: need one more break");
  names("\"rate\":0", "\"rate\":77", "drive of coordinate = 77");
  names("\"weight\":", "\"wait\":", "loads[0].points[0]: missing key 'weight'");
  names("\"x\":0.123", "\"x\":1.23", "loads[1]: x = 1.23: must be on the beam");
  names("\"on\":\"slice\"", "\"on\":\"side\"", "arm.struts[1].points[0].on = side: must be \"origin\", \"end\" or");
  names("\"tension_only\":false", "\"tension_only\":0", "arm.struts[0].tension_only = 0: must be true or false");
  names("\"strut\":1", "\"strut\":2", "loads[3]: strut: there is no such strut");
  names("\"column\":[1.0,", "\"column\":[", "feedback[0]: column has ");
  names("\"period\":0.003", "\"period\":-0.003", "period = -0.003");
  names("\"u0\":[0.0]", "\"u0\":[0.0,1]", "samplers[0].linear.u0 = 2 numbers: must be 1 numbers");
  names("\"resolution\":[0.0001,", "\"resolution\":[", "samplers[2]: linear.resolution has 3 numbers: must be 4");
  names("\"start\":[[0.0,0.0,0.0,0.0],", "\"start\":[", "samplers[2]: linear.start has 2 numbers: must be 3");
  names("\"linear\":null", "\"linear\":3", "samplers[1].linear = 3: must be an object with keys");
  names("\"integrator\":\"gauss\"", "\"integrator\":\"guass\"", "method = guass");
  names("\"step\":0.001", "\"step\":0", "step = 0: must be positive");
  names("{", "[", "is no JSON: parse error");
  CHECK(said("") != "");
  CHECK(said("[1, 2]") == "the file = a list: must be an object with keys");
  CHECK(said(std::string(200000, '[')) != "");
}

TEST_CASE("functions cannot be saved, and are named") {
  Scene scene = whole();
  const auto refused = [](const Scene& x) -> std::string {
    try {
      scene_text(x);
    } catch (const std::invalid_argument& e) {
      return e.what();
    }
    return "";
  };
  const std::string why = " = a function: a file holds numbers";
  Scene one = scene;
  one.problem.drives[1].force = [](double t) { return t; };
  CHECK(refused(one).find("drives[1].force" + why) == 0);
  one = scene;
  one.problem.feedback[0].reference = [](double t) { return t; };
  CHECK(refused(one).find("feedback[0].reference" + why) == 0);
  one = scene;
  one.problem.samplers[0].law = [](double, const VectorXd&, const VectorXd& v, const VectorXd&, VectorXd& force) {
    force = v;
  };
  CHECK(refused(one).find("samplers[0].law" + why) == 0);
  one = scene;
  one.problem.events.push_back({[](double t, const VectorXd&, const VectorXd&) { return t; }});
  CHECK(refused(one).find("events = functions: a file holds numbers") == 0);
  one = scene;
  one.problem.tau[1] = std::nan("");
  CHECK(refused(one) == "tau[1] = nan: must be a number");
}

TEST_CASE("damaged files are refused or read, and crash nothing") {
  const std::string text = scene_text(whole());
  std::uint64_t state = 88172645463325252ULL;
  const auto drawn = [&](std::size_t below) {  // xorshift
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return static_cast<std::size_t>(state % below);
  };
  int refused = 0;
  for (int k = 0; k < 400; ++k) {
    std::string damaged = text;
    if (k % 4 == 0) damaged.resize(drawn(text.size()));
    for (std::size_t flips = k % 4 == 0 ? 0 : 1 + drawn(3); flips > 0; --flips)
      damaged[drawn(text.size())] = static_cast<char>(k % 4 == 1 ? drawn(256) : "0123456789-e.\",:[]{}nt"[drawn(22)]);
    refused += !said(damaged).empty();
  }
  CHECK(refused > 250);  // the others have another digit somewhere
}

TEST_CASE("a file that is not there, or is a scene file, says so") {
  const auto refused = [](const std::string& path) -> std::string {
    try {
      load_problem(path);
    } catch (const std::invalid_argument& e) {
      return e.what();
    }
    return "";
  };
  CHECK(refused("none.json") == "scene 'none.json': cannot be read");
  CHECK(refused("none.toml").find("cannot be read") != std::string::npos);
  CHECK(refused(".") == "scene '.': cannot be read");
}

#endif

}  // namespace test_scene
