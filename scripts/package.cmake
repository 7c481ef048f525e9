# What `cmake --install` puts in place, and the Debian packages that `cpack` makes. Everything is relative to the prefix; an installed
# program finds its files relative to itself (models/foundation/support/installation.h).
#   component cotwin      the program, the shared library, robots, scenes, libraries of FMUs, examples, licences
#   component cotwin-dev  headers, static libraries and cotwinConfig.cmake, for find_package(cotwin)
#   component cotwin-python  the package `cotwin` for Python, if it is built
set(cmake_folder lib/cmake/cotwin)

# The same layout in the build tree: robots and scenes beside bin/ and lib/.
file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/share/cotwin)
file(CREATE_LINK ${PROJECT_SOURCE_DIR}/models ${CMAKE_BINARY_DIR}/share/cotwin/models SYMBOLIC)

install(DIRECTORY models/robots models/scenes models/people models/scenarios DESTINATION share/cotwin/models COMPONENT cotwin)
install(DIRECTORY examples DESTINATION share/cotwin COMPONENT cotwin USE_SOURCE_PERMISSIONS)
# The project of docs/library.md, which tests/install builds.
set(own_unit tests/install/consumer)
install(FILES ${own_unit}/own_unit/CMakeLists.txt ${own_unit}/springs.ssd DESTINATION share/cotwin/examples/own_unit COMPONENT cotwin)
install(DIRECTORY ${own_unit}/spring DESTINATION share/cotwin/examples/own_unit COMPONENT cotwin)
install(PROGRAMS scripts/fetch_logs.py DESTINATION share/cotwin/scripts COMPONENT cotwin)
install(FILES scripts/completion.bash DESTINATION share/bash-completion/completions RENAME cotwin COMPONENT cotwin)
install(DIRECTORY ${CMAKE_BINARY_DIR}/share/man/man1 DESTINATION share/man COMPONENT cotwin)   # written by `cotwin manual`
install(FILES README.md CHANGELOG.md DESTINATION share/doc/cotwin COMPONENT cotwin)
install(DIRECTORY docs DESTINATION share/doc/cotwin COMPONENT cotwin FILES_MATCHING PATTERN "*.md")

# Licences: Cotwin's own, and those of what its programs contain (linked statically, or headers).
set(copyright ${CMAKE_BINARY_DIR}/generated/copyright)
file(READ LICENSE text)
string(PREPEND text "Cotwin is licensed under the Apache License, Version 2.0. Its programs contain code of the packages after it.\n\n")
foreach(package IN ITEMS libsundials-dev libeigen3-dev nlohmann-json3-dev libcli11-dev)
  if(EXISTS /usr/share/doc/${package}/copyright)
    file(READ /usr/share/doc/${package}/copyright part)
    string(APPEND text "\n======== ${package} ========\n\n${part}")
  endif()
endforeach()
file(CONFIGURE OUTPUT ${copyright} CONTENT "${text}" @ONLY)
install(FILES ${copyright} DESTINATION share/doc/cotwin COMPONENT cotwin)
install(FILES ${copyright} DESTINATION share/doc/cotwin-dev COMPONENT cotwin-dev)

# The bill of materials, CycloneDX.
find_package(Python3 COMPONENTS Interpreter QUIET)
if(Python3_Interpreter_FOUND)
  set(bill ${CMAKE_BINARY_DIR}/generated/cotwin.cdx.json)
  execute_process(COMMAND ${Python3_EXECUTABLE} ${PROJECT_SOURCE_DIR}/scripts/sbom.py ${PROJECT_VERSION} ${bill} COMMAND_ERROR_IS_FATAL ANY)
  install(FILES ${bill} DESTINATION share/doc/cotwin COMPONENT cotwin)
  install(FILES ${bill} DESTINATION share/doc/cotwin-dev COMPONENT cotwin-dev)
endif()

# find_package(cotwin): the shared library with the public API, and the static libraries that a unit from outside is built with.
get_property(libraries GLOBAL PROPERTY COTWIN_LIBRARIES_FOR_UNITS)
install(TARGETS cotwin_settings ${libraries} cotwin_fmu_export cotwin_fmu_unload EXPORT cotwin-units
  ARCHIVE DESTINATION lib/cotwin COMPONENT cotwin-dev
  OBJECTS DESTINATION lib/cotwin COMPONENT cotwin-dev)
install(EXPORT cotwin-units NAMESPACE cotwin:: DESTINATION ${cmake_folder} FILE cotwinUnitTargets.cmake COMPONENT cotwin-dev)
install(TARGETS cotwin_api EXPORT cotwin LIBRARY DESTINATION lib COMPONENT cotwin NAMELINK_COMPONENT cotwin-dev)
install(EXPORT cotwin NAMESPACE cotwin:: DESTINATION ${cmake_folder} FILE cotwinTargets.cmake COMPONENT cotwin-dev)
install(FILES master/api/cotwin.h DESTINATION include/cotwin COMPONENT cotwin-dev)
set(headers FILES_MATCHING PATTERN "*.h" PATTERN robots EXCLUDE PATTERN scenes EXCLUDE PATTERN kernels EXCLUDE)
install(DIRECTORY models fmu DESTINATION include/cotwin COMPONENT cotwin-dev ${headers})
install(DIRECTORY components/unit components/bus components/robot_files components/services DESTINATION include/cotwin/components COMPONENT cotwin-dev ${headers})

