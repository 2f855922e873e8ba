/* A compiled scene as a block of Simulink: a level-2 S-function.
 *
 *   mex sfun_flexarm.c -I"$(flexarm --cmakedir)/../../../include" -L... -lflexarm_c     (see docs/cpp.md)
 *
 * Parameters of the block: the file of the compiled scene, and the sample time (s).
 * Input: generalised forces (N, N m), (nv), beside all that acts in the scene itself.
 * Outputs: coordinates (nq); rates (nv); place of the arm's end (m), (3).
 */
#define S_FUNCTION_NAME sfun_flexarm
#define S_FUNCTION_LEVEL 2
#include <flexarm/flexarm.h>
#include <stdlib.h>
#include <string.h>

#include "simstruc.h"

enum { FILE_NAME, SAMPLE_TIME, PARAMETERS };
enum { SCENE, SIMULATION, POINTERS };

static double sample_time(SimStruct* S) { return mxGetScalar(ssGetSFcnParam(S, SAMPLE_TIME)); }

/* Simulink keeps the pointer. */
static void fail(SimStruct* S, const char* what) {
  static char text[1000];
  strncpy(text, what, sizeof text - 1);
  ssSetErrorStatus(S, text);
}

static flexarm_scene* load(SimStruct* S) {
  char* path = mxArrayToString(ssGetSFcnParam(S, FILE_NAME));
  flexarm_scene* scene = path ? flexarm_load(path) : NULL;
  mxFree(path);
  if (!scene) fail(S, flexarm_error());
  return scene;
}

static void mdlInitializeSizes(SimStruct* S) {
  flexarm_scene* scene;
  ssSetNumSFcnParams(S, PARAMETERS);
  if (ssGetNumSFcnParams(S) != ssGetSFcnParamsCount(S)) return; /* Simulink tells the user */
  if (!(sample_time(S) > 0.0)) {
    fail(S, "sample time: must be positive");
    return;
  }
  scene = load(S);
  if (!scene) return;
  if (ssSetNumInputPorts(S, 1) && ssSetNumOutputPorts(S, 3)) {
    ssSetInputPortWidth(S, 0, flexarm_nv(scene));
    ssSetInputPortRequiredContiguous(S, 0, 1);
    ssSetInputPortDirectFeedThrough(S, 0, 0);
    ssSetOutputPortWidth(S, 0, flexarm_nq(scene));
    ssSetOutputPortWidth(S, 1, flexarm_nv(scene));
    ssSetOutputPortWidth(S, 2, 3);
    ssSetNumSampleTimes(S, 1);
    ssSetNumPWork(S, POINTERS);
  }
  flexarm_free_scene(scene);
}

static void mdlInitializeSampleTimes(SimStruct* S) {
  ssSetSampleTime(S, 0, sample_time(S));
  ssSetOffsetTime(S, 0, 0.0);
}

#define MDL_START
static void mdlStart(SimStruct* S) {
  flexarm_scene* scene = load(S);
  if (!scene) return;
  ssSetPWorkValue(S, SCENE, scene);
  ssSetPWorkValue(S, SIMULATION, flexarm_start(scene, 0.0));
  if (!ssGetPWorkValue(S, SIMULATION)) fail(S, flexarm_error());
}

static void mdlOutputs(SimStruct* S, int_T tid) {
  const flexarm_scene* scene = (const flexarm_scene*)ssGetPWorkValue(S, SCENE);
  flexarm_simulation* simulation = (flexarm_simulation*)ssGetPWorkValue(S, SIMULATION);
  (void)tid;
  memcpy(ssGetOutputPortRealSignal(S, 0), flexarm_q(simulation), sizeof(double) * (size_t)flexarm_nq(scene));
  memcpy(ssGetOutputPortRealSignal(S, 1), flexarm_v(simulation), sizeof(double) * (size_t)flexarm_nv(scene));
  flexarm_pose(simulation, flexarm_links(scene) - 1, ssGetOutputPortRealSignal(S, 2), NULL);
}

#define MDL_UPDATE
static void mdlUpdate(SimStruct* S, int_T tid) {
  flexarm_simulation* simulation = (flexarm_simulation*)ssGetPWorkValue(S, SIMULATION);
  (void)tid;
  if (flexarm_set_tau(simulation, ssGetInputPortRealSignal(S, 0)) != FLEXARM_OK ||
      flexarm_advance(simulation, flexarm_time(simulation) + sample_time(S)) != FLEXARM_OK)
    fail(S, flexarm_error());
}

static void mdlTerminate(SimStruct* S) {
  if (ssGetNumPWork(S) < POINTERS) return;
  flexarm_free_simulation((flexarm_simulation*)ssGetPWorkValue(S, SIMULATION));
  flexarm_free_scene((flexarm_scene*)ssGetPWorkValue(S, SCENE));
}

#ifdef MATLAB_MEX_FILE
#include "simulink.c"
#else
#include "cg_sfun.h"
#endif
