# DAQP, the solver of quadratic programs of Mpc, as the object library flexarm_daqp: its C source stands in its source
# package on PyPI, which pip brings once for a build folder, or in FLEXARM_DAQP.
set(daqp_version 0.11.0)
set(daqp_hash sha256:2f27baf18d2acca14186498e651b34e0bed455627e777d3fd8ba655e7e40f920)
set(daqp ${FLEXARM_DAQP})
if(NOT daqp)
  set(daqp ${CMAKE_CURRENT_BINARY_DIR}/daqp/daqp-${daqp_version})
  if(NOT EXISTS ${daqp}/csrc/src/api.c)
    set(daqp_pip no)
    find_program(FLEXARM_PYTHON3 NAMES python3 python DOC "A Python with pip, to bring DAQP")
    mark_as_advanced(FLEXARM_PYTHON3)
    file(WRITE ${CMAKE_CURRENT_BINARY_DIR}/daqp/wanted.txt "daqp==${daqp_version} --hash=${daqp_hash}\n")
    foreach(python ${PYTHON_EXECUTABLE} ${Python_EXECUTABLE} ${FLEXARM_PYTHON3})
      if(NOT daqp_pip EQUAL 0)
        execute_process(
          COMMAND ${python} -m pip download -q --no-deps --no-binary daqp --require-hashes -r wanted.txt -d .
          WORKING_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR}/daqp RESULT_VARIABLE daqp_pip ERROR_VARIABLE daqp_told)
      endif()
    endforeach()
    if(daqp_pip EQUAL 0)
      file(ARCHIVE_EXTRACT INPUT ${CMAKE_CURRENT_BINARY_DIR}/daqp/daqp-${daqp_version}.tar.gz
           DESTINATION ${CMAKE_CURRENT_BINARY_DIR}/daqp)
    endif()
  endif()
endif()
if(EXISTS ${daqp}/csrc/src/api.c)
  set(daqp ${daqp}/csrc)
endif()
if(NOT EXISTS ${daqp}/src/api.c)
  message(FATAL_ERROR "flexarm::Mpc, model predictive control, needs the source of DAQP ${daqp_version}, which was not "
    "found in ${daqp}, and pip did not bring it: ${daqp_told}\n"
    "Set FLEXARM_DAQP to the folder that holds it, or, to go without Mpc, "
    "FLEXARM_MPC=OFF (pip install . --config-settings=cmake.define.FLEXARM_MPC=OFF).")
endif()
enable_language(C)
set(daqp_include ${daqp}/include)
file(GLOB daqp_sources ${daqp}/src/*.c)
add_library(flexarm_daqp OBJECT ${daqp_sources})
target_include_directories(flexarm_daqp PRIVATE ${daqp_include})
target_compile_options(flexarm_daqp PRIVATE -w -O3)
set_target_properties(flexarm_daqp PROPERTIES C_VISIBILITY_PRESET hidden UNITY_BUILD OFF)
