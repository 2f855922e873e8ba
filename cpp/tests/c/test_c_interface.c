/* The C interface, by a C compiler: test_c_interface SCENE.json */
#include <flexarm/flexarm.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "block.h"

#define MOST 16

static int wrong = 0;
static void check(int right, const char* what, int line) {
  if (right) return;
  fprintf(stderr, "line %d: not so: %s\n", line, what);
  ++wrong;
}
#define CHECK(x) check(x, #x, __LINE__)

static void check_names(const char* word) {
  if (!strstr(flexarm_error(), word)) {
    fprintf(stderr, "no '%s' in: %s\n", word, flexarm_error());
    ++wrong;
  }
}

/* An arm that was left alone for a while, and then pushed. */
static void run(const flexarm_scene* scene, flexarm_simulation* arm, const double* tau, double* q) {
  int k;
  CHECK(flexarm_set_tau(arm, tau) == FLEXARM_OK);
  for (k = 0; k < 20; ++k) CHECK(flexarm_step(arm) == FLEXARM_OK);
  memcpy(q, flexarm_q(arm), sizeof(double) * (size_t)flexarm_nq(scene));
}

static void test_runs(const flexarm_scene* scene) {
  double tau[MOST] = {0.05}, first[MOST] = {0}, again[MOST] = {0}, other[MOST] = {0}, place[3], turn[9];
  flexarm_simulation *arm = flexarm_start(scene, 0.0), *twin = flexarm_start(scene, 0.0);
  flexarm_state* kept;
  CHECK(arm && twin);
  CHECK(flexarm_time(arm) == flexarm_begin(scene));
  CHECK(flexarm_advance(arm, flexarm_begin(scene) + 0.05) == FLEXARM_OK);
  kept = flexarm_save(arm);
  run(scene, arm, tau, first);
  CHECK(flexarm_time(arm) > flexarm_begin(scene) + 0.05);
  CHECK(flexarm_restore(arm, kept) == FLEXARM_OK && flexarm_restore(twin, kept) == FLEXARM_OK);
  run(scene, arm, tau, again);
  run(scene, twin, tau, other);
  CHECK(!memcmp(first, again, sizeof first) && !memcmp(first, other, sizeof first));
  CHECK(isfinite(flexarm_a(arm)[0]) && isfinite(flexarm_tau(arm)[0]) && isfinite(flexarm_friction(arm)[0]));
  CHECK(flexarm_pose(arm, flexarm_links(scene) - 1, place, turn) == FLEXARM_OK);
  CHECK(fabs(turn[0] * turn[0] + turn[3] * turn[3] + turn[6] * turn[6] - 1.0) < 1e-12);
  CHECK(flexarm_pose(arm, 0, NULL, NULL) == FLEXARM_OK);
  flexarm_free_state(kept);
  flexarm_free_simulation(twin);
  flexarm_free_simulation(arm);
}

/* From another one's state, the run goes on as a run with these numbers would. */
static void test_starts_at(const flexarm_scene* scene) {
  double q[MOST] = {0}, v[MOST] = {0};
  const double tau[MOST] = {0.05};
  const size_t nq = sizeof(double) * (size_t)flexarm_nq(scene), nv = sizeof(double) * (size_t)flexarm_nv(scene);
  flexarm_simulation *first = flexarm_start(scene, 0.0), *second;
  CHECK(flexarm_set_tau(first, tau) == FLEXARM_OK && flexarm_advance(first, 0.1) == FLEXARM_OK);
  memcpy(q, flexarm_q(first), nq);
  memcpy(v, flexarm_v(first), nv);
  second = flexarm_start_at(scene, 0.0, flexarm_time(first), q, v);
  CHECK(second && flexarm_time(second) == flexarm_time(first));
  CHECK(!memcmp(flexarm_q(second), q, nq) && !memcmp(flexarm_v(second), v, nv));
  CHECK(flexarm_set_tau(second, tau) == FLEXARM_OK);
  CHECK(flexarm_advance(first, 0.2) == FLEXARM_OK && flexarm_advance(second, 0.2) == FLEXARM_OK);
  CHECK(fabs(flexarm_q(first)[0] - flexarm_q(second)[0]) < 1e-6 * (1.0 + fabs(flexarm_q(first)[0])));
  CHECK(!flexarm_start_at(scene, 0.0, 0.0, NULL, v));
  check_names("q");
  v[0] = HUGE_VAL;
  CHECK(!flexarm_start_at(scene, 0.0, 0.0, q, v));
  check_names("v");
  flexarm_free_simulation(first);
  flexarm_free_simulation(second);
}

