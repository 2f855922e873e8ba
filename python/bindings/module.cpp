#include "interpreter.hpp"

PYBIND11_MODULE(_core, m) {
  m.doc() = "C++ core of flexarm. The documented face is the package `flexarm`.";
  m.attr("__version__") = FLEXARM_VERSION;
  bind_interpreter();
  bind_model(m);
  bind_problem(m);
  bind_time(m);
  bind_gradients(m);
  bind_batch(m);
  bind_laws(m);
  bind_linear_laws(m);
  bind_kalman(m);
  bind_mpc(m);
}
