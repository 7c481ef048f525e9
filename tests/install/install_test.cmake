# Installs the build into a folder, moves that folder, builds consumer/ against it and tries the program, the API and a unit from outside.
# Nothing of source tree and build tree is used after the installation: no variable of the environment, another working directory.
#   cmake -DBUILD=… -DSOURCE=… -DWORK=… -P install_test.cmake
file(REMOVE_RECURSE ${WORK})
file(MAKE_DIRECTORY ${WORK}/run)
set(prefix ${WORK}/moved/prefix)
set(platform x86_64-linux)
if(CMAKE_HOST_SYSTEM_PROCESSOR MATCHES "aarch64")
  set(platform aarch64-linux)
endif()

# expect(EXIT_CODE PART command…): the command ends with that code and prints PART to stdout or stderr.
function(expect code part)
  execute_process(COMMAND env -i PATH=/usr/bin:/bin ${ARGN} WORKING_DIRECTORY ${WORK}/run RESULT_VARIABLE result OUTPUT_VARIABLE output
    ERROR_VARIABLE output TIMEOUT 120)
  string(FIND "${output}" "${part}" found)
  if(NOT result EQUAL code OR found EQUAL -1)
    message(SEND_ERROR "${ARGN}\nended with ${result}, expected ${code}, and '${part}' in its output:\n${output}")
  endif()
endfunction()

function(expect_file)
  foreach(file IN LISTS ARGN)
    if(NOT EXISTS ${file})
      message(SEND_ERROR "no file ${file}")
    endif()
  endforeach()
endfunction()

function(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(NOT result EQUAL 0)
    message(FATAL_ERROR "${ARGN}\nended with ${result}:\n${output}")
  endif()
endfunction()

run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/first)
file(MAKE_DIRECTORY ${WORK}/moved)
file(RENAME ${WORK}/first ${prefix})
set(cotwin ${prefix}/bin/cotwin)

# The layout.
expect_file(${cotwin} ${prefix}/bin/cotwin-fmu-host ${prefix}/lib/libcotwin.so ${prefix}/include/cotwin/cotwin.h
  ${prefix}/lib/cotwin/fmu/${platform}/drive_train.so ${prefix}/lib/cotwin/fmu/${platform}/licenses/license.txt
  ${prefix}/lib/cmake/cotwin/cotwinConfig.cmake ${prefix}/share/cotwin/models/robots/lwr4/robot.urdf
  ${prefix}/share/cotwin/models/scenes/table/scene.sdf ${prefix}/share/doc/cotwin/copyright
  ${prefix}/share/bash-completion/completions/cotwin ${prefix}/share/man/man1/cotwin.1 ${prefix}/share/man/man1/cotwin-run.1)

# Which versions find_package(cotwin VERSION) accepts.
function(expect_version wanted accepted)
  set(PACKAGE_FIND_VERSION ${wanted})
  string(REPLACE "." ";" parts ${wanted})
  list(GET parts 0 PACKAGE_FIND_VERSION_MAJOR)
  list(GET parts 1 PACKAGE_FIND_VERSION_MINOR)
  set(CMAKE_SIZEOF_VOID_P "")
  include(${prefix}/lib/cmake/cotwin/cotwinConfigVersion.cmake)
  if(NOT PACKAGE_VERSION_COMPATIBLE STREQUAL accepted)
    message(SEND_ERROR "find_package(cotwin ${wanted}): '${PACKAGE_VERSION_COMPATIBLE}', expected '${accepted}'")
  endif()
endfunction()
string(REGEX MATCH "^([0-9]+)\\.([0-9]+)" same ${VERSION})
math(EXPR next_minor "${CMAKE_MATCH_2} + 1")
math(EXPR next_major "${CMAKE_MATCH_1} + 1")
expect_version(${same} TRUE)
expect_version(${CMAKE_MATCH_1}.${next_minor} FALSE)
expect_version(${next_major}.0 FALSE)

