/* The functions of FMI 2.0 that a unit exports, and their types, after the standard (Functional Mock-up Interface
 * 2.0.4, sections 2.1 to 4.2; Modelica Association 2022).
 */
#ifndef FLEXARM_FMI2_H
#define FLEXARM_FMI2_H

#include <stddef.h>

#if defined(__GNUC__)
#define FMI2_API __attribute__((visibility("default")))
#else
#define FMI2_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef void* fmi2Component;
typedef void* fmi2ComponentEnvironment;
typedef void* fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef const fmi2Char* fmi2String;
typedef char fmi2Byte;

typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;

typedef struct {
  void (*logger)(fmi2ComponentEnvironment, fmi2String instance, fmi2Status, fmi2String category, fmi2String message,
                 ...);
  void* (*allocateMemory)(size_t count, size_t size);
  void (*freeMemory)(void*);
  void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
  fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

typedef struct {
  fmi2Boolean newDiscreteStatesNeeded;
  fmi2Boolean terminateSimulation;
  fmi2Boolean nominalsOfContinuousStatesChanged;
  fmi2Boolean valuesOfContinuousStatesChanged;
  fmi2Boolean nextEventTimeDefined;
  fmi2Real nextEventTime;
} fmi2EventInfo;

FMI2_API const char* fmi2GetTypesPlatform(void);
FMI2_API const char* fmi2GetVersion(void);
FMI2_API fmi2Status fmi2SetDebugLogging(fmi2Component, fmi2Boolean on, size_t count, const fmi2String categories[]);

FMI2_API fmi2Component fmi2Instantiate(fmi2String name, fmi2Type, fmi2String guid, fmi2String resources,
                                       const fmi2CallbackFunctions*, fmi2Boolean visible, fmi2Boolean logging);
FMI2_API void fmi2FreeInstance(fmi2Component);

FMI2_API fmi2Status fmi2SetupExperiment(fmi2Component, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                                        fmi2Real startTime, fmi2Boolean stopTimeDefined, fmi2Real stopTime);
FMI2_API fmi2Status fmi2EnterInitializationMode(fmi2Component);
FMI2_API fmi2Status fmi2ExitInitializationMode(fmi2Component);
FMI2_API fmi2Status fmi2Terminate(fmi2Component);
FMI2_API fmi2Status fmi2Reset(fmi2Component);

/* Variables: all of a unit's are Real. */
#define FMI2_NUMBERS(Type)                                                                                         \
  FMI2_API fmi2Status fmi2Get##Type(fmi2Component, const fmi2ValueReference[], size_t count, fmi2##Type values[]); \
  FMI2_API fmi2Status fmi2Set##Type(fmi2Component, const fmi2ValueReference[], size_t count, const fmi2##Type values[]);
FMI2_NUMBERS(Real)
FMI2_NUMBERS(Integer)
FMI2_NUMBERS(Boolean)
FMI2_NUMBERS(String)
#undef FMI2_NUMBERS

FMI2_API fmi2Status fmi2GetFMUstate(fmi2Component, fmi2FMUstate*);
FMI2_API fmi2Status fmi2SetFMUstate(fmi2Component, fmi2FMUstate);
FMI2_API fmi2Status fmi2FreeFMUstate(fmi2Component, fmi2FMUstate*);
FMI2_API fmi2Status fmi2SerializedFMUstateSize(fmi2Component, fmi2FMUstate, size_t* size);
FMI2_API fmi2Status fmi2SerializeFMUstate(fmi2Component, fmi2FMUstate, fmi2Byte bytes[], size_t size);
FMI2_API fmi2Status fmi2DeSerializeFMUstate(fmi2Component, const fmi2Byte bytes[], size_t size, fmi2FMUstate*);

FMI2_API fmi2Status fmi2GetDirectionalDerivative(fmi2Component, const fmi2ValueReference unknowns[],
                                                 size_t unknownCount, const fmi2ValueReference knowns[],
                                                 size_t knownCount, const fmi2Real seed[], fmi2Real sensitivity[]);

FMI2_API fmi2Status fmi2EnterEventMode(fmi2Component);
FMI2_API fmi2Status fmi2NewDiscreteStates(fmi2Component, fmi2EventInfo*);
FMI2_API fmi2Status fmi2EnterContinuousTimeMode(fmi2Component);
FMI2_API fmi2Status fmi2CompletedIntegratorStep(fmi2Component, fmi2Boolean noSetStatePrior, fmi2Boolean* enterEventMode,
                                                fmi2Boolean* terminate);
FMI2_API fmi2Status fmi2SetTime(fmi2Component, fmi2Real time);
FMI2_API fmi2Status fmi2SetContinuousStates(fmi2Component, const fmi2Real states[], size_t count);
FMI2_API fmi2Status fmi2GetDerivatives(fmi2Component, fmi2Real derivatives[], size_t count);
FMI2_API fmi2Status fmi2GetEventIndicators(fmi2Component, fmi2Real indicators[], size_t count);
FMI2_API fmi2Status fmi2GetContinuousStates(fmi2Component, fmi2Real states[], size_t count);
FMI2_API fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component, fmi2Real nominals[], size_t count);

FMI2_API fmi2Status fmi2SetRealInputDerivatives(fmi2Component, const fmi2ValueReference[], size_t count,
                                                const fmi2Integer orders[], const fmi2Real values[]);
FMI2_API fmi2Status fmi2GetRealOutputDerivatives(fmi2Component, const fmi2ValueReference[], size_t count,
                                                 const fmi2Integer orders[], fmi2Real values[]);
FMI2_API fmi2Status fmi2DoStep(fmi2Component, fmi2Real now, fmi2Real step, fmi2Boolean noSetStatePrior);
FMI2_API fmi2Status fmi2CancelStep(fmi2Component);
FMI2_API fmi2Status fmi2GetStatus(fmi2Component, fmi2StatusKind, fmi2Status* value);
FMI2_API fmi2Status fmi2GetRealStatus(fmi2Component, fmi2StatusKind, fmi2Real* value);
FMI2_API fmi2Status fmi2GetIntegerStatus(fmi2Component, fmi2StatusKind, fmi2Integer* value);
FMI2_API fmi2Status fmi2GetBooleanStatus(fmi2Component, fmi2StatusKind, fmi2Boolean* value);
FMI2_API fmi2Status fmi2GetStringStatus(fmi2Component, fmi2StatusKind, fmi2String* value);

#ifdef __cplusplus
}
#endif

#endif
