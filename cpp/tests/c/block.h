#ifndef BLOCK_H
#define BLOCK_H
#include "simstruc.h"

/* Runs the block of sfun_flexarm.c. Gives its error, or NULL. */
const char* run_block(SimStruct* S, int steps);

#endif