# No path of this machine's trees is in what was installed.
foreach(file IN ITEMS ${cotwin} ${prefix}/lib/libcotwin.so ${prefix}/lib/cmake/cotwin/cotwinUnitTargets.cmake)
  foreach(tree IN ITEMS ${SOURCE} ${BUILD})
    execute_process(COMMAND grep -c -F -e "${tree}" ${file} OUTPUT_VARIABLE lines)
    if(NOT lines EQUAL 0)
      message(SEND_ERROR "${file} contains the path ${tree}")
    endif()
  endforeach()
endforeach()

# The library exports the public API and nothing else.
execute_process(COMMAND nm -D --defined-only -C ${prefix}/lib/libcotwin.so COMMAND grep -v -E " (T|W|V|A) (cotwin::(version|tune|excite|ask|service_names|unit_names|service_schema|load_recording|Robot::|Simulation::)|LIBCOTWIN)"
  OUTPUT_VARIABLE others)
if(NOT others STREQUAL "")
  message(SEND_ERROR "libcotwin.so exports more than the public API:\n${others}")
endif()

# The program finds robots, scenes, libraries of FMUs and its helper, also through a link.
file(CREATE_LINK ${cotwin} ${WORK}/run/linked SYMBOLIC)
expect(0 "joint torque" ${WORK}/run/linked run ${prefix}/share/cotwin/examples/02_free_motion_lwr4/twin.ssd --stop 0.1 --out ${WORK}/run/example)
expect(0 "tau_J" ${cotwin} describe unit:drive_train?robot=lwr4)
expect(0 "" ${cotwin} describe unit:contact_world?scene=table&robot=planar2)
expect(0 "" ${WORK}/run/linked pack unit:motion?robot=planar2 --fmi 3 --set waypoint_t=0,1 --set "waypoint_q=0 0 1 1" -o ${WORK}/run/motion.fmu)
expect(0 "" ${cotwin} run ${WORK}/run/motion.fmu --stop-time 0.1 --process own --output-file ${WORK}/run/motion.csv)
expect(0 "complete" ${cotwin} completion bash)
expect(0 "" bash -c "PATH=${prefix}/bin:$PATH; source ${prefix}/share/bash-completion/completions/cotwin && complete -p cotwin")

# The package for Python finds its library and the robots relative to itself.
file(GLOB python LIST_DIRECTORIES true ${prefix}/lib/python3/dist-packages)
if(python)
  expect_file(${python}/cotwin/py.typed ${python}/cotwin/_native.pyi)
  expect(0 "(7,)" env PYTHONPATH=${python} /usr/bin/python3 -c "print(__import__('cotwin').Robot('lwr4').gravity([0] * 7).shape)")
endif()

# The scripts of examples find the program installed beside them, also through a link; without public data they report what is missing.
foreach(example IN ITEMS 03_dynamics_capture 06_real_robots)
  set(script ${prefix}/share/cotwin/examples/${example}/run.sh)
  file(CREATE_LINK ${script} ${WORK}/run/${example}.sh SYMBOLIC)
  expect(2 "These are public measurements" env DATA=${WORK}/none ${script})
  expect(2 "These are public measurements" env DATA=${WORK}/none ${WORK}/run/${example}.sh)
endforeach()
file(COPY ${prefix}/share/cotwin/examples DESTINATION ${WORK}/alone)
expect(2 "no program 'cotwin'" ${WORK}/alone/examples/06_real_robots/run.sh)
expect(2 "These are public measurements" env PATH=${prefix}/bin:/usr/bin:/bin DATA=${WORK}/none ${WORK}/alone/examples/06_real_robots/run.sh)

