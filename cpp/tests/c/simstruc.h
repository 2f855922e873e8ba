/* As much of Simulink's simstruc.h as sfun_flexarm.c uses, for its test: the names are Simulink's, the rest is not. */
#ifndef SIMSTRUC_H
#define SIMSTRUC_H
#include <stdlib.h>

typedef int int_T;
typedef struct {
  const char* text;
  double number;
} mxArray;

typedef struct {
  mxArray params[2];
  int asked, given, inputs, outputs, input_width, output_width[3], pointers;
  const char* error;
  double period;
  void* pointer[2];
  double in[16], out[3][16];
} SimStruct;

char* mxArrayToString(const mxArray* from);
#define mxFree free
#define mxGetScalar(x) ((x)->number)
#define ssGetSFcnParam(S, i) (&(S)->params[i])
#define ssSetNumSFcnParams(S, n) ((S)->asked = (n))
#define ssGetNumSFcnParams(S) ((S)->asked)
#define ssGetSFcnParamsCount(S) ((S)->given)
#define ssSetErrorStatus(S, text) ((S)->error = (text))
#define ssSetNumInputPorts(S, n) ((S)->inputs = (n))
#define ssSetNumOutputPorts(S, n) ((S)->outputs = (n))
#define ssSetInputPortWidth(S, port, n) ((S)->input_width = (n))
#define ssSetInputPortRequiredContiguous(S, port, yes) ((void)(S))
#define ssSetInputPortDirectFeedThrough(S, port, yes) ((void)(S))
#define ssSetOutputPortWidth(S, port, n) ((S)->output_width[port] = (n))
#define ssSetNumSampleTimes(S, n) ((void)(S))
#define ssSetNumPWork(S, n) ((S)->pointers = (n))
#define ssGetNumPWork(S) ((S)->pointers)
#define ssSetSampleTime(S, k, h) ((S)->period = (h))
#define ssSetOffsetTime(S, k, t) ((void)(S))
#define ssSetPWorkValue(S, k, p) ((S)->pointer[k] = (p))
#define ssGetPWorkValue(S, k) ((S)->pointer[k])
#define ssGetInputPortRealSignal(S, port) ((S)->in)
#define ssGetOutputPortRealSignal(S, port) ((S)->out[port])

#endif
