// The functions of FMI 3.0, on instances of Unit: see fmi3.h.
#include "fmi3.h"

#include <cmath>

#include "instance.hpp"

using namespace flexarm;
using Mode = Unit::Mode;

namespace {

std::function<void(const char*)> log_of(fmi3InstanceEnvironment environment, fmi3LogMessageCallback log) {
  return [environment, log](const char* what) {
    if (log) log(environment, fmi3Error, "logStatusError", what);
  };
}

void same_size(size_t count, size_t values) {
  if (count != values) bad_value("nValues", values, "must be " + std::to_string(count) + ": all variables are scalars");
}

}  // namespace

extern "C" {

const char* fmi3GetVersion(void) { return "3.0"; }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean, size_t count, const fmi3String categories[]) {
  return done<fmi3Status>(instance, [&](Unit&) { check_categories(categories, count); });
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String, fmi3String token, fmi3String resources, fmi3Boolean, fmi3Boolean,
                                          fmi3InstanceEnvironment environment, fmi3LogMessageCallback log) {
  return instantiate(token, resources, log_of(environment, log), true, false);
}
fmi3Instance fmi3InstantiateCoSimulation(fmi3String, fmi3String token, fmi3String resources, fmi3Boolean, fmi3Boolean,
                                         fmi3Boolean events, fmi3Boolean, const fmi3ValueReference[], size_t,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback) {
  return instantiate(token, resources, log_of(environment, log), false, events);
}
fmi3Instance fmi3InstantiateScheduledExecution(fmi3String, fmi3String, fmi3String, fmi3Boolean, fmi3Boolean,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback, fmi3LockPreemptionCallback,
                                               fmi3UnlockPreemptionCallback) {
  log_of(environment, log)("scheduled execution: this unit does not have it");
  return nullptr;
}
void fmi3FreeInstance(fmi3Instance instance) { delete static_cast<Instance*>(instance); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean, fmi3Float64, fmi3Float64 start, fmi3Boolean,
                                       fmi3Float64) {
  return done<fmi3Status>(instance, [&](Unit& unit) {
    unit.need("fmi3EnterInitializationMode", {Mode::instantiated});
    unit.start_at(start);
    unit.enter(Mode::initialising);
  });
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
  return done<fmi3Status>(instance, [](Unit& unit) {
    unit.need("fmi3ExitInitializationMode", {Mode::initialising});
    unit.begin();
  });
}
fmi3Status fmi3EnterEventMode(fmi3Instance instance) {
  return done<fmi3Status>(instance, [](Unit& unit) {
    unit.need("fmi3EnterEventMode", {Mode::continuous, unit.events() ? Mode::stepping : Mode::continuous});
    unit.enter(Mode::event);
  });
}
fmi3Status fmi3Terminate(fmi3Instance instance) {
  return done<fmi3Status>(instance, [](Unit& unit) {
    unit.need("fmi3Terminate", {Mode::event, Mode::continuous, Mode::stepping});
    unit.enter(Mode::terminated);
  });
}
fmi3Status fmi3Reset(fmi3Instance instance) {
  return done<fmi3Status>(instance, [](Unit& unit) { unit.reset(); });
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t count,
                          fmi3Float64 values[], size_t valueCount) {
  return done<fmi3Status>(instance, [&](Unit& unit) {
    same_size(count, valueCount);
    get(unit, references, count, values);
  });
}
fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t count,
                          const fmi3Float64 values[], size_t valueCount) {
  return done<fmi3Status>(instance, [&](Unit& unit) {
    same_size(count, valueCount);
    set(unit, references, count, values);
  });
}

