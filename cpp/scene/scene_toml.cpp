// The only file that knows the TOML library.
#include <fstream>
#include <sstream>

#define TOML_HEADER_ONLY 1
#define TOML_EXCEPTIONS 1
#define TOML_ENABLE_FORMATTERS 0
#include <toml++/toml.h>

#include "flexarm/scene.hpp"
#include "scene_arm.hpp"

namespace flexarm {

namespace {

Value value_of(const toml::node& node) {
  Value v;
  if (const toml::table* table = node.as_table()) {
    v.kind = Value::Kind::table;
    for (const auto& [key, item] : *table) {
      v.keys.emplace_back(key.str());
      v.items.push_back(value_of(item));
    }
  } else if (const toml::array* array = node.as_array()) {
    v.kind = Value::Kind::list;
    for (const toml::node& item : *array) v.items.push_back(value_of(item));
  } else if (const auto* text = node.as_string()) {
    v.kind = Value::Kind::text;
    v.text = text->get();
  } else if (const auto* integer = node.as_integer()) {
    v.kind = Value::Kind::number;
    v.whole = true;
    v.number = static_cast<double>(integer->get());
  } else if (const auto* number = node.as_floating_point()) {
    v.kind = Value::Kind::number;
    v.number = number->get();
  } else if (const auto* truth = node.as_boolean()) {
    v.kind = Value::Kind::boolean;
    v.truth = truth->get();
  } else {
    v.text = "a date or time";
  }
  return v;
}

}  // namespace

Arm parse_arm(const std::string& text) {
  Value scene;
  try {
    scene = value_of(toml::parse(text));
  } catch (const toml::parse_error& e) {
    std::ostringstream why;
    why << e.description() << " (line " << e.source().begin.line << ", column " << e.source().begin.column << ")";
    throw std::invalid_argument(why.str());
  }
  return read_arm(scene);
}

Arm load_arm(const std::string& path) {
  const std::string where = "scene '" + path + "': ";
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  if (!file || !text) throw std::invalid_argument(where + "cannot be read; give the path of a TOML file");
  try {
    return parse_arm(text.str());
  } catch (const std::invalid_argument& e) {
    throw std::invalid_argument(where + e.what());
  }
}

}  // namespace flexarm