/* The last slice of the last beam is where the link ends, if nothing is on it; it moves with the arm. */
static void test_slices(const flexarm_scene* scene) {
  const int link = flexarm_links(scene) - 1;
  double place[3], turn[9], end[3], end_turn[9], strains[6], clamp[6], before;
  flexarm_simulation* arm = flexarm_start(scene, 0.0);
  const int tip = flexarm_add_slice(arm, link, 0.5), root = flexarm_add_slice(arm, link, 0.0);
  CHECK(tip == 0 && root == 1);
  CHECK(flexarm_slice(arm, tip, place, NULL, NULL) == FLEXARM_OK);
  before = place[1];
  CHECK(flexarm_advance(arm, 0.1) == FLEXARM_OK);
  CHECK(flexarm_slice(arm, tip, place, turn, strains) == FLEXARM_OK);
  CHECK(flexarm_pose(arm, link, end, end_turn) == FLEXARM_OK);
  CHECK(fabs(place[1] - before) > 1e-3);
  CHECK(fabs(place[0] - end[0]) + fabs(place[1] - end[1]) + fabs(turn[1] - end_turn[1]) < 1e-12);
  CHECK(flexarm_slice(arm, root, NULL, NULL, clamp) == FLEXARM_OK);
  CHECK(fabs(clamp[2]) > 1e-3 && fabs(strains[2]) < 1e-6 && clamp[0] == 0.0); /* K3 bends it, not at its free end */
  CHECK(flexarm_add_slice(arm, link, 2.0) == FLEXARM_INVALID && flexarm_add_slice(arm, 99, 0.0) == FLEXARM_INVALID);
  check_names("link");
  CHECK(flexarm_slice(arm, 2, place, NULL, NULL) == FLEXARM_INVALID);
  check_names("slice");
  flexarm_free_simulation(arm);
}

static void test_derivatives(const flexarm_scene* scene) {
  const int nq = flexarm_nq(scene), nv = flexarm_nv(scene);
  double q[MOST] = {0.2, 0.01}, v[MOST] = {0.3}, tau[MOST] = {0.1}, a[MOST], more[MOST], less[MOST];
  double by_q[MOST * MOST], by_v[MOST * MOST], by_tau[MOST * MOST];
  flexarm_simulation* arm = flexarm_start(scene, 0.0);
  int i, k;
  CHECK(nq == nv && nv <= MOST);
  CHECK(flexarm_accelerate(arm, q, v, tau, a, by_q, by_v, by_tau) == FLEXARM_OK);
  CHECK(flexarm_accelerate(arm, q, v, tau, more, NULL, NULL, NULL) == FLEXARM_OK);
  for (i = 0; i < nv; ++i) CHECK(fabs(a[i] - more[i]) <= 1e-9 * (1.0 + fabs(a[i])));
  for (k = 0; k < nv; ++k) {
    const double h = 1e-5, at[] = {q[k], tau[k]};
    q[k] = at[0] + h, flexarm_accelerate(arm, q, v, tau, more, NULL, NULL, NULL);
    q[k] = at[0] - h, flexarm_accelerate(arm, q, v, tau, less, NULL, NULL, NULL);
    q[k] = at[0];
    for (i = 0; i < nv; ++i)
      CHECK(fabs((more[i] - less[i]) / (2 * h) - by_q[i * nq + k]) < 1e-4 * (1.0 + fabs(by_q[i * nq + k])));
    tau[k] = at[1] + h, flexarm_accelerate(arm, q, v, tau, more, NULL, NULL, NULL);
    tau[k] = at[1];
    for (i = 0; i < nv; ++i)
      CHECK(fabs((more[i] - a[i]) / h - by_tau[i * nv + k]) < 1e-4 * (1.0 + fabs(by_tau[i * nv + k])));
  }
  flexarm_free_simulation(arm);
}

