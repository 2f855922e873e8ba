#include <algorithm>

#include "evaluation.hpp"
#include "flexarm/ab.hpp"
#include "flexarm/check.hpp"
#include "flexarm/load.hpp"
#include "flexarm/truncation.hpp"
#include "laws.hpp"

using namespace flexarm;

namespace {

/// A function of a place, from Python; called and let go of without the lock.
template <class T>
std::function<T(double)> along(const py::object& law) {
  const std::shared_ptr<py::object> shared(new py::object(law), [](py::object* held) {
    const Locked lock;
    delete held;
  });
  return [shared](double x) {
    const Locked lock;
    return call(*shared, x).cast<T>();
  };
}

/// The table of strains, Python's only list of them.
void bind_strains(py::module_& m) {
  py::class_<StrainField>(m, "StrainField")
      .def_readonly("name", &StrainField::name)
      .def_readonly("row", &StrainField::strain)
      .def_readonly("bending", &StrainField::bending)
      .def_readonly("position", &StrainField::position)
      .def_readonly("rotation", &StrainField::rotation)
      .def_readonly("sign", &StrainField::sign);
  py::tuple fields(kStrains), names(kStrains), rows(kStrains);
  for (int s = 0; s < kStrains; ++s) {
    const StrainField& f = kStrainFields[s];
    fields[static_cast<std::size_t>(s)] = f;
    names[static_cast<std::size_t>(s)] = f.name;
    rows[static_cast<std::size_t>(f.strain)] = f.row_name;
  }
  m.attr("STRAIN_FIELDS") = fields;
  m.attr("STRAINS") = names;
  m.attr("STRAIN_NAMES") = rows;
}

template <class Any>
void bind_profile(py::module_& m, const char* name) {
  py::class_<Along<Any>>(m, name).def(py::init([](const py::object& at, std::vector<double> breaks) {
                                        return Along<Any>{along<Any>(at), std::move(breaks)};
                                      }),
                                      py::arg("at"), py::arg("breaks"));
}

using Two = std::array<double, 2>;

std::optional<ShearCorrection> shear(const std::optional<Two>& k) {
  return k ? std::optional<ShearCorrection>({(*k)[0], (*k)[1]}) : std::nullopt;
}

/// The parts of a beam.
void bind_sections(py::module_& m) {
  py::class_<Material>(m, "Material")
      .def(py::init<double, double, std::optional<double>, std::optional<double>>(), py::arg("density"),
           py::arg("youngs_modulus"), py::arg("poisson_ratio"), py::arg("shear_modulus"))
      .def_readonly("shear_modulus", &Material::shear_modulus);

  py::class_<Face>(m, "Face")
      .def_readonly("distance", &Face::distance)
      .def_readonly("breadth", &Face::breadth)
      .def_readonly("twist", &Face::twist);

  py::class_<Section>(m, "Section")
      .def(py::init([](double area, double iy, double iz, double j, const Two& k) {
             return Section(area, iy, iz, j, {k[0], k[1]});
           }),
           py::arg("area"), py::arg("second_moment_y"), py::arg("second_moment_z"), py::arg("torsion_constant"),
           py::arg("shear_correction"))
      .def_static(
          "rectangle", [](double y, double z, const Two& k) { return Section::rectangle(y, z, {k[0], k[1]}); },
          py::arg("y"), py::arg("z"), py::arg("shear_correction"))
      .def_static(
          "circle", [](double r, double inner, const Two& k) { return Section::circle(r, inner, {k[0], k[1]}); },
          py::arg("radius"), py::arg("inner_radius"), py::arg("shear_correction"))
      .def_static(
          "tube", [](double r, double t, const std::optional<Two>& k) { return Section::tube(r, t, shear(k)); },
          py::arg("radius"), py::arg("thickness"), py::arg("shear_correction"))
      .def_static(
          "ellipse", [](double y, double z, const std::optional<Two>& k) { return Section::ellipse(y, z, shear(k)); },
          py::arg("y"), py::arg("z"), py::arg("shear_correction"))
      .def_static(
          "box",
          [](double y, double z, const Two& t, const std::optional<Two>& k) {
            return Section::box(y, z, t[0], t[1], shear(k));
          },
          py::arg("y"), py::arg("z"), py::arg("thickness"), py::arg("shear_correction"))
      .def_static(
          "i_beam",
          [](double y, double z, double flange, double web, const std::optional<Two>& k) {
            return Section::i_beam(y, z, flange, web, shear(k));
          },
          py::arg("y"), py::arg("z"), py::arg("flange"), py::arg("web"), py::arg("shear_correction"))
      .def_readonly("area", &Section::area)
      .def_readonly("second_moment_y", &Section::second_moment_y)
      .def_readonly("second_moment_z", &Section::second_moment_z)
      .def_readonly("torsion_constant", &Section::torsion_constant)
      .def_property_readonly(
          "shear_correction",
          [](const Section& s) { return py::make_tuple(s.shear_correction.y, s.shear_correction.z); })
      .def_property_readonly("reach", [](const Section& s) { return py::make_tuple(s.reach[0], s.reach[1]); })
      .def_property_readonly("faces", [](const Section& s) { return py::make_tuple(s.faces[0], s.faces[1]); });

  py::class_<SectionMatrix>(m, "SectionMatrix")
      .def(py::init<const SectionMatrix::Matrix&, const SectionMatrix::Matrix&>(), py::arg("stiffness"),
           py::arg("inertia"))
      .def_property_readonly("com", &SectionMatrix::com)
      .def_property_readonly("inertia_about_com", &SectionMatrix::inertia_about_com);

  bind_profile<Section>(m, "SectionProfile");
  bind_profile<SectionMatrix>(m, "SectionMatrixProfile");

  py::class_<BeamOptions>(m, "BeamOptions")
      .def(py::init([](const StrainCounts& modes, const std::string& basis,
                       const std::array<Eigen::MatrixXd, kStrains>& shapes, int order, bool rotary_inertia,
                       double damping_ratio, const std::array<double, kStrains>& kelvin_voigt,
                       const Eigen::MatrixXd& damping, int gauss_points, double tip_mass, double tip_offset,
                       const Eigen::Vector3d& tip_inertia, const Eigen::MatrixXd& curvature) {
             BeamOptions o;
             o.modes = modes;
             o.basis = basis_from_name(basis);
             o.shapes = shapes;
             o.tip = {tip_mass, tip_offset, tip_inertia};
             o.curvature = curvature;
             o.order = order;
             o.rotary_inertia = rotary_inertia;
             o.damping_ratio = damping_ratio;
             o.kelvin_voigt = kelvin_voigt;
             o.damping = damping;
             o.gauss_points = gauss_points;
             return o;
           }),
           py::arg("modes"), py::arg("basis"), py::arg("shapes"), py::arg("order"), py::arg("rotary_inertia"),
           py::arg("damping_ratio"), py::arg("kelvin_voigt"), py::arg("damping"), py::arg("gauss_points"),
           py::arg("tip_mass"), py::arg("tip_offset"), py::arg("tip_inertia"), py::arg("curvature"));
}

/// Piezoelectric patches.
void bind_patches(py::module_& m) {
  py::class_<Piezo>(m, "Piezo")
      .def(py::init<double, double, double, double, double, double, double>(), py::arg("youngs_modulus"),
           py::arg("poisson_ratio"), py::arg("density"), py::arg("d31"), py::arg("d32"), py::arg("d15"),
           py::arg("permittivity"));

  py::class_<PatchSection>(m, "PatchSection")
      .def(py::init([](const Piezo& material, int across, bool plus, bool minus, bool opposed, double angle,
                       double width, double thickness, double inner, double electrode, double twist) {
             return patch_section(material,
                                  {across, plus, minus, opposed, angle, width, thickness, inner, electrode, twist});
           }),
           py::arg("material"), py::arg("across"), py::arg("plus"), py::arg("minus"), py::arg("opposed"),
           py::arg("angle"), py::arg("width"), py::arg("thickness"), py::arg("inner"), py::arg("electrode"),
           py::arg("twist"))
      .def_readonly("rigidity", &PatchSection::rigidity)
      .def_readonly("force", &PatchSection::force)
      .def_readonly("capacitance", &PatchSection::capacitance)
      .def_readonly("mass", &PatchSection::mass)
      .def_readonly("inertia", &PatchSection::inertia);
  m.def("surface_twist", &surface_twist, py::arg("depth"), py::arg("breadth"), py::arg("width"));

  py::class_<Patch>(m, "Patch")
      .def(py::init([](double start, double end, const py::object& at, std::vector<double> breaks, bool stiffness,
                       bool mass) {
             return Patch{start, end, along<PatchSection>(at), std::move(breaks), stiffness, mass};
           }),
           py::arg("start"), py::arg("end"), py::arg("at"), py::arg("breaks"), py::arg("stiffness"), py::arg("mass"));
}

/// The beam.
void bind_beam(py::module_& m) {
  py::class_<Beam>(m, "Beam")
      .def(py::init<double, const Section&, const Material&, const BeamOptions&, const std::vector<Patch>&>(),
           py::arg("length"), py::arg("section"), py::arg("material"), py::arg("options"), py::arg("patches"),
           py::call_guard<Unlocked>())  // so that batches build theirs on all cores
      .def(py::init<double, const SectionProfile&, const Material&, const BeamOptions&, const std::vector<Patch>&>(),
           py::arg("length"), py::arg("section"), py::arg("material"), py::arg("options"), py::arg("patches"),
           py::call_guard<Unlocked>())
      .def(py::init<double, const SectionMatrix&, const BeamOptions&, const std::vector<Patch>&>(), py::arg("length"),
           py::arg("section"), py::arg("options"), py::arg("patches"), py::call_guard<Unlocked>())
      .def(py::init<double, const SectionMatrixProfile&, const BeamOptions&, const std::vector<Patch>&>(),
           py::arg("length"), py::arg("section"), py::arg("options"), py::arg("patches"), py::call_guard<Unlocked>())
      .def_property_readonly("patch_forces", &Beam::patch_forces)
      .def_property_readonly("patch_capacitances", &Beam::patch_capacitances)
      .def(
          "patch_force",
          [](const Beam& b, const Patch& patch) {
            double capacitance = 0.0;
            Eigen::VectorXd force = b.patch_force(patch, &capacitance);
            return py::make_tuple(force, capacitance);
          },
          py::arg("patch"))
      .def_property_readonly("mass", &Beam::mass)
      .def_property_readonly("gauss_points", [](const Beam& b) { return b.slices().size(); })
      .def_property_readonly("stiffness", &Beam::stiffness)
      .def(
          "turns",  // integral of K1, K2, K3 from 0 to each place, by coordinate: 3 rows a place
          [](const Beam& b, const Eigen::VectorXd& x) {
            Rows out = Rows::Zero(3 * x.size(), b.ne());
            for (Eigen::Index p = 0; p < x.size(); ++p)
              for (int s = 0; s < kStrains; ++s) {
                const StrainField& f = kStrainFields[s];
                if (f.rotation < 0) continue;
                const Eigen::VectorXd slope = b.shapes(s).at(x[p]).slope;
                out.row(3 * p + f.rotation).segment(b.first(s), slope.size()) = f.sign * slope.transpose();
              }
            return out;
          },
          py::arg("x"))
      .def("truncation", &truncation, py::arg("q"), py::call_guard<py::gil_scoped_release>())
      .def_property_readonly("damping", &Beam::damping)
      .def("strains", [](const Beam& self, double x) { return Rows(self.slice_at(x).strains); }, py::arg("x"));
}

/// Bodies, joints and links.
void bind_links(py::module_& m) {
  py::class_<RigidBody>(m, "RigidBody")
      .def(py::init(
               [](double mass, const Eigen::Vector3d& com, const Eigen::Matrix3d& inertia, const Eigen::Vector3d& end) {
                 RigidBody body{mass, com, inertia, end};
                 body.check();
                 return body;
               }),
           py::arg("mass"), py::arg("com"), py::arg("inertia"), py::arg("end"));

  py::class_<JointForce>(m, "JointForce")
      .def(py::init([](double stiffness, double rest, double damping, double lower, double upper,
                       double limit_stiffness, double limit_damping, double coulomb, double stiction,
                       double reflected_inertia, double torque_limit) {
             if (std::isnan(stiction)) bad_value("stiction", stiction, "must be finite, and at least coulomb");
             return JointForce{stiffness,       rest,          damping, lower,    upper,
                               limit_stiffness, limit_damping, coulomb, stiction, reflected_inertia,
                               torque_limit};
           }),
           py::arg("stiffness"), py::arg("rest"), py::arg("damping"), py::arg("lower"), py::arg("upper"),
           py::arg("limit_stiffness"), py::arg("limit_damping"), py::arg("coulomb"), py::arg("stiction"),
           py::arg("reflected_inertia"), py::arg("torque_limit"));

  py::class_<Joint>(m, "Joint")
      .def(py::init([](const std::vector<std::pair<bool, Eigen::Vector3d>>& motions, bool ball,
                       const std::vector<std::string>& labels, const std::vector<JointForce>& forces,
                       const std::pair<Eigen::Vector3d, Eigen::Matrix3d>& inboard,
                       const std::pair<Eigen::Vector3d, Eigen::Matrix3d>& outboard) {
             std::vector<ElementaryMotion> list;
             for (const auto& [rotation, axis] : motions) list.push_back({rotation, axis});
             return Joint(list, ball, labels, forces, {inboard.first, inboard.second},
                          {outboard.first, outboard.second});
           }),
           py::arg("motions"), py::arg("ball"), py::arg("labels"), py::arg("forces"), py::arg("inboard"),
           py::arg("outboard"));

  py::class_<Link>(m, "Link")
      .def(py::init<Joint, std::optional<RigidBody>, std::optional<Beam>, std::optional<RigidBody>>(), py::arg("joint"),
           py::arg("hub"), py::arg("beam"), py::arg("tip"))
      .def_property_readonly("mass", &Link::mass);
}

/// A point of a strut, a contact or a loop: a link, "origin", "end" or "slice" of it, the slice's place, and the
/// offset.
using PyPoint = std::tuple<int, std::string, double, Eigen::Vector3d>;
Strut::Point point_of(const PyPoint& from) {
  const auto& [link, on, x, offset] = from;
  const std::string places[] = {"origin", "end", "slice"};
  const auto found = std::find(std::begin(places), std::end(places), on) - std::begin(places);
  if (found == 3) bad_value("on", "\"" + on + "\"", "must be \"origin\", \"end\" or \"slice\"");
  return {link, static_cast<Strut::Point::On>(found), x, offset};
}

std::vector<Arm::Seat> seats_of(const std::vector<std::pair<int, std::optional<double>>>& seats) {
  std::vector<Arm::Seat> out;
  for (const auto& [link, at] : seats) out.emplace_back(link, at);
  return out;
}

}  // namespace

