# What every folder's CMakeLists.txt uses. A folder is one target, cotwin_<path with underscores>, with the alias
# cotwin::<last folder name>.

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_CXX_VISIBILITY_PRESET hidden)
set(CMAKE_C_VISIBILITY_PRESET hidden)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin)
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release CACHE STRING "" FORCE)
endif()

add_library(cotwin_settings INTERFACE)
target_include_directories(cotwin_settings INTERFACE ${PROJECT_SOURCE_DIR})
target_compile_options(cotwin_settings INTERFACE -Wall -Wextra -Wconversion -Wshadow $<$<BOOL:${COTWIN_WERROR}>:-Werror>)
# GCC 12 sees overlapping copies in "literal" + std::string where there are none (its bug 105651).
target_compile_options(cotwin_settings INTERFACE $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>)
if(COTWIN_SANITIZE)
  add_compile_options(-fsanitize=${COTWIN_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer)
  add_link_options(-fsanitize=${COTWIN_SANITIZE})
  add_compile_definitions(EIGEN_INITIALIZE_MATRICES_BY_NAN)
endif()

if(COTWIN_FUZZ)
  add_compile_options(-fsanitize=fuzzer-no-link)  # the fuzzer sees the branches of the libraries, too
endif()

# cotwin_library(SOURCES a.cpp … [PUBLIC targets…] [PRIVATE targets…]): the library of the current folder.
function(cotwin_library)
  cmake_parse_arguments(arg "" "" "SOURCES;PUBLIC;PRIVATE" ${ARGN})
  file(RELATIVE_PATH path ${PROJECT_SOURCE_DIR} ${CMAKE_CURRENT_SOURCE_DIR})
  string(REPLACE "/" "_" name ${path})
  cmake_path(GET path FILENAME short)
  add_library(cotwin_${name} STATIC ${arg_SOURCES})
  add_library(cotwin::${short} ALIAS cotwin_${name})
  target_link_libraries(cotwin_${name} PUBLIC cotwin_settings ${arg_PUBLIC} PRIVATE ${arg_PRIVATE})
endfunction()

# cotwin_unit(CLASS DriveTrain SUMMARY "…"): the current folder's library holds a unit; its name is the folder's, its header is
# <folder>/<folder>.h and its class cotwin::<folder>::<CLASS>, constructible from Settings&. From this line it becomes a scenario
# source `unit:<folder>`, a reference page and a subject of the property tests.
function(cotwin_unit)
  cmake_parse_arguments(arg "" "CLASS;SUMMARY" "" ${ARGN})
  cmake_path(GET CMAKE_CURRENT_SOURCE_DIR FILENAME name)
  set_property(GLOBAL APPEND PROPERTY COTWIN_UNITS ${name})
  set_property(GLOBAL PROPERTY COTWIN_UNIT_${name}_CLASS ${arg_CLASS})
  set_property(GLOBAL PROPERTY COTWIN_UNIT_${name}_SUMMARY ${arg_SUMMARY})
endfunction()

# Writes the table of all units and makes it the library cotwin::units.
function(cotwin_unit_table)
  get_property(units GLOBAL PROPERTY COTWIN_UNITS)
  set(includes "")
  set(rows "")
  set(libraries "")
  foreach(unit IN LISTS units)
    get_property(class GLOBAL PROPERTY COTWIN_UNIT_${unit}_CLASS)
    get_property(summary GLOBAL PROPERTY COTWIN_UNIT_${unit}_SUMMARY)
    string(APPEND includes "#include \"components/${unit}/${unit}.h\"\n")
    string(APPEND rows "    {\"${unit}\", \"${summary}\",\n     [](Settings& s) -> std::unique_ptr<Unit> { return std::make_unique<${unit}::${class}>(s); }},\n")
    list(APPEND libraries cotwin::${unit})
  endforeach()
  configure_file(${PROJECT_SOURCE_DIR}/components/unit/unit_table.cpp.in ${CMAKE_BINARY_DIR}/generated/unit_table.cpp @ONLY)
  add_library(cotwin_units STATIC ${CMAKE_BINARY_DIR}/generated/unit_table.cpp)
  add_library(cotwin::units ALIAS cotwin_units)
  target_link_libraries(cotwin_units PUBLIC cotwin_settings cotwin::unit PRIVATE ${libraries})
endfunction()

# cotwin_test(name SOURCES … LINK … [THREADS]): one GoogleTest program; every TEST in it is a CTest test of its own. THREADS: also run
# under the thread sanitizer (CTest label `threads`).
function(cotwin_test name)
  if(NOT COTWIN_TESTS)
    return()
  endif()
  cmake_parse_arguments(arg "THREADS" "" "SOURCES;LINK" ${ARGN})
  if(COTWIN_SANITIZE STREQUAL "thread" AND NOT arg_THREADS)
    return()
  endif()
  add_executable(${name} ${arg_SOURCES})
  target_link_libraries(${name} PRIVATE cotwin_settings ${arg_LINK} GTest::gtest_main GTest::gmock)
  target_compile_definitions(${name} PRIVATE COTWIN_SOURCE_DIR="${PROJECT_SOURCE_DIR}" COTWIN_SHARED_DIR="${PROJECT_SOURCE_DIR}/../shared"
    COTWIN_PROGRAM="${CMAKE_BINARY_DIR}/bin/cotwin")
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
  gtest_discover_tests(${name} DISCOVERY_TIMEOUT 120 PROPERTIES TIMEOUT 600 LABELS "$<$<BOOL:${arg_THREADS}>:threads>")
endfunction()

# cotwin_benchmark(name SOURCES … LINK …): a program that prints one JSON object per line (tests/benchmarks/measure.h).
function(cotwin_benchmark name)
  if(NOT COTWIN_BENCHMARKS)
    return()
  endif()
  cmake_parse_arguments(arg "" "" "SOURCES;LINK" ${ARGN})
  add_executable(${name} ${arg_SOURCES})
  target_link_libraries(${name} PRIVATE cotwin_settings ${arg_LINK})
  target_compile_definitions(${name} PRIVATE COTWIN_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/benchmarks)
endfunction()

# cotwin_fuzz(name SOURCES … LINK …): a libFuzzer program; with any compiler but clang, or without COTWIN_FUZZ, nothing.
function(cotwin_fuzz name)
  if(NOT COTWIN_FUZZ)
    return()
  endif()
  cmake_parse_arguments(arg "" "" "SOURCES;LINK" ${ARGN})
  add_executable(${name} ${arg_SOURCES})
  target_link_libraries(${name} PRIVATE cotwin_settings ${arg_LINK})
  target_compile_options(${name} PRIVATE -fsanitize=fuzzer)
  target_link_options(${name} PRIVATE -fsanitize=fuzzer)
  target_compile_definitions(${name} PRIVATE COTWIN_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/fuzz)
  if(NOT TARGET fuzz_targets)
    add_custom_target(fuzz_targets)
  endif()
  add_dependencies(fuzz_targets ${name})
endfunction()