#define FMI3_NONE(Type)                                                                                             \
  fmi3Status fmi3Get##Type(fmi3Instance instance, const fmi3ValueReference[], size_t count, fmi3##Type[], size_t) { \
    return none<fmi3Status>(instance, count, #Type, "Float64");                                                     \
  }                                                                                                                 \
  fmi3Status fmi3Set##Type(fmi3Instance instance, const fmi3ValueReference[], size_t count, const fmi3##Type[],     \
                           size_t) {                                                                                \
    return none<fmi3Status>(instance, count, #Type, "Float64");                                                     \
  }
FMI3_NONE(Float32)
FMI3_NONE(Int8)
FMI3_NONE(UInt8)
FMI3_NONE(Int16)
FMI3_NONE(UInt16)
FMI3_NONE(Int32)
FMI3_NONE(UInt32)
FMI3_NONE(Int64)
FMI3_NONE(UInt64)
FMI3_NONE(Boolean)
FMI3_NONE(String)
fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference[], size_t count, size_t[], fmi3Binary[],
                         size_t) {
  return none<fmi3Status>(instance, count, "Binary", "Float64");
}
fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference[], size_t count, const size_t[],
                         const fmi3Binary[], size_t) {
  return none<fmi3Status>(instance, count, "Binary", "Float64");
}
fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference[], size_t count, fmi3Clock[]) {
  return none<fmi3Status>(instance, count, "Clock", "Float64");
}
fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference[], size_t count, const fmi3Clock[]) {
  return none<fmi3Status>(instance, count, "Clock", "Float64");
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference, size_t*) {
  return missing<fmi3Status>(instance, "fmi3GetNumberOfVariableDependencies");
}
fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference, size_t[], fmi3ValueReference[],
                                       size_t[], fmi3DependencyKind[], size_t) {
  return missing<fmi3Status>(instance, "fmi3GetVariableDependencies");
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState* state) {
  return done<fmi3Status>(instance, [&](Unit& unit) { keep(unit, state); });
}
fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) {
  return done<fmi3Status>(instance, [&](Unit& unit) { take_back(unit, state); });
}
fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState* state) {
  return done<fmi3Status>(instance, [&](Unit&) { forget(state); });
}
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t* size) {
  return done<fmi3Status>(instance, [&](Unit&) { needs("size", {size}), *size = bytes(state); });
}
fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte to[], size_t size) {
  return done<fmi3Status>(instance, [&](Unit& unit) { write(unit, state, to, size); });
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte from[], size_t size, fmi3FMUState* state) {
  return done<fmi3Status>(instance, [&](Unit& unit) { read(unit, from, size, state); });
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t unknownCount,
                                        const fmi3ValueReference knowns[], size_t knownCount, const fmi3Float64 seed[],
                                        size_t seedCount, fmi3Float64 sensitivity[], size_t sensitivityCount) {
  return done<fmi3Status>(instance, [&](Unit& unit) {
    same_size(knownCount, seedCount);
    same_size(unknownCount, sensitivityCount);
    slopes(unit, unknowns, unknownCount, knowns, knownCount, seed, sensitivity);
  });
}
fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference[], size_t,
                                    const fmi3ValueReference[], size_t, const fmi3Float64[], size_t, fmi3Float64[],
                                    size_t) {
  return missing<fmi3Status>(instance, "fmi3GetAdjointDerivative");
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance) {
  return missing<fmi3Status>(instance, "fmi3EnterConfigurationMode");
}
fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance) {
  return missing<fmi3Status>(instance, "fmi3ExitConfigurationMode");
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference[], size_t count, fmi3Float64[],
                                  fmi3IntervalQualifier[]) {
  return none<fmi3Status>(instance, count, "Clock", "Float64");
}
fmi3Status fmi3GetIntervalFraction(fmi3Instance instance, const fmi3ValueReference[], size_t count, fmi3UInt64[],
                                   fmi3UInt64[], fmi3IntervalQualifier[]) {
  return none<fmi3Status>(instance, count, "Clock", "Float64");
}
fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, const fmi3ValueReference[], size_t count, fmi3Float64[]) {
  return none<fmi3Status>(instance, count, "Clock", "Float64");
}
fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const fmi3ValueReference[], size_t count, fmi3UInt64[],
                                fmi3UInt64[]) {
  return none<fmi3Status>(instance, count, "Clock", "Float64");
}
fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference[], size_t count,
                                  const fmi3Float64[]) {
  return none<fmi3Status>(instance, count, "Clock", "Float64");
}
fmi3Status fmi3SetIntervalFraction(fmi3Instance instance, const fmi3ValueReference[], size_t count, const fmi3UInt64[],
                                   const fmi3UInt64[]) {
  return none<fmi3Status>(instance, count, "Clock", "Float64");
}
fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, const fmi3ValueReference[], size_t count, const fmi3Float64[]) {
  return none<fmi3Status>(instance, count, "Clock", "Float64");
}
fmi3Status fmi3SetShiftFraction(fmi3Instance instance, const fmi3ValueReference[], size_t count, const fmi3UInt64[],
                                const fmi3UInt64[]) {
  return none<fmi3Status>(instance, count, "Clock", "Float64");
}
fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference, fmi3Float64) {
  return missing<fmi3Status>(instance, "fmi3ActivateModelPartition");
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance) {
  return done<fmi3Status>(
      instance, [](Unit& unit) { unit.need("fmi3EvaluateDiscreteStates", {Mode::initialising, Mode::event}); });
}
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean* again, fmi3Boolean* terminate,
                                    fmi3Boolean* nominalsChanged, fmi3Boolean* valuesChanged,
                                    fmi3Boolean* nextTimeDefined, fmi3Float64* nextTime) {
  return done<fmi3Status>(instance, [&](Unit& unit) {
    needs("results", {again, terminate, nominalsChanged, valuesChanged, nextTimeDefined, nextTime});
    const AfterEvent now = event(unit, "fmi3UpdateDiscreteStates");
    *again = *terminate = *nominalsChanged = false;
    *valuesChanged = now.anew;
    *nextTimeDefined = std::isfinite(now.next);
    if (*nextTimeDefined) *nextTime = now.next;
  });
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance) {
  return done<fmi3Status>(instance, [](Unit& unit) {
    unit.need("fmi3EnterContinuousTimeMode", {Mode::event});
    unit.exchange();
    unit.enter(Mode::continuous);
  });
}
fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean, fmi3Boolean* enterEventMode,
                                       fmi3Boolean* terminate) {
  return done<fmi3Status>(instance, [&](Unit& unit) {
    unit.need("fmi3CompletedIntegratorStep", {Mode::continuous});
    needs("results", {enterEventMode, terminate});
    *enterEventMode = *terminate = false;
  });
}
fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time) {
  return done<fmi3Status>(instance, [&](Unit& unit) { set_time(unit, time); });
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 x[], size_t count) {
  return done<fmi3Status>(instance, [&](Unit& unit) { set_states(unit, x, count); });
}
fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 x[], size_t count) {
  return done<fmi3Status>(instance, [&](Unit& unit) { get_states(unit, x, count); });
}
fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 dx[], size_t count) {
  return done<fmi3Status>(instance, [&](Unit& unit) { get_rates(unit, dx, count); });
}
fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t count) {
  return done<fmi3Status>(instance, [&](Unit& unit) { get_nominals(unit, nominals, count); });
}
fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 indicators[], size_t count) {
  return done<fmi3Status>(instance, [&](Unit& unit) { get_indicators(unit, indicators, count); });
}
fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t* count) {
  return done<fmi3Status>(instance, [&](Unit& unit) { needs("count", {count}), *count = unit.indicators().size(); });
}
fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t* count) {
  return done<fmi3Status>(instance, [&](Unit& unit) {
    needs("count", {count});
    Exchange& model = unit.exchange();
    *count = model.coordinates().size() + model.rates().size();
  });
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, const fmi3ValueReference[], size_t, const fmi3Int32[],
                                    fmi3Float64[], size_t) {
  return missing<fmi3Status>(instance, "fmi3GetOutputDerivatives");
}
fmi3Status fmi3EnterStepMode(fmi3Instance instance) {
  return done<fmi3Status>(instance, [](Unit& unit) {
    unit.need("fmi3EnterStepMode", {Mode::event});
    if (unit.exchanges()) bad_value("instance", "of model exchange", "fmi3EnterStepMode is a call of co-simulation");
    unit.enter(Mode::stepping);
  });
}
fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 now, fmi3Float64 step, fmi3Boolean, fmi3Boolean* eventNeeded,
                      fmi3Boolean* terminate, fmi3Boolean* early, fmi3Float64* reached) {
  return done<fmi3Status>(instance, [&](Unit& unit) {
    needs("results", {eventNeeded, terminate, early, reached});
    *eventNeeded = *terminate = *early = false;
    unit.need("fmi3DoStep", {Mode::stepping});
    *reached = unit.t();
    *reached = unit.advance(now, step);
  });
}

}  // extern "C"