void bind_model(py::module_& m) {
  bind_strains(m);
  bind_sections(m);
  bind_patches(m);
  bind_beam(m);
  bind_links(m);

  py::class_<Arm>(m, "ArmAlone");  // PyArm's base, the type of arguments
  py::class_<PyArm, Arm> arm(m, "Arm");
  py::class_<PyStateForce>(m, "StateForce")
      .def(py::init([](const py::object& law) { return PyStateForce{state_force(law)}; }), py::arg("law"));
  py::class_<Load>(m, "Load")
      .def_static("at_end", &Load::at_end, py::arg("arm"), py::arg("link"), py::arg("world_axes"))
      .def_static("at_slice", &Load::at_slice, py::arg("arm"), py::arg("link"), py::arg("x"), py::arg("world_axes"))
      .def_static(
          "by_state",
          [](const Arm& on, std::size_t link, std::optional<double> x, bool world, const PyStateForce& law) {
            Load load = x ? Load::at_slice(on, link, *x, world) : Load::at_end(on, link, world);
            load.by_state = law.of;
            return load;
          },
          py::arg("arm"), py::arg("link"), py::arg("x"), py::arg("world_axes"), py::arg("law"))
      .def_static("on_strut", &Load::on_strut, py::arg("arm"), py::arg("strut"))
      .def_static("along", &Load::along, py::arg("arm"), py::arg("link"), py::arg("a"), py::arg("b"),
                  py::arg("world_axes"));
  py::class_<Strut>(m, "Strut")
      .def(py::init([](const std::vector<PyPoint>& points, double stiffness, double damping, double length,
                       double force, bool tension_only) {
             Strut strut{{}, stiffness, damping, length, force, tension_only};
             for (const PyPoint& point : points) strut.points.push_back(point_of(point));
             return strut;
           }),
           py::arg("points"), py::arg("stiffness"), py::arg("damping"), py::arg("length"), py::arg("force"),
           py::arg("tension_only"));
  py::class_<Contact>(m, "Contact")
      .def(py::init([](const PyPoint& point, double radius, const std::string& kind, const PyPoint& at,
                       const Eigen::Matrix3d& axes, const Eigen::Vector3d& size, double stiffness, double exponent,
                       double damping, double coulomb, double tangential_stiffness) {
             const std::string kinds[] = {"plane", "sphere", "box"};
             const auto found = std::find(std::begin(kinds), std::end(kinds), kind) - std::begin(kinds);
             if (found == 3) bad_value("kind", "\"" + kind + "\"", "must be \"plane\", \"sphere\" or \"box\"");
             return Contact{point_of(point),
                            radius,
                            {static_cast<Surface::Kind>(found), point_of(at), axes, size},
                            stiffness,
                            exponent,
                            damping,
                            coulomb,
                            tangential_stiffness};
           }),
           py::arg("point"), py::arg("radius"), py::arg("kind"), py::arg("at"), py::arg("axes"), py::arg("size"),
           py::arg("stiffness"), py::arg("exponent"), py::arg("damping"), py::arg("coulomb"),
           py::arg("tangential_stiffness"));
  py::class_<Loop>(m, "Loop").def(
      py::init([](const PyPoint& a, const PyPoint& b, const std::string& kind, const Eigen::Matrix3d& axes_a,
                  const Eigen::Matrix3d& axes_b, double stiffness, double damping, double angular_stiffness,
                  double angular_damping) {
        const std::optional<Loop::Kind> found = Loop::named(kind);
        if (!found) bad_value("kind", "\"" + kind + "\"", "closes no loop");
        return Loop{{point_of(a), axes_a}, {point_of(b), axes_b}, *found, stiffness, damping,
                    angular_stiffness,     angular_damping};
      }),
      py::arg("a"), py::arg("b"), py::arg("kind"), py::arg("axes_a"), py::arg("axes_b"), py::arg("stiffness"),
      py::arg("damping"), py::arg("angular_stiffness"), py::arg("angular_damping"));
  arm.def(py::init([](std::vector<Link> links, const Eigen::Vector3d& gravity,
                      const std::vector<std::pair<int, std::optional<double>>>& seats, std::vector<Strut> struts,
                      std::vector<Contact> contacts, std::vector<Loop> loops) {
            return std::make_unique<PyArm>(std::move(links), gravity, seats_of(seats), std::move(struts),
                                           std::move(contacts), std::move(loops));
          }),
          py::arg("links"), py::arg("gravity"), py::arg("seats"), py::arg("struts") = std::vector<Strut>{},
          py::arg("contacts") = std::vector<Contact>{}, py::arg("loops") = std::vector<Loop>{})
      .def_property_readonly("nq", &Arm::nq)
      .def_property_readonly("nv", &Arm::nv)
      .def_property_readonly("coordinates", &Arm::coordinates)
      .def_property_readonly("zero", &Arm::zero)
      .def("operation_count", &operation_count, py::arg("q"), py::arg("v"))
      .def("patch_matrix", [](const Arm& a) { return Rows(a.patch_matrix()); })
      .def("first", &Arm::first, py::arg("link"))
      .def("first_q", &Arm::first_q, py::arg("link"))
      .def("coordinate_of", &Arm::coordinate_of, py::arg("rate"))
      .def("farthest_out", &Arm::farthest_out, py::arg("q"), py::arg("v"));
  bind_dynamics(arm);
}
