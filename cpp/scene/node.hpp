// A node of a JSON file, which is written or read by the same calls: see `fields` in scene.cpp.
#pragma once

#include <Eigen/Core>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

namespace flexarm {

using Json = nlohmann::ordered_json;

class Node {
 public:
  Node(Json& at, bool reads, std::string path) : at_(&at), reads_(reads), path_(std::move(path)) {}
  bool reads() const { return reads_; }

  /// A member of this object.
  template <class T>
  void operator()(const char* key, T& x) {
    member(key).value(x);
  }
  /// A number that may be infinite; several.
  void limit(const char* key, double& x) { member(key).number(x, true); }
  void limits(const char* key, Eigen::VectorXd& x) { member(key).row(x, true); }
  /// A vector or matrix of a size that is known.
  void sized(const char* key, Eigen::VectorXd& x, Eigen::Index size);
  void sized(const char* key, Eigen::MatrixXd& x, Eigen::Index rows, Eigen::Index cols);
  /// A required object made from its fields.
  template <class T>
  void made(const char* key, std::optional<T>& x) {
    member(key).object(x);
  }
  /// Makes it when its fields have been read; errors name the place.
  template <class T, class Make>
  void make(std::optional<T>& x, const Make& make) {
    guard("", [&] {
      if (reads_) x.emplace(make());
    });
  }
  /// Calls a function; errors name the place within this.
  template <class Do>
  void guard(const std::string& where, const Do& act) const {
    try {
      act();
    } catch (const std::invalid_argument& e) {
      throw std::invalid_argument(path_ + where + (path_.empty() && where.empty() ? "" : ": ") + e.what());
    }
  }
  /// @throws std::invalid_argument "place.key = value: the right values"
  [[noreturn]] void wrong(const std::string& key, const std::string& value, const std::string& right) const;

  template <class T>
  void value(T& x) {
    object(x);
  }
  void value(double& x) { number(x, false); }
  void value(int& x);
  void value(bool& x);
  void value(std::string& x);
  template <int Rows, int Cols>
  void value(Eigen::Matrix<double, Rows, Cols>& m) {
    Eigen::MatrixXd x = m;
    if constexpr (Cols == 1) {
      Eigen::VectorXd v = m;
      row(v, false);
      x = v;
    } else {
      matrix(x, Cols);
    }
    if ((Rows != Eigen::Dynamic && x.rows() != Rows) || (Cols != Eigen::Dynamic && x.cols() != Cols))
      wrong("", size_of(x), "must be " + std::to_string(Rows) + (Cols == 1 ? " numbers" : " rows of as many numbers"));
    m = x;
  }
  template <class T>
  void value(std::optional<T>& x) {  // or null
    if (reads_ ? at_->is_null() : !x) return;
    if constexpr (std::is_default_constructible_v<T>) {
      if (reads_) x.emplace();
      value(*x);
    } else {
      object(x);
    }
  }
  template <class T>
  void value(std::vector<T>& list) {
    const std::size_t count = listed(list.size());
    for (std::size_t k = 0; k < count; ++k) {
      Node inner = element(k);
      if constexpr (std::is_default_constructible_v<T>) {
        if (reads_) list.emplace_back();
        inner.value(list[k]);
      } else {
        std::optional<T> x;
        if (!reads_) x = list[k];
        inner.object(x);
        if (reads_) list.push_back(std::move(*x));
      }
    }
  }

 private:
  Node member(const char* key);
  Node element(std::size_t k);
  /// Begins a list. @return its number of elements @param size of the list that is written
  std::size_t listed(std::size_t size);
  void number(double& x, bool infinite);
  void row(Eigen::VectorXd& x, bool infinite);
  /// @param cols  of a matrix without rows, if that is known
  void matrix(Eigen::MatrixXd& x, Eigen::Index cols);
  static std::string size_of(const Eigen::MatrixXd& x);
  template <class T>
  void object(T& x) {
    begin();
    fields(*this, x);
    end();
  }
  void begin();
  void end() const;  ///< checks that no key is left

  Json* at_;
  bool reads_;
  std::string path_;
  std::vector<std::string> asked_;
};

}  // namespace flexarm
