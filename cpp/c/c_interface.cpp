// The C interface: see flexarm.h.
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <vector>

#include "flexarm/ab.hpp"
#include "flexarm/check.hpp"
#include "flexarm/derivatives.hpp"
#include "flexarm/flexarm.h"
#include "flexarm/kinematics.hpp"
#include "flexarm/scene.hpp"

using namespace flexarm;
using Eigen::Index;
using Eigen::VectorXd;

struct flexarm_scene {
  std::shared_ptr<const Scene> scene;
  std::vector<std::string> rates;
};

struct flexarm_simulation {
  std::shared_ptr<const Scene> scene;
  Simulation simulation;
  Workspace ws;                                   // of the arm alone
  std::optional<ForwardDerivatives> derivatives;  // made when first asked for
  VectorXd q, v, tau;
  struct Slice {
    PlacedSlice at;
    StrainMatrix strains;  // per elastic coordinate
  };
  std::vector<Slice> slices = {};
  bool moved = false;  // whether the workspace is that of the state now
};

struct flexarm_state {
  std::shared_ptr<const Scene> scene;
  Simulation::State state;
};

namespace {

thread_local std::string wrong;

template <class Result>
Result failed(Result result, const char* what) {
  try {
    wrong = what;
  } catch (const std::bad_alloc&) {
    wrong.clear();
  }
  return result;
}

/// Of work that may throw.
template <class Work, class Result>
Result tried(const Work& work, Result otherwise) {
  try {
    return work();
  } catch (const std::exception& e) {
    return failed(otherwise, e.what());
  }
}
template <class Work>
int done(const Work& work) {
  return tried([&] { return work(), FLEXARM_OK; }, FLEXARM_INVALID);
}

void needs(const void* pointer, const char* name) {
  if (!pointer) bad_value(name, "NULL", "must be given");
}

/// What is asked of a handle; `otherwise` where it is NULL.
template <class Handle, class Ask, class Result>
Result ask(Handle* handle, const Ask& what, Result otherwise) {
  return tried([&]() -> Result { return needs(handle, "handle"), what(*handle); }, otherwise);
}
template <class Handle, class Ask>
int count(Handle* handle, const Ask& what) {
  return ask(handle, [&](const auto& s) { return static_cast<int>(what(s)); }, FLEXARM_INVALID);
}
template <class Handle, class Ask>
const double* numbers(Handle* s, const Ask& what) {
  return ask(s, [&](auto& of) { return what(of.simulation).data(); }, static_cast<const double*>(nullptr));
}
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

std::size_t index(const char* name, int given, std::size_t count) {
  if (given < 0 || static_cast<std::size_t>(given) >= count)
    bad_value(name, given, "must be from 0 to " + std::to_string(static_cast<long>(count) - 1) + " here");
  return static_cast<std::size_t>(given);
}

Eigen::Map<const VectorXd> values(const char* name, const double* given, Index count) {
  needs(given, name);
  const Eigen::Map<const VectorXd> out(given, count);
  if (!out.allFinite()) bad_value(name, out.transpose(), "must be finite");
  return out;
}

flexarm_scene* scene_of(Scene&& scene) {
  if (scene.method.name == "ida")
    bad_value("integrator", "ida",
              "takes no steps one by one: compile the scene with \"implicit\", \"gauss\" or \"rk4\"");
  auto shared = std::make_shared<const Scene>(std::move(scene));
  return new flexarm_scene{shared, shared->problem.arm->coordinates()};
}

flexarm_simulation* started(const flexarm_scene& of, double step, double t, const VectorXd* q, const VectorXd* v) {
  const Scene& scene = *of.scene;
  const double h = step == 0.0 ? scene.step : positive("step", step);
  Problem problem = scene.problem;
  if (q) problem.q0 = *q;
  if (v) problem.v0 = *v;
  const Arm& arm = *problem.arm;
  const VectorXd zero = VectorXd::Zero(arm.nv());
  return new flexarm_simulation{of.scene, Simulation(problem, scene.method, h, t), Workspace(arm), {}, arm.zero(), zero,
                                zero};
}

/// The workspace at the state now.
const Workspace& moved(flexarm_simulation& s) {
  if (!s.moved) move_arm(*s.scene->problem.arm, s.ws, s.simulation.q(), s.simulation.v());
  s.moved = true;
  return s.ws;
}

void write(const Pose& pose, double* place, double* rotation) {
  for (Index i = 0; i < 3; ++i) {
    if (place) place[i] = pose.p[i];
    for (Index j = 0; rotation && j < 3; ++j) rotation[3 * i + j] = pose.R(i, j);
  }
}

int went(flexarm_simulation& s, Status status) {
  s.moved = false;
  return status == Status::ok ? FLEXARM_OK : failed(FLEXARM_STOPPED, s.simulation.failure().c_str());
}

/// Row by row.
void write(const Eigen::MatrixXd& of, double* out) {
  Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(out, of.rows(), of.cols()) = of;
}

}  // namespace

