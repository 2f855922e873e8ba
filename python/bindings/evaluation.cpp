#include "evaluation.hpp"

using namespace flexarm;

Answers::Answers(const Vectors& asked, std::initializer_list<py::ssize_t> tail)
    : height_(tail.size() == 1 ? 1 : *tail.begin()), width_(*(tail.end() - 1)) {
  std::vector<py::ssize_t> shape(asked.shape(), asked.shape() + asked.ndim() - 1);
  shape.insert(shape.end(), tail);
  array_ = Vectors(std::move(shape));
  data_ = array_.mutable_data();
}

bool Setting::operator==(const Setting& other) const {
  const auto same_point = [](const Load::Point& a, const Load::Point& b) {
    return a.slice.X == b.slice.X && a.weight == b.weight;
  };
  const auto same = [&](const Load& a, const Load& b) {
    return a.link == b.link && a.world_axes == b.world_axes && a.strut == b.strut && a.by_state == b.by_state &&
           std::equal(a.points.begin(), a.points.end(), b.points.begin(), b.points.end(), same_point);
  };
  return prescribed == other.prescribed &&
         std::equal(loads.begin(), loads.end(), other.loads.begin(), other.loads.end(), same);
}

bool PyArm::one_state(const py::dict& named, bool balls) const {
  const PyTypeObject* array = py::detail::npy_api::get().PyArray_Type_;  // no subclass, such as masked arrays
  for (const auto& [name, value] : named) {
    if (Py_TYPE(value.ptr()) != array) return false;
    if (!py::array_t<double, py::array::c_style>::check_(value)) return false;
    const auto x = py::reinterpret_borrow<Vectors>(value);
    const bool is_q = py::cast<std::string_view>(name) == "q";
    if (x.ndim() != 1 || x.shape(0) != (is_q ? nq() : nv())) return false;
    const Eigen::Map<const Eigen::VectorXd> v(x.data(), x.size());
    if (!v.allFinite()) return false;
    for (std::size_t n = 0; n < size() && is_q && balls; ++n) {
      const Joint& joint = link(n).joint();
      const double length = joint.has_ball() ? v.segment(first_q(n) + joint.nq() - 4, 4).cwiseAbs().maxCoeff() : 1.0;
      if (length < 1e-100 || length > 1e100) return false;
    }
  }
  return true;
}