static void test_errors(const flexarm_scene* scene) {
  double wrench[6] = {0};
  flexarm_simulation* arm = flexarm_start(scene, 0.0);
  CHECK(!flexarm_load("no such file.json"));
  check_names("no such file.json");
  CHECK(!flexarm_load(NULL) && !flexarm_parse("{\"format\": 1}"));
  check_names("format");
  CHECK(!flexarm_start(scene, -1.0));
  check_names("step");
  CHECK(flexarm_advance(arm, -1.0) == FLEXARM_INVALID);
  check_names("until");
  CHECK(flexarm_advance(arm, HUGE_VAL) == FLEXARM_INVALID);
  check_names("until");
  CHECK(flexarm_set_tau(arm, NULL) == FLEXARM_INVALID);
  check_names("tau");
  CHECK(flexarm_set_force(arm, flexarm_drives(scene), 0.0) == FLEXARM_INVALID);
  check_names("drive");
  CHECK(flexarm_set_load(arm, -1, wrench) == FLEXARM_INVALID);
  check_names("load");
  CHECK(flexarm_set_reference(arm, 99, 0.0) == FLEXARM_INVALID);
  check_names("law");
  CHECK(flexarm_pose(arm, 99, NULL, NULL) == FLEXARM_INVALID);
  check_names("link");
  CHECK(!flexarm_rate_name(scene, -1));
  check_names("rate");
  CHECK(flexarm_nq(NULL) < 0 && flexarm_laws(NULL) < 0 && isnan(flexarm_end(NULL)) && !flexarm_rate_name(NULL, 0));
  CHECK(flexarm_step(NULL) < 0 && flexarm_advance(NULL, 1.0) < 0 && isnan(flexarm_time(NULL)) && !flexarm_q(NULL));
  CHECK(!flexarm_a(NULL) && !flexarm_save(NULL) && flexarm_restore(NULL, NULL) < 0 &&
        flexarm_set_tau(NULL, wrench) < 0);
  CHECK(flexarm_pose(NULL, 0, NULL, NULL) < 0 && flexarm_set_force(NULL, 0, 0.0) < 0);
  CHECK(flexarm_accelerate(NULL, wrench, wrench, wrench, wrench, NULL, NULL, NULL) < 0);
  CHECK(flexarm_add_slice(NULL, 0, 0.0) < 0 && flexarm_slice(NULL, 0, NULL, NULL, NULL) < 0);
  CHECK(!flexarm_start_at(NULL, 0.0, 0.0, wrench, wrench));
  check_names("NULL");
  CHECK(flexarm_step(arm) == FLEXARM_OK); /* none of these has changed anything */
  flexarm_free_simulation(arm);
  flexarm_free_simulation(NULL);
  flexarm_free_scene(NULL);
  flexarm_free_state(NULL);
}

static void test_block(const char* path, const flexarm_scene* scene) {
  SimStruct block;
  double tau[MOST] = {0.05}, place[3];
  flexarm_simulation* arm = flexarm_start(scene, 0.0);
  int k;
  memset(&block, 0, sizeof block);
  block.params[0].text = path;
  block.params[1].number = 1e-3;
  block.given = 2;
  block.in[0] = tau[0];
  CHECK(run_block(&block, 50) == NULL);
  CHECK(block.inputs == 1 && block.outputs == 3 && block.input_width == flexarm_nv(scene));
  for (k = 0; k < 50; ++k) {
    flexarm_set_tau(arm, tau);
    CHECK(flexarm_advance(arm, flexarm_time(arm) + 1e-3) == FLEXARM_OK);
  }
  flexarm_pose(arm, flexarm_links(scene) - 1, place, NULL);
  CHECK(block.out[0][0] == flexarm_q(arm)[0] && block.out[1][1] == flexarm_v(arm)[1] && block.out[2][1] == place[1]);
  block.params[1].number = 0.0;
  CHECK(strstr(run_block(&block, 1), "sample time") != NULL);
  block.params[1].number = 1e-3;
  block.error = NULL;
  block.params[0].text = "no such file.json";
  CHECK(run_block(&block, 1) != NULL);
  flexarm_free_simulation(arm);
}

int main(int argc, char** argv) {
  flexarm_scene* scene = flexarm_load(argc > 1 ? argv[1] : NULL);
  if (!scene) {
    fprintf(stderr, "%s\n", flexarm_error());
    return 2;
  }
  CHECK(strlen(flexarm_version()) > 0 && flexarm_end(scene) > flexarm_begin(scene));
  CHECK(strstr(flexarm_rate_name(scene, 0), "link 0") != NULL);
  test_runs(scene);
  test_starts_at(scene);
  test_slices(scene);
  test_derivatives(scene);
  test_errors(scene);
  test_block(argv[1], scene);
  flexarm_free_scene(scene);
  if (!wrong) printf("all right\n");
  return wrong ? 1 : 0;
}