extern "C" {

const char* flexarm_version(void) { return FLEXARM_VERSION; }
const char* flexarm_error(void) { return wrong.c_str(); }

flexarm_scene* flexarm_load(const char* path) {
  return tried([&] { return needs(path, "path"), scene_of(load_scene(path)); }, static_cast<flexarm_scene*>(nullptr));
}
flexarm_scene* flexarm_parse(const char* json) {
  return tried([&] { return needs(json, "json"), scene_of(parse_scene(json)); }, static_cast<flexarm_scene*>(nullptr));
}
void flexarm_free_scene(flexarm_scene* scene) { delete scene; }

int flexarm_nq(const flexarm_scene* s) {
  return count(s, [](const auto& of) { return of.scene->problem.arm->nq(); });
}
int flexarm_nv(const flexarm_scene* s) {
  return count(s, [](const auto& of) { return of.scene->problem.arm->nv(); });
}
int flexarm_links(const flexarm_scene* s) {
  return count(s, [](const auto& of) { return of.scene->problem.arm->size(); });
}
int flexarm_drives(const flexarm_scene* s) {
  return count(s, [](const auto& of) { return of.scene->problem.drives.size(); });
}
int flexarm_loads(const flexarm_scene* s) {
  return count(s, [](const auto& of) { return of.scene->problem.loads.size(); });
}
int flexarm_laws(const flexarm_scene* s) {
  return count(s, [](const auto& of) { return of.scene->problem.feedback.size(); });
}
const char* flexarm_rate_name(const flexarm_scene* s, int rate) {
  return ask(
      s, [&](const auto& of) { return of.rates[index("rate", rate, of.rates.size())].c_str(); },
      static_cast<const char*>(nullptr));
}
double flexarm_begin(const flexarm_scene* s) {
  return ask(s, [](const auto& of) { return of.scene->t[0]; }, kNone);
}
double flexarm_end(const flexarm_scene* s) {
  return ask(s, [](const auto& of) { return of.scene->t[of.scene->t.size() - 1]; }, kNone);
}

flexarm_simulation* flexarm_start(const flexarm_scene* of, double step) {
  return tried([&] { return needs(of, "scene"), started(*of, step, of->scene->t[0], nullptr, nullptr); },
               static_cast<flexarm_simulation*>(nullptr));
}
flexarm_simulation* flexarm_start_at(const flexarm_scene* of, double step, double time, const double* q,
                                     const double* v) {
  return tried(
      [&] {
        needs(of, "scene");
        const Arm& arm = *of->scene->problem.arm;
        const VectorXd q0 = values("q", q, arm.nq()), v0 = values("v", v, arm.nv());
        return started(*of, step, time, &q0, &v0);
      },
      static_cast<flexarm_simulation*>(nullptr));
}
void flexarm_free_simulation(flexarm_simulation* s) { delete s; }

int flexarm_step(flexarm_simulation* s) {
  if (!s) return done([] { needs(nullptr, "simulation"); });
  return tried([&] { return went(*s, s->simulation.step()); }, FLEXARM_STOPPED);
}
int flexarm_advance(flexarm_simulation* s, double until) {
  if (!s || !(until >= s->simulation.t()) || !std::isfinite(until))
    return done([&] {
      needs(s, "simulation");
      bad_value("until", until, "must be finite, and not before " + std::to_string(s->simulation.t()));
    });
  return tried([&] { return went(*s, s->simulation.advance(until)); }, FLEXARM_STOPPED);
}

double flexarm_time(const flexarm_simulation* s) {
  return ask(s, [](const auto& of) { return of.simulation.t(); }, kNone);
}
const double* flexarm_q(const flexarm_simulation* s) {
  return numbers(s, [](auto& of) -> auto& { return of.q(); });
}
const double* flexarm_v(const flexarm_simulation* s) {
  return numbers(s, [](auto& of) -> auto& { return of.v(); });
}
const double* flexarm_a(flexarm_simulation* s) {
  return numbers(s, [](auto& of) -> auto& { return of.a(); });
}
const double* flexarm_tau(flexarm_simulation* s) {
  return numbers(s, [](auto& of) -> auto& { return of.tau(); });
}
const double* flexarm_friction(flexarm_simulation* s) {
  return numbers(s, [](auto& of) -> auto& { return of.friction(); });
}

int flexarm_pose(flexarm_simulation* s, int link, double place[3], double rotation[9]) {
  return done([&] {
    needs(s, "simulation");
    const std::size_t at = index("link", link, s->scene->problem.arm->size());
    write(slice_pose(moved(*s), at), place, rotation);
  });
}
int flexarm_add_slice(flexarm_simulation* s, int link, double x) {
  return tried(
      [&] {
        needs(s, "simulation");
        const Arm& arm = *s->scene->problem.arm;
        const std::size_t of = index("link", link, arm.size());
        const SliceTable table = arm.link(of).slice_at(x);
        s->slices.push_back({PlacedSlice(arm, of, table), table.strains});
        return static_cast<int>(s->slices.size()) - 1;
      },
      FLEXARM_INVALID);
}
int flexarm_slice(flexarm_simulation* s, int slice, double place[3], double rotation[9], double strains[6]) {
  return done([&] {
    needs(s, "simulation");
    const flexarm_simulation::Slice& of = s->slices[index("slice", slice, s->slices.size())];
    write(slice_pose(moved(*s), of.at), place, rotation);
    if (!strains) return;
    const Arm& arm = *s->scene->problem.arm;
    const Link& link = arm.link(of.at.link());
    const Index first = arm.first_q(of.at.link()) + link.joint().nq();
    Eigen::Map<StrainVector>(strains).noalias() = of.strains * s->simulation.q().segment(first, link.ne());
  });
}

int flexarm_set_tau(flexarm_simulation* s, const double* tau) {
  return done([&] {
    needs(s, "simulation");
    needs(tau, "tau");
    s->tau = Eigen::Map<const VectorXd>(tau, s->tau.size());
    s->simulation.set_tau(s->tau);
  });
}
int flexarm_set_force(flexarm_simulation* s, int drive, double value) {
  return done([&] {
    needs(s, "simulation");
    s->simulation.set_force(index("drive", drive, s->scene->problem.drives.size()), value);
  });
}
int flexarm_set_load(flexarm_simulation* s, int load, const double wrench[6]) {
  return done([&] {
    needs(s, "simulation");
    const std::size_t at = index("load", load, s->scene->problem.loads.size());
    needs(wrench, "wrench");
    s->simulation.set_load(at, Eigen::Map<const Vec6<double>>(wrench));
  });
}
int flexarm_set_reference(flexarm_simulation* s, int law, double value) {
  return done([&] {
    needs(s, "simulation");
    s->simulation.set_reference(index("law", law, s->scene->problem.feedback.size()), value);
  });
}

flexarm_state* flexarm_save(const flexarm_simulation* s) {
  return ask(
      s, [](const auto& of) { return new flexarm_state{of.scene, of.simulation.state()}; },
      static_cast<flexarm_state*>(nullptr));
}
int flexarm_restore(flexarm_simulation* s, const flexarm_state* state) {
  return done([&] {
    needs(s, "simulation");
    needs(state, "state");
    if (state->scene != s->scene) bad_value("state", "of another scene", "must be of this simulation's");
    s->simulation.restore(state->state);
    s->moved = false;
  });
}
void flexarm_free_state(flexarm_state* state) { delete state; }

int flexarm_accelerate(flexarm_simulation* s, const double* q, const double* v, const double* tau, double* a,
                       double* by_q, double* by_v, double* by_tau) {
  const auto work = [&] {
    needs(s, "simulation");
    const Arm& arm = *s->scene->problem.arm;
    s->q = values("q", q, arm.nq());
    s->v = values("v", v, arm.nv());
    s->tau = values("tau", tau, arm.nv());
    needs(a, "a");
    s->moved = false;
    Status status;
    if (by_q || by_v || by_tau) {
      if (!s->derivatives) s->derivatives.emplace(arm);
      status = (*s->derivatives)(arm, s->q, s->v, s->tau);
      if (status == Status::ok) std::copy_n(s->derivatives->a.data(), arm.nv(), a);
      if (status == Status::ok && by_q) write(s->derivatives->dq, by_q);
      if (status == Status::ok && by_v) write(s->derivatives->dv, by_v);
      if (status == Status::ok && by_tau) write(s->derivatives->dtau, by_tau);
    } else {
      status = forward_dynamics(arm, s->ws, s->q, s->v, s->tau);
      if (status == Status::ok) std::copy_n(s->ws.a.data(), arm.nv(), a);
    }
    return status == Status::ok ? FLEXARM_OK : failed(FLEXARM_STOPPED, "the accelerations are not finite there");
  };
  return tried(work, FLEXARM_INVALID);
}

}  // extern "C"
