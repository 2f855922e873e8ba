// What a scene file holds, and reading it with errors that say where. Internal; knows no TOML library.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <initializer_list>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace flexarm {

/// A value of a scene file.
struct Value {
  enum class Kind { boolean, number, text, list, table, other };
  Kind kind = Kind::other;
  bool truth = false;
  bool whole = false;  ///< whether the number is written as an integer
  double number = 0.0;
  std::string text;               ///< or what `other` looks like
  std::vector<std::string> keys;  ///< of a table, one for each item
  std::vector<Value> items;

  std::string shown() const;
};

using Names = std::vector<std::string>;

/// A value and where in the scene it stands, such as "link[0].beam.length". Everything here throws
/// std::invalid_argument that begins with that.
class At {
 public:
  At(const Value& value, std::string where) : value_(&value), where_(std::move(where)) {}

  const Value& value() const { return *value_; }
  const std::string& where() const { return where_; }
  bool is(Value::Kind kind) const { return value_->kind == kind; }
  [[noreturn]] void bad(const std::string& right) const;

  // of a table
  void known_keys(const Names& known) const;
  bool has(const std::string& key) const;
  At operator[](const std::string& key) const;
  void needs(const Names& keys) const;  ///< all that are missing are named
  // of a list
  std::size_t size() const { return value_->items.size(); }
  At operator[](std::size_t k) const;
  std::vector<At> list(const std::string& of) const;

  double number() const;
  int whole() const;
  bool truth() const;
  std::string choice(const Names& known) const;
  std::vector<double> numbers() const;               ///< finite
  std::vector<double> numbers(std::size_t n) const;  ///< n of them
  Eigen::Vector3d vector() const;
  std::optional<Eigen::Matrix3d> square() const;  ///< 3 lists of 3 numbers, or nothing when it is another list

  // of a table's key that may be left out
  double number(const std::string& key, double otherwise) const { return has(key) ? (*this)[key].number() : otherwise; }
  bool truth(const std::string& key, bool otherwise) const { return has(key) ? (*this)[key].truth() : otherwise; }
  Eigen::Vector3d vector(const std::string& key) const {
    return has(key) ? (*this)[key].vector() : Eigen::Vector3d::Zero();
  }

 private:
  const Value* value_;
  std::string where_;
};

/// make(), whose errors, "field = value: ...", then say where the field stands.
template <class Make>
auto within(const std::string& where, const Make& make) {
  try {
    return make();
  } catch (const std::invalid_argument& e) {
    throw std::invalid_argument(where + "." + e.what());
  }
}

}  // namespace flexarm
