// The functions of FMI 3.0, on instances of Unit: see fmi3.h.
#include "fmi3.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "flexarm/check.hpp"
#include "unit.hpp"

using namespace flexarm;
using Mode = Unit::Mode;

namespace {

struct Importer {
  fmi3InstanceEnvironment environment;
  fmi3LogMessageCallback log;

  fmi3Status fails(const char* what) const {
    if (log) log(environment, fmi3Error, "logStatusError", what);
    return fmi3Error;
  }
};

struct Instance {
  Importer importer;
  Unit unit;
};

Instance& of(fmi3Instance instance) { return *static_cast<Instance*>(instance); }

/// Does work on a unit, which may throw.
template <class Work>
fmi3Status done(fmi3Instance instance, const Work& work) {
  if (!instance) return fmi3Error;
  try {
    work(of(instance).unit);
    return fmi3OK;
  } catch (const std::exception& e) {
    return of(instance).importer.fails(e.what());
  }
}

/// The folder of an importer that gives a URI, too.
std::string folder(fmi3String resources) {
  if (!resources) bad_value("resourcePath", "NULL", "must be the path of the unit's resources");
  const std::string path = resources;
  return path.rfind("file://", 0) == 0 ? path.substr(7) : path;
}

fmi3Instance instance(fmi3String token, fmi3String resources, const Importer& importer, bool exchanges) {
  try {
    Resources content = Resources::load(folder(resources));
    if (!token || content.token != token)
      bad_value("instantiationToken", token ? token : "NULL", "must be " + content.token);
    return new Instance{importer, Unit(std::move(content), exchanges)};
  } catch (const std::exception& e) {
    importer.fails(e.what());
    return nullptr;
  }
}

void same_size(size_t count, size_t values) {
  if (count != values) bad_value("nValues", values, "must be " + std::to_string(count) + ": all variables are scalars");
}

std::vector<std::size_t> list(const fmi3ValueReference from[], size_t count) {
  return std::vector<std::size_t>(from, from + count);
}

/// Of the variables of another type than Float64, which there are none of.
fmi3Status none(fmi3Instance instance, size_t count, const char* type) {
  return done(instance, [&](Unit&) {
    if (count > 0) bad_value("valueReferences", count, std::string("variables of ") + type + ": all are Float64");
  });
}

fmi3Status missing(fmi3Instance instance, const char* call) {
  return done(instance,
              [&](Unit&) { throw std::invalid_argument(std::string(call) + ": this unit does not have it"); });
}

/// The state that the importer keeps.
const Unit::State& kept(fmi3FMUState state) {
  if (!state) bad_value("FMUState", "NULL", "must be given");
  return *static_cast<const Unit::State*>(state);
}

}  // namespace

extern "C" {

const char* fmi3GetVersion(void) { return "3.0"; }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean, size_t count, const fmi3String categories[]) {
  return done(instance, [&](Unit&) {  // errors are always told
    for (size_t k = 0; k < count; ++k)
      if (std::strcmp(categories[k], "logStatusError") != 0)
        bad_value("category", categories[k], "must be logStatusError");
  });
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String, fmi3String token, fmi3String resources, fmi3Boolean, fmi3Boolean,
                                          fmi3InstanceEnvironment environment, fmi3LogMessageCallback log) {
  return instance(token, resources, {environment, log}, true);
}
fmi3Instance fmi3InstantiateCoSimulation(fmi3String, fmi3String token, fmi3String resources, fmi3Boolean, fmi3Boolean,
                                         fmi3Boolean, fmi3Boolean, const fmi3ValueReference[], size_t,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback) {
  return instance(token, resources, {environment, log}, false);
}
fmi3Instance fmi3InstantiateScheduledExecution(fmi3String, fmi3String, fmi3String, fmi3Boolean, fmi3Boolean,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback, fmi3LockPreemptionCallback,
                                               fmi3UnlockPreemptionCallback) {
  Importer{environment, log}.fails("scheduled execution: this unit does not have it");
  return nullptr;
}
void fmi3FreeInstance(fmi3Instance instance) { delete static_cast<Instance*>(instance); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean, fmi3Float64, fmi3Float64 start, fmi3Boolean,
                                       fmi3Float64) {
  return done(instance, [&](Unit& unit) {
    unit.need("fmi3EnterInitializationMode", {Mode::instantiated});
    unit.initialise(start);
  });
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
  return done(instance, [](Unit& unit) {
    unit.need("fmi3ExitInitializationMode", {Mode::initialising});
    unit.begin();
  });
}
fmi3Status fmi3EnterEventMode(fmi3Instance instance) {
  return done(instance, [](Unit& unit) {
    unit.need("fmi3EnterEventMode", {Mode::continuous});
    unit.enter(Mode::event);
  });
}
fmi3Status fmi3Terminate(fmi3Instance instance) {
  return done(instance, [](Unit& unit) {
    unit.need("fmi3Terminate", {Mode::event, Mode::continuous, Mode::stepping});
    unit.enter(Mode::terminated);
  });
}
fmi3Status fmi3Reset(fmi3Instance instance) {
  return done(instance, [](Unit& unit) { unit.reset(); });
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t count,
                          fmi3Float64 values[], size_t valueCount) {
  return done(instance, [&](Unit& unit) {
    same_size(count, valueCount);
    for (size_t k = 0; k < count; ++k) values[k] = unit.get(references[k]);
  });
}
fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t count,
                          const fmi3Float64 values[], size_t valueCount) {
  return done(instance, [&](Unit& unit) {
    same_size(count, valueCount);
    for (size_t k = 0; k < count; ++k) unit.set(references[k], values[k]);
  });
}

