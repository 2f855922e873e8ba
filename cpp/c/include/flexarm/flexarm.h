/* flexarm for C, and for all that calls C: compiled scenes, simulated step by step.
 *
 * Functions that return a pointer give NULL, those that return an int a negative number, and those that return a double
 * NaN, where something is wrong; flexarm_error() then says why. NULL in place of a handle is wrong in this way. What
 * has been freed must not be used again. Arrays of matrices are row by row. Indices begin at 0.
 *
 * A scene may serve many simulations in many threads at once. A simulation is used by one thread at a time. After
 * flexarm_start, steps, inputs and outputs allocate and lock nothing, but for the text of an error.
 */
#ifndef FLEXARM_H
#define FLEXARM_H

#if defined(__GNUC__)
#define FLEXARM_API __attribute__((visibility("default")))
#else
#define FLEXARM_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define FLEXARM_OK 0       /* done */
#define FLEXARM_STOPPED -1 /* a step could not be taken: the state is the last good one */
#define FLEXARM_INVALID -2 /* a bad argument: nothing has changed */

typedef struct flexarm_scene flexarm_scene;           /* an arm, its actions, where it starts */
typedef struct flexarm_simulation flexarm_simulation; /* a scene in motion */
typedef struct flexarm_state flexarm_state;           /* of a simulation, to go back to */

FLEXARM_API const char* flexarm_version(void);
/* The last error in this thread; "" if nothing has. Valid until the next call that fails. */
FLEXARM_API const char* flexarm_error(void);

/* --- Scenes --- */

/* Reads a compiled scene, as `flexarm compile scene.toml -o arm.json` writes it. The error names file, key and value.
 */
FLEXARM_API flexarm_scene* flexarm_load(const char* path);
/* The same from the text of such a file. */
FLEXARM_API flexarm_scene* flexarm_parse(const char* json);
/* Simulations that were started from it go on. NULL is allowed, here and in all functions that free. */
FLEXARM_API void flexarm_free_scene(flexarm_scene* scene);

FLEXARM_API int flexarm_nq(const flexarm_scene* scene);     /* coordinates: rad, m, of a ball four of a quaternion */
FLEXARM_API int flexarm_nv(const flexarm_scene* scene);     /* rates: rad/s, m/s */
FLEXARM_API int flexarm_links(const flexarm_scene* scene);  /* links of the arm */
FLEXARM_API int flexarm_drives(const flexarm_scene* scene); /* drives of joints and of patches */
FLEXARM_API int flexarm_loads(const flexarm_scene* scene);  /* external forces and moments */
FLEXARM_API int flexarm_laws(const flexarm_scene* scene);   /* continuous controllers */
/* Name of a rate, such as "link 0 revolute"; valid as long as the scene. */
FLEXARM_API const char* flexarm_rate_name(const flexarm_scene* scene, int rate);
FLEXARM_API double flexarm_begin(const flexarm_scene* scene); /* first output time (s) */
FLEXARM_API double flexarm_end(const flexarm_scene* scene);   /* last output time (s) */

/* --- Simulations --- */

/* At the scene's start and first output time, by its integrator: "implicit", "gauss" or "rk4".
 * step: longest step (s); 0: the scene's own */
FLEXARM_API flexarm_simulation* flexarm_start(const flexarm_scene* scene, double step);
/* The same, at a time (s), at coordinates (nq) and rates (nv) of yours: where a scene goes on from another one's state,
 * such as one with other gains. */
FLEXARM_API flexarm_simulation* flexarm_start_at(const flexarm_scene* scene, double step, double time, const double* q,
                                                 const double* v);
FLEXARM_API void flexarm_free_simulation(flexarm_simulation* simulation);

/* One step, of the length given or chosen; samples of drives, loads and controllers within it divide it. */
FLEXARM_API int flexarm_step(flexarm_simulation* simulation);
/* To a time (s), not before now, in equal steps. */
FLEXARM_API int flexarm_advance(flexarm_simulation* simulation, double until);

/* Outputs, now. Arrays are valid until the next call with this simulation. */
FLEXARM_API double flexarm_time(const flexarm_simulation* simulation);      /* s */
FLEXARM_API const double* flexarm_q(const flexarm_simulation* simulation);  /* (nq) */
FLEXARM_API const double* flexarm_v(const flexarm_simulation* simulation);  /* (nv) */
FLEXARM_API const double* flexarm_a(flexarm_simulation* simulation);        /* accelerations (nv) */
FLEXARM_API const double* flexarm_tau(flexarm_simulation* simulation);      /* forces, reactions (N, N m; nv) */
FLEXARM_API const double* flexarm_friction(flexarm_simulation* simulation); /* dry friction (N, N m; nv) */
/* Pose of a link's end in the world: place (m) and rotation matrix (3 x 3; columns are the end's axes). */
FLEXARM_API int flexarm_pose(flexarm_simulation* simulation, int link, double place[3], double rotation[9]);
/* A slice to look at, of a link's beam, x metres from its clamp; its number, from 0. It allocates. */
FLEXARM_API int flexarm_add_slice(flexarm_simulation* simulation, int link, double x);
/* Its pose, as of flexarm_pose, and its strains K1, K2, K3 (1/m), phi12, phi13 (rad), eps. Each may be NULL. */
FLEXARM_API int flexarm_slice(flexarm_simulation* simulation, int slice, double place[3], double rotation[9],
                              double strains[6]);

/* Inputs, from now on, in place of the scene's, until they are set again. */
FLEXARM_API int flexarm_set_tau(flexarm_simulation* simulation, const double* tau);         /* (N, N m; nv) */
FLEXARM_API int flexarm_set_force(flexarm_simulation* simulation, int drive, double value); /* N, N m; V of a patch */
FLEXARM_API int flexarm_set_load(flexarm_simulation* simulation, int load, const double wrench[6]); /* [f; m] N, N m */
FLEXARM_API int flexarm_set_reference(flexarm_simulation* simulation, int law, double value);       /* gains included */

/* All that determines the rest of a run. A simulation of the same scene that it is restored in goes on as the first
 * did, to the last bit. */
FLEXARM_API flexarm_state* flexarm_save(const flexarm_simulation* simulation);
FLEXARM_API int flexarm_restore(flexarm_simulation* simulation, const flexarm_state* state);
FLEXARM_API void flexarm_free_state(flexarm_state* state);

/* --- The arm alone, without drives, loads and controllers --- */

/* Accelerations a (nv) at q, v under generalised forces tau (nv), and their exact derivatives by q (nv x nq), v and tau
 * (nv x nv). Each of by_q, by_v and by_tau may be NULL. */
FLEXARM_API int flexarm_accelerate(flexarm_simulation* simulation, const double* q, const double* v, const double* tau,
                                   double* a, double* by_q, double* by_v, double* by_tau);

#ifdef __cplusplus
}
#endif

#endif
