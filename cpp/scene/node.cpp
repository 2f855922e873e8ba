#include "node.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexarm {

void Node::wrong(const std::string& key, const std::string& value, const std::string& right) const {
  const std::string at = path_.empty() ? key : path_ + (key.empty() ? "" : "." + key);
  throw std::invalid_argument((at.empty() ? "the file" : at) + " = " + value + ": " + right);
}

namespace {

/// Of a value, in short.
std::string shown(const Json& x) {
  constexpr std::size_t kMost = 40;
  if (x.is_structured()) return x.is_array() ? "a list" : "an object";
  std::string text = x.dump(-1, ' ', true, Json::error_handler_t::replace);
  return text.size() > kMost ? text.substr(0, kMost) + "..." : text;
}

}  // namespace

Node Node::member(const char* key) {
  asked_.emplace_back(key);
  const std::string path = path_.empty() ? key : path_ + "." + key;
  if (!reads_) return {(*at_)[key], false, path};
  const auto found = at_->find(key);
  if (found == at_->end())
    throw std::invalid_argument((path_.empty() ? "the file" : path_) + ": missing key '" + key + "'");
  return {*found, true, path};
}

Node Node::element(std::size_t k) {
  if (!reads_) at_->push_back(nullptr);
  return {(*at_)[k], reads_, path_ + "[" + std::to_string(k) + "]"};
}

std::size_t Node::listed(std::size_t size) {
  if (!reads_) *at_ = Json::array();
  if (!at_->is_array()) wrong("", shown(*at_), "must be a list");
  return reads_ ? at_->size() : size;
}

void Node::begin() {
  if (!reads_) *at_ = Json::object();
  if (!at_->is_object()) wrong("", shown(*at_), "must be an object with keys");
}

void Node::end() const {
  if (!reads_) return;
  for (const auto& [key, unused] : at_->items()) {
    if (std::find(asked_.begin(), asked_.end(), key) != asked_.end()) continue;
    std::string known;
    for (const std::string& one : asked_) known += (known.empty() ? "" : ", ") + one;
    throw std::invalid_argument((path_.empty() ? "the file" : path_) + ": unknown key " + shown(key) + "; known are " +
                                known);
  }
}

void Node::number(double& x, bool infinite) {
  const char* right = infinite ? "must be a number, \"inf\" or \"-inf\"" : "must be a number";
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  if (!reads_) {
    if (std::isnan(x) || (std::isinf(x) && !infinite)) wrong("", std::to_string(x), right);
    *at_ = std::isinf(x) ? Json(x > 0.0 ? "inf" : "-inf") : Json(x);
  } else if (at_->is_number()) {
    x = at_->get<double>();
  } else if (infinite && (*at_ == "inf" || *at_ == "-inf")) {
    x = *at_ == "inf" ? kInfinity : -kInfinity;
  } else {
    wrong("", shown(*at_), right);
  }
}

void Node::value(int& x) {
  if (!reads_) {
    *at_ = x;
    return;
  }
  const bool fits = at_->is_number_integer() && at_->get<double>() >= std::numeric_limits<int>::min() &&
                    at_->get<double>() <= std::numeric_limits<int>::max();
  if (!fits) wrong("", shown(*at_), "must be a whole number");
  x = at_->get<int>();
}

void Node::value(bool& x) {
  if (!reads_) *at_ = x;
  if (!at_->is_boolean()) wrong("", shown(*at_), "must be true or false");
  x = at_->get<bool>();
}

void Node::value(std::string& x) {
  if (!reads_) *at_ = x;
  if (!at_->is_string()) wrong("", shown(*at_), "must be a text");
  x = at_->get<std::string>();
}

void Node::row(Eigen::VectorXd& x, bool infinite) {
  const auto count = static_cast<Eigen::Index>(listed(static_cast<std::size_t>(x.size())));
  x.conservativeResize(count);
  for (Eigen::Index k = 0; k < count; ++k) element(static_cast<std::size_t>(k)).number(x[k], infinite);
}

void Node::matrix(Eigen::MatrixXd& x, Eigen::Index cols) {
  const auto count = static_cast<Eigen::Index>(listed(static_cast<std::size_t>(x.rows())));
  if (reads_) x.resize(count, count == 0 ? std::max<Eigen::Index>(cols, 0) : 0);
  for (Eigen::Index k = 0; k < count; ++k) {
    Node inner = element(static_cast<std::size_t>(k));
    Eigen::VectorXd one;
    if (!reads_) one = x.row(k);
    inner.row(one, false);
    if (k == 0) x.conservativeResize(Eigen::NoChange, one.size());
    if (one.size() != x.cols())
      inner.wrong("", size_of(one), "must be " + std::to_string(x.cols()) + " numbers, as the first row");
    x.row(k) = one.transpose();
  }
}

std::string Node::size_of(const Eigen::MatrixXd& x) {
  return x.cols() == 1 ? std::to_string(x.rows()) + " numbers"
                       : std::to_string(x.rows()) + " x " + std::to_string(x.cols()) + " numbers";
}

void Node::sized(const char* key, Eigen::VectorXd& x, Eigen::Index size) {
  (*this)(key, x);
  if (x.size() != size) wrong(key, size_of(x), "must be " + std::to_string(size) + " numbers");
}

void Node::sized(const char* key, Eigen::MatrixXd& x, Eigen::Index rows, Eigen::Index cols) {
  member(key).matrix(x, cols);
  if (x.rows() != rows || x.cols() != cols)
    wrong(key, std::to_string(x.rows()) + " x " + std::to_string(x.cols()) + " numbers",
          "must be " + std::to_string(rows) + " x " + std::to_string(cols));
}

}  // namespace flexarm
