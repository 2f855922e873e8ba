/* What Simulink calls of a block, in its order: by run_block in test_c_interface.c. */
#include "block.h"

char* mxArrayToString(const mxArray* from) {
  char* out = (char*)malloc(strlen(from->text) + 1);
  return out ? strcpy(out, from->text) : NULL;
}

const char* run_block(SimStruct* S, int steps) {
  int k;
  mdlInitializeSizes(S);
  if (S->error) return S->error;
  mdlInitializeSampleTimes(S);
  mdlStart(S);
  for (k = 0; k < steps && !S->error; ++k) {
    mdlOutputs(S, 0);
    mdlUpdate(S, 0);
  }
  if (!S->error) mdlOutputs(S, 0);
  mdlTerminate(S);
  return S->error;
}
