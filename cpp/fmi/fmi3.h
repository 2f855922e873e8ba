/* The functions of FMI 3.0 that a unit exports, and their types, after the standard (Functional Mock-up Interface
 * 3.0.1, sections 2.2 to 5.4; Modelica Association 2023).
 */
#ifndef FLEXARM_FMI3_H
#define FLEXARM_FMI3_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#if defined(__GNUC__)
#define FMI3_API __attribute__((visibility("default")))
#else
#define FMI3_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef void* fmi3Instance;
typedef void* fmi3InstanceEnvironment;
typedef void* fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean;
typedef const char* fmi3String;
typedef uint8_t fmi3Byte;
typedef const fmi3Byte* fmi3Binary;
typedef bool fmi3Clock;

typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum { fmi3Independent, fmi3Constant, fmi3Fixed, fmi3Tunable, fmi3Discrete, fmi3Dependent } fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown, fmi3IntervalUnchanged, fmi3IntervalChanged } fmi3IntervalQualifier;

typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String category, fmi3String message);
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64 time, fmi3Boolean setRequested,
                                               fmi3Boolean getAllowed, fmi3Boolean stepFinished,
                                               fmi3Boolean canReturnEarly, fmi3Boolean* returnRequested,
                                               fmi3Float64* returnTime);
typedef void (*fmi3LockPreemptionCallback)(void);
typedef void (*fmi3UnlockPreemptionCallback)(void);

FMI3_API const char* fmi3GetVersion(void);
FMI3_API fmi3Status fmi3SetDebugLogging(fmi3Instance, fmi3Boolean on, size_t count, const fmi3String categories[]);

FMI3_API fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                                   fmi3Boolean visible, fmi3Boolean logging, fmi3InstanceEnvironment,
                                                   fmi3LogMessageCallback);
FMI3_API fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                                  fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean eventModeUsed,
                                                  fmi3Boolean earlyReturnAllowed, const fmi3ValueReference required[],
                                                  size_t requiredCount, fmi3InstanceEnvironment, fmi3LogMessageCallback,
                                                  fmi3IntermediateUpdateCallback);
FMI3_API fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                                        fmi3Boolean visible, fmi3Boolean logging,
                                                        fmi3InstanceEnvironment, fmi3LogMessageCallback,
                                                        fmi3ClockUpdateCallback, fmi3LockPreemptionCallback,
                                                        fmi3UnlockPreemptionCallback);
FMI3_API void fmi3FreeInstance(fmi3Instance);

FMI3_API fmi3Status fmi3EnterInitializationMode(fmi3Instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                                fmi3Float64 startTime, fmi3Boolean stopTimeDefined,
                                                fmi3Float64 stopTime);
FMI3_API fmi3Status fmi3ExitInitializationMode(fmi3Instance);
FMI3_API fmi3Status fmi3EnterEventMode(fmi3Instance);
FMI3_API fmi3Status fmi3Terminate(fmi3Instance);
FMI3_API fmi3Status fmi3Reset(fmi3Instance);

/* Variables: all of a unit's are Float64. */
#define FMI3_NUMBERS(Type)                                                                                             \
  FMI3_API fmi3Status fmi3Get##Type(fmi3Instance, const fmi3ValueReference[], size_t count, fmi3##Type values[],       \
                                    size_t valueCount);                                                                \
  FMI3_API fmi3Status fmi3Set##Type(fmi3Instance, const fmi3ValueReference[], size_t count, const fmi3##Type values[], \
                                    size_t valueCount);
FMI3_NUMBERS(Float32)
FMI3_NUMBERS(Float64)
FMI3_NUMBERS(Int8)
FMI3_NUMBERS(UInt8)
FMI3_NUMBERS(Int16)
FMI3_NUMBERS(UInt16)
FMI3_NUMBERS(Int32)
FMI3_NUMBERS(UInt32)
FMI3_NUMBERS(Int64)
FMI3_NUMBERS(UInt64)
FMI3_NUMBERS(Boolean)
FMI3_NUMBERS(String)
#undef FMI3_NUMBERS
FMI3_API fmi3Status fmi3GetBinary(fmi3Instance, const fmi3ValueReference[], size_t count, size_t sizes[],
                                  fmi3Binary values[], size_t valueCount);
FMI3_API fmi3Status fmi3SetBinary(fmi3Instance, const fmi3ValueReference[], size_t count, const size_t sizes[],
                                  const fmi3Binary values[], size_t valueCount);
FMI3_API fmi3Status fmi3GetClock(fmi3Instance, const fmi3ValueReference[], size_t count, fmi3Clock values[]);
FMI3_API fmi3Status fmi3SetClock(fmi3Instance, const fmi3ValueReference[], size_t count, const fmi3Clock values[]);

FMI3_API fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance, fmi3ValueReference, size_t* count);
FMI3_API fmi3Status fmi3GetVariableDependencies(fmi3Instance, fmi3ValueReference dependent, size_t dependentElements[],
                                                fmi3ValueReference independents[], size_t independentElements[],
                                                fmi3DependencyKind kinds[], size_t count);

