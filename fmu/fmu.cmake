# COTWIN_FMU_PLATFORM: the name of this platform in FMI 3. COTWIN_FMU_FOLDER: the folder in which pack_unit looks for the libraries of units.
string(TOLOWER ${CMAKE_SYSTEM_PROCESSOR}-${CMAKE_SYSTEM_NAME} COTWIN_FMU_PLATFORM)
set(COTWIN_FMU_FOLDER ${CMAKE_BINARY_DIR}/lib/cotwin/fmu CACHE PATH "folder for the libraries of FMUs, <folder>/<platform>/<unit>.so")
set(COTWIN_FMU_EXPORT ${CMAKE_CURRENT_LIST_DIR}/export)
set(COTWIN_FMU_SYMBOLS ${COTWIN_FMU_EXPORT}/exported_symbols.map)
set(COTWIN_FMU_GLIBC 2.28 CACHE STRING "oldest glibc that exported units load with (2.28: RHEL 8, Debian 10); empty: the glibc of this machine")
set(cotwin_old_glibc OFF)
if(CMAKE_SYSTEM_NAME STREQUAL Linux AND COTWIN_FMU_GLIBC AND NOT COTWIN_SANITIZE)
  set(cotwin_old_glibc ON)
endif()

# The target cotwin_fmu_old_glibc: objects with the functions that COTWIN_FMU_GLIBC lacks, and a C library of that version to link against.
function(cotwin_old_glibc)
  set(script ${COTWIN_FMU_EXPORT}/old_glibc.sh)
  set(folder ${CMAKE_BINARY_DIR}/old_glibc)
  add_custom_command(OUTPUT ${folder}/libc.so DEPENDS ${script} VERBATIM
    COMMAND ${script} ${COTWIN_FMU_GLIBC} ${CMAKE_CXX_COMPILER} ${CMAKE_READELF} ${folder})
  add_library(cotwin_fmu_old_glibc OBJECT ${COTWIN_FMU_EXPORT}/old_glibc.cpp ${folder}/libc.so)
  target_link_libraries(cotwin_fmu_old_glibc PRIVATE cotwin::settings)
  set_target_properties(cotwin_fmu_old_glibc PROPERTIES POSITION_INDEPENDENT_CODE ON CXX_VISIBILITY_PRESET hidden)
endfunction()

# cotwin_fmu_link(target): link options of an exported unit's library. It exports only fmi2* and fmi3*, needs only the C library (on Windows:
# the libraries of Windows), and contains the C++ run-time library.
function(cotwin_fmu_link target)
  if(WIN32)   # fmi2.h and fmi3.h declare the exported functions as dllexport
    set_target_properties(${target} PROPERTIES PREFIX "")
    target_sources(${target} PRIVATE $<TARGET_OBJECTS:cotwin::fmu_unload>)
    target_link_options(${target} PRIVATE -static -s LINKER:--gc-sections LINKER:--no-insert-timestamp)
    return()
  endif()
  set_target_properties(${target} PROPERTIES PREFIX "" NO_SONAME ON LINK_DEPENDS ${COTWIN_FMU_SYMBOLS})
  target_link_options(${target} PRIVATE LINKER:--version-script=${COTWIN_FMU_SYMBOLS} LINKER:--exclude-libs,ALL
    LINKER:--as-needed LINKER:--gc-sections LINKER:-Bsymbolic LINKER:-z,relro)
  if(NOT COTWIN_SANITIZE)   # the program that loads this library has the sanitizer's run-time library
    target_sources(${target} PRIVATE $<TARGET_OBJECTS:cotwin::fmu_unload>)
    target_link_options(${target} PRIVATE -static-libstdc++ -static-libgcc LINKER:--no-undefined $<$<CONFIG:Release>:-s>)
  else()   # line numbers are nine tenths of the library, and the tests compress hundreds of packages; reports keep the names of functions
    target_link_options(${target} PRIVATE LINKER:--strip-debug)
  endif()
  if(cotwin_old_glibc)
    target_sources(${target} PRIVATE $<TARGET_OBJECTS:cotwin_fmu_old_glibc>)
    target_link_options(${target} BEFORE PRIVATE -L${CMAKE_BINARY_DIR}/old_glibc)
    add_dependencies(${target} cotwin_fmu_old_glibc)
  endif()
endfunction()

# cotwin_unit_row(out unit): the unit's row of a table of UnitType, as C++ text.
function(cotwin_unit_row out unit)
  get_property(class GLOBAL PROPERTY COTWIN_UNIT_${unit}_CLASS)
  get_property(summary GLOBAL PROPERTY COTWIN_UNIT_${unit}_SUMMARY)
  set(row "\"${unit}\", \"${summary}\",\n     [](cotwin::Settings& s) -> std::unique_ptr<cotwin::Unit> { return std::make_unique<${class}>(s); },\n     &${class}::declare_settings")
  set(${out} "${row}" PARENT_SCOPE)
