#include "bindings.hpp"
#include "flexarm/check.hpp"

using namespace flexarm;

namespace {

Joint joint_from_name(const std::string& type, const Eigen::Vector3d& axis) {
  if (type == "fixed") return Joint(Joint::Type::fixed);
  if (type == "revolute") return Joint(Joint::Type::revolute, axis);
  if (type == "prismatic") return Joint(Joint::Type::prismatic, axis);
  bad_value("joint.type", "\"" + type + "\"", "must be \"fixed\", \"revolute\" or \"prismatic\"");
}

}  // namespace

void bind_model(py::module_& m) {
  py::class_<Material>(m, "Material")
      .def(py::init<double, double, std::optional<double>, std::optional<double>>(), py::arg("density"),
           py::arg("youngs_modulus"), py::arg("poisson_ratio"), py::arg("shear_modulus"))
      .def_readonly("shear_modulus", &Material::shear_modulus);

  py::class_<Section>(m, "Section")
      .def(py::init<double, double, double, double, double>(), py::arg("area"), py::arg("second_moment_y"),
           py::arg("second_moment_z"), py::arg("torsion_constant"), py::arg("shear_correction"))
      .def_static("rectangle", &Section::rectangle, py::arg("y"), py::arg("z"), py::arg("shear_correction"))
      .def_static("circle", &Section::circle, py::arg("radius"), py::arg("inner_radius"), py::arg("shear_correction"))
      .def_readonly("area", &Section::area)
      .def_readonly("second_moment_y", &Section::second_moment_y)
      .def_readonly("second_moment_z", &Section::second_moment_z)
      .def_readonly("torsion_constant", &Section::torsion_constant)
      .def_readonly("shear_correction", &Section::shear_correction);

  py::class_<Beam>(m, "Beam")
      .def(py::init([](double length, const Section& section, const Material& material,
                       const std::array<int, kStrains>& modes, const std::string& basis, int order, bool rotary_inertia,
                       double damping_ratio, int gauss_points) {
             BeamOptions o;
             o.modes = modes;
             o.basis = basis_from_name(basis);
             o.order = order;
             o.rotary_inertia = rotary_inertia;
             o.damping_ratio = damping_ratio;
             o.gauss_points = gauss_points;
             return Beam(length, section, material, o);
           }),
           py::arg("length"), py::arg("section"), py::arg("material"), py::arg("modes"), py::arg("basis"),
           py::arg("order"), py::arg("rotary_inertia"), py::arg("damping_ratio"), py::arg("gauss_points"))
      .def_property_readonly("mass", &Beam::mass)
      .def_property_readonly("gauss_points", [](const Beam& b) { return b.slices().size(); })
      .def_property_readonly("stiffness", &Beam::stiffness)
      .def_property_readonly("damping", &Beam::damping);

  py::class_<RigidBody>(m, "RigidBody")
      .def(py::init(
               [](double mass, const Eigen::Vector3d& com, const Eigen::Matrix3d& inertia, const Eigen::Vector3d& end) {
                 RigidBody body{mass, com, inertia, end};
                 body.check();
                 return body;
               }),
           py::arg("mass"), py::arg("com"), py::arg("inertia"), py::arg("end"));

  py::class_<Joint>(m, "Joint")
      .def(py::init(&joint_from_name), py::arg("type"), py::arg("axis"))
      .def_property_readonly("nv", &Joint::nv);

  py::class_<Link>(m, "Link")
      .def(py::init<Joint, std::optional<RigidBody>, std::optional<Beam>, std::optional<RigidBody>>(), py::arg("joint"),
           py::arg("hub"), py::arg("beam"), py::arg("tip"))
      .def_property_readonly("mass", &Link::mass);

  py::class_<Arm> arm(m, "Arm");
  arm.def(py::init<std::vector<Link>, const Eigen::Vector3d&>(), py::arg("links"), py::arg("gravity"))
      .def_property_readonly("nq", &Arm::nq)
      .def_property_readonly("nv", &Arm::nv)
      .def_property_readonly("coordinates", &Arm::coordinates)
      .def("first", [](const Arm& a, std::size_t link) { return a.first(link); }, py::arg("link"));
  bind_dynamics(arm);
}
