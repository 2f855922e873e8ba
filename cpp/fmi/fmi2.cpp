// The functions of FMI 2.0, on instances of Unit: see fmi2.h.
#include "fmi2.h"

#include <cmath>

#include "instance.hpp"

using namespace flexarm;
using Mode = Unit::Mode;

namespace {

/// The message is a format of printf.
std::string plain(const char* what) {
  std::string out;
  for (; *what; ++what) out += *what == '%' ? "%%" : std::string(1, *what);
  return out;
}

std::uint8_t* raw(fmi2Byte* bytes) { return reinterpret_cast<std::uint8_t*>(bytes); }

}  // namespace

extern "C" {

const char* fmi2GetTypesPlatform(void) { return "default"; }
const char* fmi2GetVersion(void) { return "2.0"; }
fmi2Status fmi2SetDebugLogging(fmi2Component instance, fmi2Boolean, size_t count, const fmi2String categories[]) {
  return done<fmi2Status>(instance, [&](Unit&) { check_categories(categories, count); });
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions* callbacks, fmi2Boolean, fmi2Boolean) {
  auto* const logger = callbacks ? callbacks->logger : nullptr;
  auto* const environment = callbacks ? callbacks->componentEnvironment : nullptr;
  const auto log = [logger, environment, called = std::string(name ? name : "")](const char* what) {
    if (logger) logger(environment, called.c_str(), fmi2Error, "logStatusError", plain(what).c_str());
  };
  return instantiate(guid, resources, log, type == fmi2ModelExchange, false);
}
void fmi2FreeInstance(fmi2Component instance) { delete static_cast<Instance*>(instance); }

fmi2Status fmi2SetupExperiment(fmi2Component instance, fmi2Boolean, fmi2Real, fmi2Real start, fmi2Boolean, fmi2Real) {
  return done<fmi2Status>(instance, [&](Unit& unit) {
    unit.need("fmi2SetupExperiment", {Mode::instantiated});
    unit.start_at(start);
  });
}
fmi2Status fmi2EnterInitializationMode(fmi2Component instance) {
  return done<fmi2Status>(instance, [](Unit& unit) {
    unit.need("fmi2EnterInitializationMode", {Mode::instantiated});
    unit.enter(Mode::initialising);
  });
}
fmi2Status fmi2ExitInitializationMode(fmi2Component instance) {
  return done<fmi2Status>(instance, [](Unit& unit) {
    unit.need("fmi2ExitInitializationMode", {Mode::initialising});
    unit.begin();
  });
}
fmi2Status fmi2Terminate(fmi2Component instance) {
  return done<fmi2Status>(instance, [](Unit& unit) {
    unit.need("fmi2Terminate", {Mode::event, Mode::continuous, Mode::stepping});
    unit.enter(Mode::terminated);
  });
}
fmi2Status fmi2Reset(fmi2Component instance) {
  return done<fmi2Status>(instance, [](Unit& unit) { unit.reset(); });
}

fmi2Status fmi2GetReal(fmi2Component instance, const fmi2ValueReference references[], size_t count, fmi2Real values[]) {
  return done<fmi2Status>(instance, [&](Unit& unit) { get(unit, references, count, values); });
}
fmi2Status fmi2SetReal(fmi2Component instance, const fmi2ValueReference references[], size_t count,
                       const fmi2Real values[]) {
  return done<fmi2Status>(instance, [&](Unit& unit) { set(unit, references, count, values); });
}
#define FMI2_NONE(Type)                                                                                            \
  fmi2Status fmi2Get##Type(fmi2Component instance, const fmi2ValueReference[], size_t count, fmi2##Type[]) {       \
    return none<fmi2Status>(instance, count, #Type, "Real");                                                       \
  }                                                                                                                \
  fmi2Status fmi2Set##Type(fmi2Component instance, const fmi2ValueReference[], size_t count, const fmi2##Type[]) { \
    return none<fmi2Status>(instance, count, #Type, "Real");                                                       \
  }
FMI2_NONE(Integer)
FMI2_NONE(Boolean)
FMI2_NONE(String)

fmi2Status fmi2GetFMUstate(fmi2Component instance, fmi2FMUstate* state) {
  return done<fmi2Status>(instance, [&](Unit& unit) { keep(unit, state); });
}
fmi2Status fmi2SetFMUstate(fmi2Component instance, fmi2FMUstate state) {
  return done<fmi2Status>(instance, [&](Unit& unit) { take_back(unit, state); });
}
fmi2Status fmi2FreeFMUstate(fmi2Component instance, fmi2FMUstate* state) {
  return done<fmi2Status>(instance, [&](Unit&) { forget(state); });
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component instance, fmi2FMUstate state, size_t* size) {
  return done<fmi2Status>(instance, [&](Unit&) { needs("size", {size}), *size = bytes(state); });
}
fmi2Status fmi2SerializeFMUstate(fmi2Component instance, fmi2FMUstate state, fmi2Byte to[], size_t size) {
  return done<fmi2Status>(instance, [&](Unit& unit) { write(unit, state, raw(to), size); });
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component instance, const fmi2Byte from[], size_t size, fmi2FMUstate* state) {
  return done<fmi2Status>(instance, [&](Unit& unit) { read(unit, raw(const_cast<fmi2Byte*>(from)), size, state); });
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component instance, const fmi2ValueReference unknowns[],
                                        size_t unknownCount, const fmi2ValueReference knowns[], size_t knownCount,
                                        const fmi2Real seed[], fmi2Real sensitivity[]) {
  return done<fmi2Status>(
      instance, [&](Unit& unit) { slopes(unit, unknowns, unknownCount, knowns, knownCount, seed, sensitivity); });
}

fmi2Status fmi2EnterEventMode(fmi2Component instance) {
  return done<fmi2Status>(instance, [](Unit& unit) {
    unit.need("fmi2EnterEventMode", {Mode::continuous});
    unit.enter(Mode::event);
  });
}
fmi2Status fmi2NewDiscreteStates(fmi2Component instance, fmi2EventInfo* info) {
  return done<fmi2Status>(instance, [&](Unit& unit) {
    needs("eventInfo", {info});
    const AfterEvent now = event(unit, "fmi2NewDiscreteStates");
    *info = {0, 0, 0, now.anew, std::isfinite(now.next), now.next};
  });
}
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component instance) {
  return done<fmi2Status>(instance, [](Unit& unit) {
    unit.need("fmi2EnterContinuousTimeMode", {Mode::event});
    unit.enter(Mode::continuous);
  });
}
fmi2Status fmi2CompletedIntegratorStep(fmi2Component instance, fmi2Boolean, fmi2Boolean* enterEventMode,
                                       fmi2Boolean* terminate) {
  return done<fmi2Status>(instance, [&](Unit& unit) {
    unit.need("fmi2CompletedIntegratorStep", {Mode::continuous});
    needs("results", {enterEventMode, terminate});
    *enterEventMode = *terminate = 0;
  });
}
fmi2Status fmi2SetTime(fmi2Component instance, fmi2Real time) {
  return done<fmi2Status>(instance, [&](Unit& unit) { set_time(unit, time); });
}
fmi2Status fmi2SetContinuousStates(fmi2Component instance, const fmi2Real x[], size_t count) {
  return done<fmi2Status>(instance, [&](Unit& unit) { set_states(unit, x, count); });
}
fmi2Status fmi2GetDerivatives(fmi2Component instance, fmi2Real dx[], size_t count) {
  return done<fmi2Status>(instance, [&](Unit& unit) { get_rates(unit, dx, count); });
}
fmi2Status fmi2GetEventIndicators(fmi2Component instance, fmi2Real indicators[], size_t count) {
  return done<fmi2Status>(instance, [&](Unit& unit) { get_indicators(unit, indicators, count); });
}
fmi2Status fmi2GetContinuousStates(fmi2Component instance, fmi2Real x[], size_t count) {
  return done<fmi2Status>(instance, [&](Unit& unit) { get_states(unit, x, count); });
}
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component instance, fmi2Real nominals[], size_t count) {
  return done<fmi2Status>(instance, [&](Unit& unit) { get_nominals(unit, nominals, count); });
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component instance, const fmi2ValueReference[], size_t, const fmi2Integer[],
                                       const fmi2Real[]) {
  return missing<fmi2Status>(instance, "fmi2SetRealInputDerivatives");
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component instance, const fmi2ValueReference[], size_t, const fmi2Integer[],
                                        fmi2Real[]) {
  return missing<fmi2Status>(instance, "fmi2GetRealOutputDerivatives");
}
fmi2Status fmi2DoStep(fmi2Component instance, fmi2Real now, fmi2Real step, fmi2Boolean) {
  return done<fmi2Status>(instance, [&](Unit& unit) {
    unit.need("fmi2DoStep", {Mode::stepping});
    unit.advance(now, step);
  });
}
fmi2Status fmi2CancelStep(fmi2Component instance) { return missing<fmi2Status>(instance, "fmi2CancelStep"); }
fmi2Status fmi2GetStatus(fmi2Component instance, fmi2StatusKind, fmi2Status*) {
  return missing<fmi2Status>(instance, "fmi2GetStatus");
}
fmi2Status fmi2GetRealStatus(fmi2Component instance, fmi2StatusKind kind, fmi2Real* value) {
  if (kind != fmi2LastSuccessfulTime) return missing<fmi2Status>(instance, "fmi2GetRealStatus");
  return done<fmi2Status>(instance, [&](Unit& unit) { needs("value", {value}), *value = unit.t(); });
}
fmi2Status fmi2GetIntegerStatus(fmi2Component instance, fmi2StatusKind, fmi2Integer*) {
  return missing<fmi2Status>(instance, "fmi2GetIntegerStatus");
}
fmi2Status fmi2GetBooleanStatus(fmi2Component instance, fmi2StatusKind kind, fmi2Boolean* value) {
  if (kind != fmi2Terminated) return missing<fmi2Status>(instance, "fmi2GetBooleanStatus");
  return done<fmi2Status>(instance, [&](Unit&) { needs("value", {value}), *value = 0; });
}
fmi2Status fmi2GetStringStatus(fmi2Component instance, fmi2StatusKind, fmi2String*) {
  return missing<fmi2Status>(instance, "fmi2GetStringStatus");
}

}  // extern "C"
