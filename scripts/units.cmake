# For projects outside of Cotwin's source tree, after find_package(cotwin): the same two lines as inside of it.
#
#   cotwin_library(SOURCES spring.cpp PRIVATE cotwin::robot)
#   cotwin_unit(CLASS Spring SUMMARY "a linear spring")
#
# make, in the folder spring/ with spring.h, a module ${COTWIN_UNITS_FOLDER}/spring.so for `cotwin run --units` and, beside it, the library
# fmu/<platform>/spring.so for `cotwin pack`. Default of COTWIN_UNITS_FOLDER: <build folder>/units.
set(COTWIN_UNITS_FOLDER ${CMAKE_BINARY_DIR}/units CACHE PATH "folder for the modules of units, <unit>.so, and their FMU libraries")
set(COTWIN_FMU_FOLDER ${COTWIN_UNITS_FOLDER}/fmu)
set(COTWIN_UNIT_MODULE ${CMAKE_CURRENT_LIST_DIR}/unit_module.cpp.in)
include(${CMAKE_CURRENT_LIST_DIR}/fmu.cmake)

# cotwin_library(SOURCES a.cpp … [PUBLIC targets…] [PRIVATE targets…]): the static library of the current folder, cotwin_<folder> with the
# alias cotwin::<folder>. It links cotwin::unit.
function(cotwin_library)
  cmake_parse_arguments(arg "" "" "SOURCES;PUBLIC;PRIVATE" ${ARGN})
  if(COTWIN_MISSING)
    message(FATAL_ERROR "cotwin_library: units need packages that were not found: ${COTWIN_MISSING}")
  endif()
  cmake_path(GET CMAKE_CURRENT_SOURCE_DIR FILENAME name)
  add_library(cotwin_${name} STATIC ${arg_SOURCES})
  add_library(cotwin::${name} ALIAS cotwin_${name})
  target_link_libraries(cotwin_${name} PUBLIC cotwin::unit ${arg_PUBLIC} PRIVATE ${arg_PRIVATE})
  set_target_properties(cotwin_${name} PROPERTIES POSITION_INDEPENDENT_CODE ON CXX_VISIBILITY_PRESET hidden)
endfunction()

# cotwin_unit(CLASS Spring SUMMARY "…"): the current folder's library holds a unit. Its name is the folder's, its header is <folder>.h, its
# class is cotwin::<folder>::<CLASS>, or CLASS where that has a namespace of its own ("plant::Spring").
function(cotwin_unit)
  cmake_parse_arguments(arg "" "CLASS;SUMMARY" "" ${ARGN})
  cmake_path(GET CMAKE_CURRENT_SOURCE_DIR FILENAME unit)
  set(class ${arg_CLASS})
  if(NOT class MATCHES "::")
    set(class cotwin::${unit}::${class})
  endif()
  set_property(GLOBAL PROPERTY COTWIN_UNIT_${unit}_HEADER ${CMAKE_CURRENT_SOURCE_DIR}/${unit}.h)
  set_property(GLOBAL PROPERTY COTWIN_UNIT_${unit}_CLASS ${class})
  set_property(GLOBAL PROPERTY COTWIN_UNIT_${unit}_SUMMARY ${arg_SUMMARY})

  if(cotwin_old_glibc AND NOT TARGET cotwin_fmu_old_glibc)
    cotwin_old_glibc()
  endif()
  cotwin_fmu_library(${unit} lib/cotwin/units/fmu)
  cotwin_unit_source(${COTWIN_UNIT_MODULE} ${CMAKE_BINARY_DIR}/generated/module_${unit}.cpp ${unit})
  add_library(cotwin_module_${unit} MODULE ${CMAKE_BINARY_DIR}/generated/module_${unit}.cpp)
  target_link_libraries(cotwin_module_${unit} PRIVATE cotwin::${unit} cotwin::robot)
  set_target_properties(cotwin_module_${unit} PROPERTIES PREFIX "" OUTPUT_NAME ${unit} LIBRARY_OUTPUT_DIRECTORY ${COTWIN_UNITS_FOLDER}
    CXX_VISIBILITY_PRESET hidden)
  target_link_options(cotwin_module_${unit} PRIVATE LINKER:--exclude-libs,ALL LINKER:--as-needed LINKER:--no-undefined)
  add_dependencies(cotwin_module_${unit} cotwin_fmu_${unit})
  install(TARGETS cotwin_module_${unit} LIBRARY DESTINATION lib/cotwin/units)

  # The licences of what the library contains travel in each FMU.
  set(licenses ${COTWIN_FMU_FOLDER}/${COTWIN_FMU_PLATFORM}/licenses)
  file(COPY ${COTWIN_LICENSES}/${COTWIN_FMU_PLATFORM}/licenses DESTINATION ${COTWIN_FMU_FOLDER}/${COTWIN_FMU_PLATFORM})
  install(DIRECTORY ${licenses} DESTINATION lib/cotwin/units/fmu/${COTWIN_FMU_PLATFORM})
endfunction()