FMI3_API fmi3Status fmi3GetFMUState(fmi3Instance, fmi3FMUState*);
FMI3_API fmi3Status fmi3SetFMUState(fmi3Instance, fmi3FMUState);
FMI3_API fmi3Status fmi3FreeFMUState(fmi3Instance, fmi3FMUState*);
FMI3_API fmi3Status fmi3SerializedFMUStateSize(fmi3Instance, fmi3FMUState, size_t* size);
FMI3_API fmi3Status fmi3SerializeFMUState(fmi3Instance, fmi3FMUState, fmi3Byte bytes[], size_t size);
FMI3_API fmi3Status fmi3DeserializeFMUState(fmi3Instance, const fmi3Byte bytes[], size_t size, fmi3FMUState*);

FMI3_API fmi3Status fmi3GetDirectionalDerivative(fmi3Instance, const fmi3ValueReference unknowns[], size_t unknownCount,
                                                 const fmi3ValueReference knowns[], size_t knownCount,
                                                 const fmi3Float64 seed[], size_t seedCount, fmi3Float64 sensitivity[],
                                                 size_t sensitivityCount);
FMI3_API fmi3Status fmi3GetAdjointDerivative(fmi3Instance, const fmi3ValueReference unknowns[], size_t unknownCount,
                                             const fmi3ValueReference knowns[], size_t knownCount,
                                             const fmi3Float64 seed[], size_t seedCount, fmi3Float64 sensitivity[],
                                             size_t sensitivityCount);

FMI3_API fmi3Status fmi3EnterConfigurationMode(fmi3Instance);
FMI3_API fmi3Status fmi3ExitConfigurationMode(fmi3Instance);

/* Clocks, which no unit has. */
FMI3_API fmi3Status fmi3GetIntervalDecimal(fmi3Instance, const fmi3ValueReference[], size_t, fmi3Float64[],
                                           fmi3IntervalQualifier[]);
FMI3_API fmi3Status fmi3GetIntervalFraction(fmi3Instance, const fmi3ValueReference[], size_t, fmi3UInt64[],
                                            fmi3UInt64[], fmi3IntervalQualifier[]);
FMI3_API fmi3Status fmi3GetShiftDecimal(fmi3Instance, const fmi3ValueReference[], size_t, fmi3Float64[]);
FMI3_API fmi3Status fmi3GetShiftFraction(fmi3Instance, const fmi3ValueReference[], size_t, fmi3UInt64[], fmi3UInt64[]);
FMI3_API fmi3Status fmi3SetIntervalDecimal(fmi3Instance, const fmi3ValueReference[], size_t, const fmi3Float64[]);
FMI3_API fmi3Status fmi3SetIntervalFraction(fmi3Instance, const fmi3ValueReference[], size_t, const fmi3UInt64[],
                                            const fmi3UInt64[]);
FMI3_API fmi3Status fmi3SetShiftDecimal(fmi3Instance, const fmi3ValueReference[], size_t, const fmi3Float64[]);
FMI3_API fmi3Status fmi3SetShiftFraction(fmi3Instance, const fmi3ValueReference[], size_t, const fmi3UInt64[],
                                         const fmi3UInt64[]);
FMI3_API fmi3Status fmi3ActivateModelPartition(fmi3Instance, fmi3ValueReference, fmi3Float64 time);

FMI3_API fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance);
FMI3_API fmi3Status fmi3UpdateDiscreteStates(fmi3Instance, fmi3Boolean* again, fmi3Boolean* terminate,
                                             fmi3Boolean* nominalsChanged, fmi3Boolean* valuesChanged,
                                             fmi3Boolean* nextTimeDefined, fmi3Float64* nextTime);

FMI3_API fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance);
FMI3_API fmi3Status fmi3CompletedIntegratorStep(fmi3Instance, fmi3Boolean noSetStatePrior, fmi3Boolean* enterEventMode,
                                                fmi3Boolean* terminate);
FMI3_API fmi3Status fmi3SetTime(fmi3Instance, fmi3Float64 time);
FMI3_API fmi3Status fmi3SetContinuousStates(fmi3Instance, const fmi3Float64 states[], size_t count);
FMI3_API fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance, fmi3Float64 derivatives[], size_t count);
FMI3_API fmi3Status fmi3GetEventIndicators(fmi3Instance, fmi3Float64 indicators[], size_t count);
FMI3_API fmi3Status fmi3GetContinuousStates(fmi3Instance, fmi3Float64 states[], size_t count);
FMI3_API fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance, fmi3Float64 nominals[], size_t count);
FMI3_API fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance, size_t* count);
FMI3_API fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance, size_t* count);

FMI3_API fmi3Status fmi3GetOutputDerivatives(fmi3Instance, const fmi3ValueReference[], size_t count,
                                             const fmi3Int32 orders[], fmi3Float64 values[], size_t valueCount);
FMI3_API fmi3Status fmi3EnterStepMode(fmi3Instance);
FMI3_API fmi3Status fmi3DoStep(fmi3Instance, fmi3Float64 now, fmi3Float64 step, fmi3Boolean noSetStatePrior,
                               fmi3Boolean* eventHandlingNeeded, fmi3Boolean* terminate, fmi3Boolean* earlyReturn,
                               fmi3Float64* lastSuccessfulTime);

#ifdef __cplusplus
}
#endif

#endif
