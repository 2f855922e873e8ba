// An instance of a unit, as the functions of both versions of FMI share it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <string>
#include <vector>

#include "flexarm/check.hpp"
#include "unit.hpp"

namespace flexarm {

struct Instance {
  std::function<void(const char* what)> log;
  Unit unit;
};

/// A unit from the folder of its resources (a path or a URI). @return NULL, with a logged reason, where there is none
Instance* instantiate(const char* token, const char* resources, std::function<void(const char*)> log, bool exchanges,
                      bool events);

/// Does work on a unit. @return 0 (OK), or 3 (Error) with a logged reason: numbers of both versions
template <class Status, class Work>
Status done(void* instance, const Work& work) {
  constexpr auto kOk = static_cast<Status>(0), kError = static_cast<Status>(3);
  if (!instance) return kError;
  auto& of = *static_cast<Instance*>(instance);
  try {
    work(of.unit);
    return kOk;
  } catch (const std::exception& e) {
    of.log(e.what());
    return kError;
  }
}

/// Of a function that no unit has.
template <class Status>
Status missing(void* instance, const char* call) {
  return done<Status>(instance,
                      [&](Unit&) { throw std::invalid_argument(std::string(call) + ": this unit does not have it"); });
}

/// Of variables of another type than the only one that there is.
template <class Status>
Status none(void* instance, std::size_t count, const char* type, const char* only) {
  return done<Status>(instance, [&](Unit&) {
    if (count > 0) bad_value("valueReferences", count, std::string("variables of ") + type + ": all are " + only);
  });
}

/// @throws std::invalid_argument where a pointer is NULL
void needs(const char* name, std::initializer_list<const void*> pointers);

/// Their arrays may be NULL where `count` is 0.
void check_categories(const char* const categories[], std::size_t count);
void get(Unit& unit, const std::uint32_t references[], std::size_t count, double values[]);
void set(Unit& unit, const std::uint32_t references[], std::size_t count, const double values[]);
void slopes(Unit& unit, const std::uint32_t unknowns[], std::size_t unknownCount, const std::uint32_t knowns[],
            std::size_t knownCount, const double seed[], double out[]);

/// Of model exchange.
void set_states(Unit& unit, const double x[], std::size_t count);
void get_states(Unit& unit, double x[], std::size_t count);
void get_rates(Unit& unit, double dx[], std::size_t count);
void get_nominals(Unit& unit, double x[], std::size_t count);
void get_indicators(Unit& unit, double z[], std::size_t count);
void set_time(Unit& unit, double t);

struct AfterEvent {
  bool anew;    ///< whether the importer's solver must begin anew: that of model exchange, since forces leap at events
  double next;  ///< (s); infinite: none is known
};
AfterEvent event(Unit& unit, const char* call);

/// States that the importer keeps, and their bytes.
void keep(Unit& unit, void** state);
void take_back(Unit& unit, const void* state);
void forget(void** state);
std::size_t bytes(const void* state);
void write(const Unit& unit, const void* state, std::uint8_t to[], std::size_t size);
void read(const Unit& unit, const std::uint8_t from[], std::size_t size, void** state);

}  // namespace flexarm