#define FMI3_NONE(Type)                                                                                             \
  fmi3Status fmi3Get##Type(fmi3Instance instance, const fmi3ValueReference[], size_t count, fmi3##Type[], size_t) { \
    return none(instance, count, #Type);                                                                            \
  }                                                                                                                 \
  fmi3Status fmi3Set##Type(fmi3Instance instance, const fmi3ValueReference[], size_t count, const fmi3##Type[],     \
                           size_t) {                                                                                \
    return none(instance, count, #Type);                                                                            \
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
  return none(instance, count, "Binary");
}
fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference[], size_t count, const size_t[],
                         const fmi3Binary[], size_t) {
  return none(instance, count, "Binary");
}
fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference[], size_t count, fmi3Clock[]) {
  return none(instance, count, "Clock");
}
fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference[], size_t count, const fmi3Clock[]) {
  return none(instance, count, "Clock");
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference, size_t*) {
  return missing(instance, "fmi3GetNumberOfVariableDependencies");
}
fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference, size_t[], fmi3ValueReference[],
                                       size_t[], fmi3DependencyKind[], size_t) {
  return missing(instance, "fmi3GetVariableDependencies");
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState* state) {
  return done(instance, [&](Unit& unit) {
    if (!*state) *state = new Unit::State;
    *static_cast<Unit::State*>(*state) = unit.state();
  });
}
fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) {
  return done(instance, [&](Unit& unit) { unit.restore(kept(state)); });
}
fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState* state) {
  return done(instance, [&](Unit&) {
    delete static_cast<Unit::State*>(*state);
    *state = nullptr;
  });
}
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t* size) {
  return done(instance, [&](Unit&) { *size = kept(state).numbers.size() * sizeof(double); });
}
fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
  return done(instance, [&](Unit& unit) {
    unit.check_bytes();
    const std::vector<double>& numbers = kept(state).numbers;
    if (size < numbers.size() * sizeof(double)) bad_value("size", size, "must be that of fmi3SerializedFMUStateSize");
    std::memcpy(bytes, numbers.data(), numbers.size() * sizeof(double));
  });
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState* state) {
  return done(instance, [&](Unit& unit) {
    unit.check_bytes();
    auto out = std::make_unique<Unit::State>();
    out->numbers.resize(size / sizeof(double));
    std::memcpy(out->numbers.data(), bytes, out->numbers.size() * sizeof(double));
    delete static_cast<Unit::State*>(*state);
    *state = out.release();
  });
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t unknownCount,
                                        const fmi3ValueReference knowns[], size_t knownCount, const fmi3Float64 seed[],
                                        size_t seedCount, fmi3Float64 sensitivity[], size_t sensitivityCount) {
  return done(instance, [&](Unit& unit) {
    same_size(knownCount, seedCount);
    same_size(unknownCount, sensitivityCount);
    unit.slopes(list(unknowns, unknownCount), list(knowns, knownCount), seed, sensitivity);
  });
}
fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference[], size_t,
                                    const fmi3ValueReference[], size_t, const fmi3Float64[], size_t, fmi3Float64[],
                                    size_t) {
  return missing(instance, "fmi3GetAdjointDerivative");
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance) { return missing(instance, "fmi3EnterConfigurationMode"); }
fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance) { return missing(instance, "fmi3ExitConfigurationMode"); }

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference[], size_t count, fmi3Float64[],
                                  fmi3IntervalQualifier[]) {
  return none(instance, count, "Clock");
}
fmi3Status fmi3GetIntervalFraction(fmi3Instance instance, const fmi3ValueReference[], size_t count, fmi3UInt64[],
                                   fmi3UInt64[], fmi3IntervalQualifier[]) {
  return none(instance, count, "Clock");
}
fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, const fmi3ValueReference[], size_t count, fmi3Float64[]) {
  return none(instance, count, "Clock");
}
fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const fmi3ValueReference[], size_t count, fmi3UInt64[],
                                fmi3UInt64[]) {
  return none(instance, count, "Clock");
}
fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference[], size_t count,
                                  const fmi3Float64[]) {
  return none(instance, count, "Clock");
}
fmi3Status fmi3SetIntervalFraction(fmi3Instance instance, const fmi3ValueReference[], size_t count, const fmi3UInt64[],
                                   const fmi3UInt64[]) {
  return none(instance, count, "Clock");
}
fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, const fmi3ValueReference[], size_t count, const fmi3Float64[]) {
  return none(instance, count, "Clock");
}
fmi3Status fmi3SetShiftFraction(fmi3Instance instance, const fmi3ValueReference[], size_t count, const fmi3UInt64[],
                                const fmi3UInt64[]) {
  return none(instance, count, "Clock");
}
fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference, fmi3Float64) {
  return missing(instance, "fmi3ActivateModelPartition");
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance) {
  return done(instance, [](Unit&) {});
}
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean* again, fmi3Boolean* terminate,
                                    fmi3Boolean* nominalsChanged, fmi3Boolean* valuesChanged,
                                    fmi3Boolean* nextTimeDefined, fmi3Float64* nextTime) {
  return done(instance, [&](Unit& unit) {
    unit.need("fmi3UpdateDiscreteStates", {Mode::event});
    *again = *terminate = *nominalsChanged = false;
    Exchange& model = unit.exchange();
    *valuesChanged = model.event();
    const double next = model.next_event();
    *nextTimeDefined = std::isfinite(next);
    if (*nextTimeDefined) *nextTime = next;
  });
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance) {
  return done(instance, [](Unit& unit) {
    unit.need("fmi3EnterContinuousTimeMode", {Mode::event});
    unit.exchange();
    unit.enter(Mode::continuous);
  });
}
fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean, fmi3Boolean* enterEventMode,
                                       fmi3Boolean* terminate) {
  return done(instance, [&](Unit&) { *enterEventMode = *terminate = false; });
}
fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time) {
  return done(instance, [&](Unit& unit) { unit.exchange().set_time(time); });
}

