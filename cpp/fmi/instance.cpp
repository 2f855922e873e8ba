#include "instance.hpp"

#include <cstring>
#include <limits>
#include <memory>
#include <stdexcept>

namespace flexarm {

namespace {

/// The folder of a path, or of a URI of a file.
std::string folder(const char* resources) {
  needs("the unit's resources", {resources});
  const std::string given = resources;
  if (given.rfind("file:", 0) != 0) return given;
  std::size_t at = 5;
  if (given.compare(at, 2, "//") == 0) at = given.find('/', at + 2);  // behind the host
  std::string path;
  for (; at < given.size(); ++at) {
    if (given[at] == '%' && at + 2 < given.size()) {
      path += static_cast<char>(std::stoi(given.substr(at + 1, 2), nullptr, 16));
      at += 2;
    } else {
      path += given[at];
    }
  }
  return path;
}

/// The model of an instance, if its states are `count`.
Exchange& model_of(Unit& unit, std::size_t count) {
  Exchange& model = unit.exchange();
  const std::size_t right = model.coordinates().size() + model.rates().size();
  if (count != right) bad_value("number of states", count, "must be " + std::to_string(right));
  return model;
}

const Unit::State& kept(const void* state) {
  needs("state", {state});
  return *static_cast<const Unit::State*>(state);
}

/// Of numbers of this unit's states: with damaged ones, or those of another unit, it differs (FNV-1a).
std::uint64_t mark(const Unit& unit, const std::vector<double>& numbers) {
  std::uint64_t out = 14695981039346656037ULL;
  const auto take = [&out](const void* from, std::size_t size) {
    for (std::size_t k = 0; k < size; ++k) out = (out ^ static_cast<const std::uint8_t*>(from)[k]) * 1099511628211ULL;
  };
  take(unit.name().data(), unit.name().size());
  take(numbers.data(), numbers.size() * sizeof(double));
  return out;
}

}  // namespace

Instance* instantiate(const char* token, const char* resources, std::function<void(const char*)> log, bool exchanges,
                      bool events) {
  try {
    Resources content = Resources::load(folder(resources));
    if (!token || content.token != token)
      bad_value("the unit's token", token ? token : "NULL", "must be " + content.token);
    return new Instance{log, Unit(std::move(content), exchanges, events)};
  } catch (const std::exception& e) {
    log(e.what());
    return nullptr;
  }
}

void needs(const char* name, std::initializer_list<const void*> pointers) {
  for (const void* pointer : pointers)
    if (!pointer) bad_value(name, "NULL", "must be given");
}

void check_categories(const char* const categories[], std::size_t count) {
  for (std::size_t k = 0; k < count; ++k) {
    needs("categories", {categories});
    needs("category", {categories[k]});
    if (std::strcmp(categories[k], "logStatusError") != 0)
      bad_value("category", categories[k], "must be logStatusError");  // errors are always told
  }
}

void get(Unit& unit, const std::uint32_t references[], std::size_t count, double values[]) {
  if (count > 0) needs("references, values", {references, values});
  for (std::size_t k = 0; k < count; ++k) values[k] = unit.get(references[k]);
}

void set(Unit& unit, const std::uint32_t references[], std::size_t count, const double values[]) {
  if (count > 0) needs("references, values", {references, values});
  for (std::size_t k = 0; k < count; ++k) unit.set(references[k], values[k]);
}

void slopes(Unit& unit, const std::uint32_t unknowns[], std::size_t unknownCount, const std::uint32_t knowns[],
            std::size_t knownCount, const double seed[], double out[]) {
  if (unknownCount > 0) needs("unknowns", {unknowns, out});
  if (knownCount > 0) needs("knowns", {knowns, seed});
  unit.slopes({unknowns, unknowns + unknownCount}, {knowns, knowns + knownCount}, seed, out);
}

void set_states(Unit& unit, const double x[], std::size_t count) {
  unit.need("SetContinuousStates", {Unit::Mode::event, Unit::Mode::continuous});
  Exchange& model = model_of(unit, count);
  if (count > 0) needs("states", {x});
  model.place(x);
}

void get_states(Unit& unit, double x[], std::size_t count) {
  Exchange& model = model_of(unit, count);
  if (count > 0) needs("states", {x});
  for (const int i : model.coordinates()) *x++ = model.q()[i];
  for (const int i : model.rates()) *x++ = model.v()[i];
}

void get_rates(Unit& unit, double dx[], std::size_t count) {
  Exchange& model = model_of(unit, count);
  if (count > 0) needs("derivatives", {dx});
  const Eigen::VectorXd &a = model.a(), &dq = model.coordinate_rates();
  for (const int i : model.coordinates()) *dx++ = dq[i];
  for (const int i : model.rates()) *dx++ = a[i];
}

void get_nominals(Unit& unit, double x[], std::size_t count) {
  model_of(unit, count);
  if (count > 0) needs("nominals", {x});
  for (std::size_t k = 0; k < count; ++k) x[k] = unit.nominal(k);
}

void get_indicators(Unit& unit, double z[], std::size_t count) {
  const std::vector<std::size_t>& all = unit.indicators();
  if (count != all.size()) bad_value("number of event indicators", count, "must be " + std::to_string(all.size()));
  if (count > 0) needs("event indicators", {z});
  for (std::size_t k = 0; k < count; ++k) z[k] = unit.get(all[k]);
}

void set_time(Unit& unit, double t) {
  unit.need("SetTime", {Unit::Mode::event, Unit::Mode::continuous});
  unit.exchange().set_time(t);
}

AfterEvent event(Unit& unit, const char* call) {
  unit.need(call, {Unit::Mode::event});
  if (!unit.exchanges()) return {false, std::numeric_limits<double>::infinity()};  // steps meet events themselves
  Exchange& model = unit.exchange();
  model.event();
  return {true, model.next_event()};
}

void keep(Unit& unit, void** state) {
  needs("state", {state});
  auto now = std::make_unique<Unit::State>(unit.state());
  forget(state);
  *state = now.release();
}

void take_back(Unit& unit, const void* state) { unit.restore(kept(state)); }

void forget(void** state) {
  if (!state) return;
  delete static_cast<Unit::State*>(*state);
  *state = nullptr;
}

std::size_t bytes(const void* state) { return sizeof(std::uint64_t) + kept(state).numbers.size() * sizeof(double); }

void write(const Unit& unit, const void* state, std::uint8_t to[], std::size_t size) {
  unit.check_bytes();
  if (size < bytes(state)) bad_value("size", size, "must be " + std::to_string(bytes(state)));
  needs("bytes", {to});
  const std::vector<double>& numbers = kept(state).numbers;
  const std::uint64_t known = mark(unit, numbers);
  std::memcpy(to, &known, sizeof known);
  std::memcpy(to + sizeof known, numbers.data(), numbers.size() * sizeof(double));
}

void read(const Unit& unit, const std::uint8_t from[], std::size_t size, void** state) {
  unit.check_bytes();
  needs("bytes, state", {from, state});
  std::uint64_t known = 0;
  auto out = std::make_unique<Unit::State>();
  out->of = unit.name();
  if (size >= sizeof known) {
    std::memcpy(&known, from, sizeof known);
    out->numbers.resize((size - sizeof known) / sizeof(double));
    std::memcpy(out->numbers.data(), from + sizeof known, out->numbers.size() * sizeof(double));
  }
  if (size != bytes(out.get()) || known != mark(unit, out->numbers))
    bad_value("a state's bytes", size, "are not whole, or of another unit");
  forget(state);
  *state = out.release();
}

}  // namespace flexarm