# The consumer.
set(flags "")
if(EXISTS /usr/bin/ccache)
  set(flags -DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
endif()
run(${CMAKE_COMMAND} -S ${SOURCE}/tests/install/consumer -B ${WORK}/consumer -G ${GENERATOR} -DCMAKE_BUILD_TYPE=Release
  -DCMAKE_PREFIX_PATH=${prefix} ${flags})
run(${CMAKE_COMMAND} --build ${WORK}/consumer)
# The unit of docs/library.md, as it is installed.
run(${CMAKE_COMMAND} -S ${prefix}/share/cotwin/examples/own_unit -B ${WORK}/own_unit -G ${GENERATOR} -DCMAKE_BUILD_TYPE=Release
  -DCMAKE_PREFIX_PATH=${prefix} ${flags})
run(${CMAKE_COMMAND} --build ${WORK}/own_unit)
expect(0 "" ${cotwin} run ${prefix}/share/cotwin/examples/own_unit/springs.ssd --units ${WORK}/own_unit/units/spring.so --quiet --out ${WORK}/run/own_unit)
set(module ${WORK}/consumer/units/spring.so)
expect_file(${module} ${WORK}/consumer/units/fmu/${platform}/spring.so)

# expect_last(FILE COLUMN VALUE): the column's value in the last row of a CSV, to 1e-9.
function(expect_last file column value)
  execute_process(COMMAND awk -F, -v column=${column} -v value=${value} [=[
      NR == 1 {for (i = 1; i <= NF; ++i) if ($i == column || $i == "\"" column "\"") c = i}
      {last = $c}
      END {d = last - value; exit !(c && d < 1e-9 && d > -1e-9)}]=] ${file} RESULT_VARIABLE result)
  if(NOT result EQUAL 0)
    message(SEND_ERROR "${file}: the last value of ${column} is not ${value}")
  endif()
endfunction()

# The unit from outside: scenario, FMU of both versions, reference page.
expect(0 "masses on linear springs" ${cotwin} units --units ${module})
expect(0 "stiffness of each spring" ${cotwin} describe unit:spring?robot=planar2 --units ${WORK}/consumer/units)
expect(0 "" env COTWIN_UNITS=${module} ${cotwin} check ${SOURCE}/tests/install/consumer/springs.ssd)
expect(0 "springs" ${cotwin} run ${SOURCE}/tests/install/consumer/springs.ssd --units ${module} --out ${WORK}/run/springs)
expect_last(${WORK}/run/springs/signals.csv "spring.position[1]" -0.41953576453822617)   # 0.5 cos(10)
foreach(fmi IN ITEMS 2 3)
  set(fmu ${WORK}/run/spring${fmi}.fmu)
  expect(0 "" ${cotwin} pack unit:spring?robot=planar2 --units ${module} --fmi ${fmi} --set k=100 --set "x=0.5 0" -o ${fmu})
  expect(0 "" ${cotwin} check ${fmu})
  expect(0 "" ${cotwin} run ${fmu} --stop-time 1 --output-interval 0.001 --output-file ${WORK}/run/spring${fmi}.csv)
endforeach()
# The API runs an FMU in a process of its own: the library finds the helper program.
file(READ ${SOURCE}/tests/install/consumer/springs.ssd text)
string(REPLACE "unit:spring?robot=planar2\" type=\"application/x-cotwin-unit" "${WORK}/run/spring3.fmu?process=own\" type=\"application/x-fmu-sharedlibrary" text "${text}")
file(WRITE ${WORK}/run/fmu.ssd "${text}")
expect(0 "0 failures" ${WORK}/consumer/use_api ${prefix}/share/cotwin/examples/01_joint_admittance/arm.ssd
  ${SOURCE}/tests/install/consumer/springs.ssd ${module} ${WORK}/run ${WORK}/run/fmu.ssd)
expect_last(${WORK}/run/spring2.csv "position[1]" -0.41953576453822617)
expect(0 "" ${cotwin} reference ${WORK}/run/pages --units ${module})
expect_file(${WORK}/run/pages/spring.md)

# What is refused, and how.
expect(2 "is a module for cotwin 0.0.1, expected ${VERSION}" ${cotwin} units --units ${WORK}/consumer/refused/stale.so)
expect(2 "has no function cotwin_unit_module" ${cotwin} units --units ${prefix}/lib/libcotwin.so)
expect(2 "no such file" ${cotwin} units --units ${WORK}/run/none.so)
expect(2 "no such unit" ${cotwin} run ${SOURCE}/tests/install/consumer/springs.ssd)
