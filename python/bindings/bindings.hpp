// Shared by the binding files, one per room of the C++ library.
#pragma once

#include <pybind11/eigen.h>
#include <pybind11/functional.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "flexarm/arm.hpp"

namespace py = pybind11;

/// A batch of vectors, one per row; C-contiguous on the Python side.
using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

void bind_model(py::module_& m);        // section, shape, beam, joint, link, arm
void bind_time(py::module_& m);         // drive, ida
void bind_gradients(py::module_& m);    // step_derivatives, run_derivatives, rollout_tape
void bind_batch(py::module_& m);        // batch
void bind_problem(py::module_& m);      // problem and its parts
void bind_laws(py::module_& m);         // computed torque
void bind_linear_laws(py::module_& m);  // PID and its kin, sampled
void bind_kalman(py::module_& m);       // the Kalman filter
void bind_mpc(py::module_& m);          // predictive control