endfunction()

# cotwin_unit_source(template file unit): writes the file from the template, with the unit's name, header and row.
function(cotwin_unit_source template file unit)
  get_property(header GLOBAL PROPERTY COTWIN_UNIT_${unit}_HEADER)
  cotwin_unit_row(row ${unit})
  configure_file(${template} ${file} @ONLY)
endfunction()

# cotwin_fmu_library(unit [destination]): the shared library by which the unit of that name (cotwin_unit) is exported, for FMI 2 and FMI 3 at
# once: ${COTWIN_FMU_FOLDER}/<platform>/<unit>.so, installed as <destination>/<platform>/<unit>.so (default: lib/cotwin/fmu).
function(cotwin_fmu_library unit)
  set(destination lib/cotwin/fmu ${ARGN})
  list(GET destination -1 destination)
  cotwin_unit_source(${COTWIN_FMU_EXPORT}/exported_unit.cpp.in ${CMAKE_BINARY_DIR}/generated/exported_${unit}.cpp ${unit})
  set(target cotwin_fmu_${unit})
  add_library(${target} MODULE ${CMAKE_BINARY_DIR}/generated/exported_${unit}.cpp $<TARGET_OBJECTS:cotwin::fmu_export>)
  target_link_libraries(${target} PRIVATE cotwin::settings cotwin::fmu cotwin::${unit})
  cotwin_fmu_link(${target})
  set_target_properties(${target} PROPERTIES OUTPUT_NAME ${unit} LIBRARY_OUTPUT_DIRECTORY ${COTWIN_FMU_FOLDER}/${COTWIN_FMU_PLATFORM}
    CXX_VISIBILITY_PRESET hidden)
  install(TARGETS ${target} LIBRARY DESTINATION ${destination}/${COTWIN_FMU_PLATFORM})
endfunction()

# Licences of the code inside the libraries: pack_unit puts them into documentation/licenses/ of each FMU.
function(cotwin_fmu_licenses)
  set(folder ${COTWIN_FMU_FOLDER}/${COTWIN_FMU_PLATFORM}/licenses)
  configure_file(${PROJECT_SOURCE_DIR}/LICENSE ${folder}/license.txt COPYONLY)
  if(CMAKE_CROSSCOMPILING)
    set(runtime ${COTWIN_RUNTIME_PACKAGES})
  else()   # the library is in a folder with the version of GCC as its name, also for clang
    execute_process(COMMAND ${CMAKE_CXX_COMPILER} -print-file-name=libstdc++.a OUTPUT_VARIABLE library OUTPUT_STRIP_TRAILING_WHITESPACE)
    cmake_path(GET library PARENT_PATH version)
    cmake_path(GET version FILENAME version)
    set(runtime libstdc++-${version}-dev)
  endif()
  foreach(package IN ITEMS libsundials-dev libeigen3-dev ${runtime})
    foreach(root IN ITEMS ${CMAKE_FIND_ROOT_PATH} /usr)
      if(EXISTS ${root}/share/doc/${package}/copyright)
        configure_file(${root}/share/doc/${package}/copyright ${folder}/${package}.txt COPYONLY)
        break()
      endif()
    endforeach()
  endforeach()
  install(DIRECTORY ${folder} DESTINATION lib/cotwin/fmu/${COTWIN_FMU_PLATFORM})
endfunction()

# For a unit that cannot be built for this platform (cotwin_left_out), <unit>.txt has the reason instead of its library. pack_unit repeats it.
function(cotwin_fmu_left_out)
  get_property(units GLOBAL PROPERTY COTWIN_UNITS)
  foreach(unit IN LISTS units)
    file(REMOVE ${COTWIN_FMU_FOLDER}/${COTWIN_FMU_PLATFORM}/${unit}.txt)
  endforeach()
  get_property(left_out GLOBAL PROPERTY COTWIN_UNITS_LEFT_OUT)
  foreach(unit IN LISTS left_out)
    get_property(why GLOBAL PROPERTY COTWIN_LEFT_OUT_cotwin::${unit})
    file(REMOVE ${COTWIN_FMU_FOLDER}/${COTWIN_FMU_PLATFORM}/${unit}${CMAKE_SHARED_MODULE_SUFFIX})
    file(WRITE ${COTWIN_FMU_FOLDER}/${COTWIN_FMU_PLATFORM}/${unit}.txt "the unit ${unit} was not built: ${why} is missing for this platform")
  endforeach()
  get_property(of_host GLOBAL PROPERTY COTWIN_UNITS_OF_HOST)
  foreach(unit IN LISTS of_host)
    file(WRITE ${COTWIN_FMU_FOLDER}/${COTWIN_FMU_PLATFORM}/${unit}.txt "the unit ${unit} cannot be part of an FMU: it serves other programs with threads and sockets of its own")
  endforeach()
endfunction()
