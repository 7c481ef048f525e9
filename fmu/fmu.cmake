# COTWIN_FMU_PLATFORM: this platform in the words of FMI 3; COTWIN_FMU_FOLDER: where pack_unit looks for the libraries of units.
string(TOLOWER ${CMAKE_SYSTEM_PROCESSOR}-${CMAKE_SYSTEM_NAME} COTWIN_FMU_PLATFORM)
set(COTWIN_FMU_FOLDER ${CMAKE_BINARY_DIR}/lib/cotwin/fmu)
set(COTWIN_FMU_SYMBOLS ${CMAKE_CURRENT_LIST_DIR}/exported_symbols.map)

# cotwin_fmu_link(target): makes a module of what an exported unit's library is. It shows nothing but fmi2* and fmi3*, needs nothing but the
# C library, and carries the C++ runtime inside.
function(cotwin_fmu_link target)
  set_target_properties(${target} PROPERTIES PREFIX "" NO_SONAME ON LINK_DEPENDS ${COTWIN_FMU_SYMBOLS})
  target_link_options(${target} PRIVATE LINKER:--version-script=${COTWIN_FMU_SYMBOLS} LINKER:--exclude-libs,ALL
    LINKER:--as-needed LINKER:--gc-sections LINKER:-Bsymbolic LINKER:-z,relro)
  if(NOT COTWIN_SANITIZE)   # a sanitizer's run-time library comes with the program that loads this one
    target_sources(${target} PRIVATE $<TARGET_OBJECTS:cotwin_fmu_unload>)
    target_link_options(${target} PRIVATE -static-libstdc++ -static-libgcc LINKER:--no-undefined $<$<CONFIG:Release>:-s>)
  endif()
endfunction()

# cotwin_fmu_library(unit): the shared library by which the unit of that name (cotwin_unit) is exported, for FMI 2 and FMI 3 at once:
# ${COTWIN_FMU_FOLDER}/<platform>/<unit>.so.
function(cotwin_fmu_library unit)
  get_property(class GLOBAL PROPERTY COTWIN_UNIT_${unit}_CLASS)
  get_property(summary GLOBAL PROPERTY COTWIN_UNIT_${unit}_SUMMARY)
  configure_file(${PROJECT_SOURCE_DIR}/fmu/exported_unit.cpp.in ${CMAKE_BINARY_DIR}/generated/exported_${unit}.cpp @ONLY)
  set(target cotwin_fmu_${unit})
  add_library(${target} MODULE ${CMAKE_BINARY_DIR}/generated/exported_${unit}.cpp $<TARGET_OBJECTS:cotwin_fmu_export>)
  target_link_libraries(${target} PRIVATE cotwin_settings cotwin::fmu cotwin::${unit})
  cotwin_fmu_link(${target})
  set_target_properties(${target} PROPERTIES OUTPUT_NAME ${unit} LIBRARY_OUTPUT_DIRECTORY ${COTWIN_FMU_FOLDER}/${COTWIN_FMU_PLATFORM})
  install(TARGETS ${target} LIBRARY DESTINATION lib/cotwin/fmu/${COTWIN_FMU_PLATFORM})
endfunction()

# What the licenses of the libraries inside ask to go along with them: pack_unit puts all of them into documentation/licenses/.
function(cotwin_fmu_licenses)
  configure_file(${PROJECT_SOURCE_DIR}/LICENSE ${COTWIN_FMU_FOLDER}/licenses/license.txt COPYONLY)
  string(REGEX MATCH "^[0-9]+" major ${CMAKE_CXX_COMPILER_VERSION})
  foreach(package IN ITEMS libsundials-dev libeigen3-dev libstdc++-${major}-dev)
    if(EXISTS /usr/share/doc/${package}/copyright)
      configure_file(/usr/share/doc/${package}/copyright ${COTWIN_FMU_FOLDER}/licenses/${package}.txt COPYONLY)
    endif()
  endforeach()
  install(DIRECTORY ${COTWIN_FMU_FOLDER}/licenses DESTINATION lib/cotwin/fmu)
endfunction()