include(CMakePackageConfigHelpers)
get_property(unit_interface GLOBAL PROPERTY COTWIN_UNIT_INTERFACE)
configure_package_config_file(scripts/cotwinConfig.cmake.in ${CMAKE_BINARY_DIR}/generated/cotwinConfig.cmake INSTALL_DESTINATION ${cmake_folder})
set(compatibility SameMajorVersion)
if(PROJECT_VERSION_MAJOR EQUAL 0)   # before 1.0 a minor version may break what was promised
  set(compatibility SameMinorVersion)
endif()
write_basic_package_version_file(${CMAKE_BINARY_DIR}/generated/cotwinConfigVersion.cmake COMPATIBILITY ${compatibility})
install(FILES ${CMAKE_BINARY_DIR}/generated/cotwinConfig.cmake ${CMAKE_BINARY_DIR}/generated/cotwinConfigVersion.cmake
  scripts/units.cmake fmu/fmu.cmake components/unit/unit_module.cpp.in DESTINATION ${cmake_folder} COMPONENT cotwin-dev)
install(FILES fmu/export/exported_symbols.map fmu/export/exported_unit.cpp.in fmu/export/old_glibc.cpp
  DESTINATION ${cmake_folder}/export COMPONENT cotwin-dev)
install(PROGRAMS fmu/export/old_glibc.sh DESTINATION ${cmake_folder}/export COMPONENT cotwin-dev)

# Debian packages: cpack -G DEB in the build folder.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME cotwin)
set(CPACK_PACKAGE_CONTACT "The Cotwin developers <maintainers@cotwin.invalid>")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_ALL cotwin cotwin-dev)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_COTWIN_PACKAGE_NAME cotwin)
set(CPACK_DEBIAN_COTWIN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_COTWIN_PACKAGE_SUGGESTS gnuplot-nox)   # plots of `cotwin report`
set(CPACK_STRIP_FILES ON)
set(CPACK_DEBIAN_COTWIN_DESCRIPTION "The program cotwin runs scenarios of flexible-joint robots, contact worlds, controllers and recordings, exports units and scenarios as FMUs (FMI 2 and 3) and tunes a robot's model to measured torques.")
set(CPACK_DEBIAN_COTWIN-DEV_PACKAGE_NAME cotwin-dev)
set(CPACK_DEBIAN_COTWIN-DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_COTWIN-DEV_PACKAGE_DEPENDS "cotwin (= ${PROJECT_VERSION}), libeigen3-dev, libsundials-dev, liburdfdom-dev, libtinyxml2-dev, libexpat1-dev, libzip-dev, nlohmann-json3-dev, pkg-config")
set(CPACK_DEBIAN_COTWIN-DEV_DESCRIPTION "Headers, libraries and CMake package, for programs that use cotwin as a library and for units from outside of its source tree.")
if(TARGET cotwin_python)
  find_package(Python3 COMPONENTS Interpreter QUIET)
  math(EXPR next_python "${Python3_VERSION_MINOR} + 1")
  list(APPEND CPACK_COMPONENTS_ALL cotwin-python)
  install(FILES ${copyright} ${bill} DESTINATION share/doc/python3-cotwin COMPONENT cotwin-python)
  set(CPACK_DEBIAN_COTWIN-PYTHON_PACKAGE_NAME python3-cotwin)
  set(CPACK_DEBIAN_COTWIN-PYTHON_PACKAGE_SECTION python)
  set(CPACK_DEBIAN_COTWIN-PYTHON_PACKAGE_DEPENDS "cotwin (= ${PROJECT_VERSION}), python3 (>= ${Python3_VERSION_MAJOR}.${Python3_VERSION_MINOR}), python3 (<< ${Python3_VERSION_MAJOR}.${next_python}), python3-numpy")
  set(CPACK_DEBIAN_COTWIN-PYTHON_DESCRIPTION "The package cotwin for Python: scenarios, recordings, robot dynamics on NumPy arrays, tuning and motion services.")
endif()
include(CPack)

# Pages of the public API.
find_package(Doxygen QUIET)
if(DOXYGEN_FOUND)
  configure_file(docs/Doxyfile.in ${CMAKE_BINARY_DIR}/generated/Doxyfile @ONLY)
  add_custom_target(docs COMMAND ${DOXYGEN_EXECUTABLE} ${CMAKE_BINARY_DIR}/generated/Doxyfile VERBATIM)
endif()
