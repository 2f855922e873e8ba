#include "scene_value.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "flexarm/check.hpp"

namespace flexarm {

namespace {

constexpr std::size_t kShown = 80;  // characters of a value in an error
constexpr double kNear = 0.6;       // share of letters in common, above which a name is worth a hint
constexpr double kLargest = 2147483647.0;

/// Twice the letters in common, in order, over all letters.
double likeness(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1, 0);
  for (const char c : a) {
    std::size_t diagonal = 0;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t above = row[j];
      row[j] = c == b[j - 1] ? diagonal + 1 : std::max(row[j], row[j - 1]);
      diagonal = above;
    }
  }
  return 2.0 * static_cast<double>(row.back()) / static_cast<double>(std::max<std::size_t>(a.size() + b.size(), 1));
}

std::string joined(const Names& names) {
  std::string out;
  for (const std::string& n : names) out += (out.empty() ? "" : ", ") + n;
  return out.empty() ? "none" : out;
}

std::string nearest(const std::string& name, const Names& known) {
  std::string best;
  double most = kNear;
  for (const std::string& k : known)
    if (const double l = likeness(name, k); l >= most && (best.empty() || l > most)) {
      most = l;
      best = k;
    }
  return best;
}

}  // namespace

std::string Value::shown() const {
  std::ostringstream out;
  switch (kind) {
    case Kind::boolean:
      out << (truth ? "true" : "false");
      break;
    case Kind::number:
      out << number;
      break;
    case Kind::text:
      out << '\'' << text << '\'';
      break;
    case Kind::other:
      out << text;
      break;
    case Kind::list:
    case Kind::table:
      out << (kind == Kind::list ? "[" : "{");
      for (std::size_t k = 0; k < items.size() && out.tellp() < static_cast<std::streamoff>(kShown); ++k)
        out << (k > 0 ? ", " : "") << (kind == Kind::table ? keys[k] + " = " : "") << items[k].shown();
      out << (kind == Kind::list ? "]" : "}");
  }
  std::string all = out.str();
  return all.size() <= kShown ? all : all.substr(0, kShown) + " ...";
}

void At::bad(const std::string& right) const { bad_value(where_, value_->shown(), right); }

void At::known_keys(const Names& known) const {
  if (!is(Value::Kind::table)) bad("must be a table");
  for (const std::string& key : value_->keys) {
    if (std::find(known.begin(), known.end(), key) != known.end()) continue;
    const std::string near = nearest(key, known);
    throw std::invalid_argument(where_ + ": unknown key '" + key + "'; " +
                                (near.empty() ? "known are " + joined(known) : "did you mean '" + near + "'?"));
  }
}

bool At::has(const std::string& key) const {
  return std::find(value_->keys.begin(), value_->keys.end(), key) != value_->keys.end();
}

At At::operator[](const std::string& key) const {
  needs({key});
  const auto found = std::find(value_->keys.begin(), value_->keys.end(), key);
  const auto k = static_cast<std::size_t>(found - value_->keys.begin());
  return {value_->items[k], where_.empty() ? key : where_ + "." + key};
}

void At::needs(const Names& keys) const {
  if (!is(Value::Kind::table)) bad("must be a table");
  Names missing;
  for (const std::string& key : keys)
    if (!has(key)) missing.push_back(key);
  if (!missing.empty()) throw std::invalid_argument(where_ + ": missing " + joined(missing));
}

At At::operator[](std::size_t k) const { return {value_->items.at(k), where_ + "[" + std::to_string(k) + "]"}; }

std::vector<At> At::list(const std::string& of) const {
  if (!is(Value::Kind::list)) bad("must be a list of " + of);
  std::vector<At> out;
  for (std::size_t k = 0; k < size(); ++k) out.push_back((*this)[k]);
  return out;
}

double At::number() const {
  if (!is(Value::Kind::number)) bad("must be a number");
  return value_->number;
}

int At::whole() const {
  if (!is(Value::Kind::number) || !value_->whole) bad("must be a whole number");
  if (std::abs(value_->number) > kLargest) bad("is too large");
  return static_cast<int>(value_->number);
}

bool At::truth() const {
  if (!is(Value::Kind::boolean)) bad("must be true or false");
  return value_->truth;
}

std::string At::choice(const Names& known) const {
  const std::string& name = value_->text;
  if (is(Value::Kind::text) && std::find(known.begin(), known.end(), name) != known.end()) return name;
  const std::string near = is(Value::Kind::text) ? nearest(name, known) : "";
  bad("must be one of " + joined(known) + (near.empty() ? "" : "; did you mean '" + near + "'?"));
}

std::vector<double> At::numbers() const {
  if (!is(Value::Kind::list)) bad("must be a list of numbers");
  std::vector<double> out;
  for (const Value& v : value_->items) {
    if (v.kind != Value::Kind::number) bad("must be numbers");
    if (!std::isfinite(v.number)) bad("must be finite, no nan or inf");
    out.push_back(v.number);
  }
  return out;
}

std::vector<double> At::numbers(std::size_t n) const {
  std::vector<double> out = numbers();
  if (out.size() != n) bad("must be " + std::to_string(n) + " numbers");
  return out;
}

Eigen::Vector3d At::vector() const {
  const std::vector<double> x = numbers(3);
  return {x[0], x[1], x[2]};
}

std::optional<Eigen::Matrix3d> At::square() const {
  if (!is(Value::Kind::list) || size() != 3 || !(*this)[std::size_t{0}].is(Value::Kind::list)) return {};
  Eigen::Matrix3d m;
  for (std::size_t k = 0; k < 3; ++k) m.row(static_cast<Eigen::Index>(k)) = (*this)[k].vector();
  return m;
}

}  // namespace flexarm