namespace {

/// The free coordinates and rates of an instance.
void states(Exchange& model, size_t count) {
  const size_t right = model.coordinates().size() + model.rates().size();
  if (count != right) bad_value("nContinuousStates", count, "must be " + std::to_string(right));
}

}  // namespace

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 x[], size_t count) {
  return done(instance, [&](Unit& unit) {
    Exchange& model = unit.exchange();
    states(model, count);
    model.place(x);
  });
}
fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 x[], size_t count) {
  return done(instance, [&](Unit& unit) {
    Exchange& model = unit.exchange();
    states(model, count);
    for (const int i : model.coordinates()) *x++ = model.q()[i];
    for (const int i : model.rates()) *x++ = model.v()[i];
  });
}
fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 dx[], size_t count) {
  return done(instance, [&](Unit& unit) {
    Exchange& model = unit.exchange();
    states(model, count);
    const Eigen::VectorXd &a = model.a(), &dq = model.coordinate_rates();
    for (const int i : model.coordinates()) *dx++ = dq[i];
    for (const int i : model.rates()) *dx++ = a[i];
  });
}
fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t count) {
  return done(instance, [&](Unit& unit) {
    states(unit.exchange(), count);
    for (size_t k = 0; k < count; ++k) nominals[k] = unit.nominal(k);
  });
}
fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 indicators[], size_t count) {
  return done(instance, [&](Unit& unit) {
    const std::vector<std::size_t>& all = unit.indicators();
    if (count != all.size()) bad_value("nEventIndicators", count, "must be " + std::to_string(all.size()));
    for (size_t k = 0; k < count; ++k) indicators[k] = unit.get(all[k]);
  });
}
fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t* count) {
  return done(instance, [&](Unit& unit) { *count = unit.indicators().size(); });
}
fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t* count) {
  return done(instance, [&](Unit& unit) {
    Exchange& model = unit.exchange();
    *count = model.coordinates().size() + model.rates().size();
  });
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, const fmi3ValueReference[], size_t, const fmi3Int32[],
                                    fmi3Float64[], size_t) {
  return missing(instance, "fmi3GetOutputDerivatives");
}
fmi3Status fmi3EnterStepMode(fmi3Instance instance) {
  return done(instance, [](Unit& unit) { unit.need("fmi3EnterStepMode", {Mode::stepping}); });
}
fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 now, fmi3Float64 step, fmi3Boolean, fmi3Boolean* eventNeeded,
                      fmi3Boolean* terminate, fmi3Boolean* early, fmi3Float64* reached) {
  return done(instance, [&](Unit& unit) {
    *eventNeeded = *terminate = *early = false;
    unit.need("fmi3DoStep", {Mode::stepping});
    *reached = unit.t();
    *reached = unit.advance(now, step);
  });
}

}  // extern "C"
