/* The plant of a controller in another process, as a PLC's runtime has it: a loop of 1 kHz whose inputs and outputs lie
 * in shared memory.
 *
 *   shared_loop SCENE.json [NAME] [SECONDS]     NAME: of the shared memory, /flexarm unless given
 *
 * Each millisecond it takes the generalised forces, steps the arm and writes the state. `count` is raised before and
 * behind each writing: a reader takes the numbers when it is even, and the same behind as before. Without SECONDS it
 * runs until it is interrupted.
 */
#define _POSIX_C_SOURCE 200809L
#include <fcntl.h>
#include <flexarm/flexarm.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#define MOST 64     /* coordinates */
#define PERIOD 1e-3 /* s */

struct shared {
  unsigned long count;
  double time;             /* s */
  double tau[MOST];        /* in: N, N m */
  double q[MOST], v[MOST]; /* out */
};

static volatile sig_atomic_t stopped = 0;
static void stop(int signal) {
  (void)signal;
  stopped = 1;
}

static int failed(const char* what) {
  fprintf(stderr, "shared_loop: %s\n", what);
  return 2;
}

static int run(flexarm_simulation* arm, struct shared* all, size_t nq, size_t nv, double seconds) {
  struct timespec next;
  double tau[MOST];
  clock_gettime(CLOCK_MONOTONIC, &next);
  while (!stopped && flexarm_time(arm) < seconds) {
    memcpy(tau, all->tau, sizeof tau);
    if (flexarm_set_tau(arm, tau) != FLEXARM_OK || flexarm_advance(arm, flexarm_time(arm) + PERIOD) != FLEXARM_OK)
      return failed(flexarm_error());
    __atomic_add_fetch(&all->count, 1, __ATOMIC_ACQ_REL);
    __atomic_thread_fence(__ATOMIC_RELEASE);
    all->time = flexarm_time(arm);
    memcpy(all->q, flexarm_q(arm), nq * sizeof(double));
    memcpy(all->v, flexarm_v(arm), nv * sizeof(double));
    __atomic_add_fetch(&all->count, 1, __ATOMIC_ACQ_REL);
    next.tv_nsec += (long)(PERIOD * 1e9);
    if (next.tv_nsec >= 1000000000L) {
      next.tv_nsec -= 1000000000L;
      ++next.tv_sec;
    }
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL);
  }
  return 0;
}

int main(int argc, char** argv) {
  const char* name = argc > 2 ? argv[2] : "/flexarm";
  flexarm_scene* scene;
  flexarm_simulation* arm;
  struct shared* all;
  int memory, status;
  if (argc < 2) return failed("usage: shared_loop SCENE.json [NAME] [SECONDS]");
  scene = flexarm_load(argv[1]);
  if (!scene) return failed(flexarm_error());
  if (flexarm_nq(scene) > MOST) return failed("the arm has too many coordinates");
  arm = flexarm_start(scene, 0.0);
  if (!arm) return failed(flexarm_error());
  memory = shm_open(name, O_CREAT | O_RDWR, 0600);
  if (memory < 0 || ftruncate(memory, sizeof *all) != 0) return failed("no shared memory of this name can be made");
  all = (struct shared*)mmap(NULL, sizeof *all, PROT_READ | PROT_WRITE, MAP_SHARED, memory, 0);
  if (all == MAP_FAILED) return failed("the shared memory cannot be mapped");
  memset(all, 0, sizeof *all);
  signal(SIGINT, stop);
  signal(SIGTERM, stop);
  status = run(arm, all, (size_t)flexarm_nq(scene), (size_t)flexarm_nv(scene), argc > 3 ? atof(argv[3]) : 1e30);
  if (status == 0) printf("stopped at t = %.3f s\n", flexarm_time(arm));
  munmap(all, sizeof *all);
  shm_unlink(name);
  flexarm_free_simulation(arm);
  flexarm_free_scene(scene);
  return status;
}
