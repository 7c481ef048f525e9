# COTWIN_FMU_PLATFORM: this platform in the words of FMI 3; COTWIN_FMU_FOLDER: where pack_unit looks for the libraries of units.
string(TOLOWER ${CMAKE_SYSTEM_PROCESSOR}-${CMAKE_SYSTEM_NAME} COTWIN_FMU_PLATFORM)
set(COTWIN_FMU_FOLDER ${CMAKE_BINARY_DIR}/lib/cotwin/fmu CACHE PATH "where the libraries of FMUs go: <folder>/<platform>/<unit>.so")
set(COTWIN_FMU_SYMBOLS ${CMAKE_CURRENT_LIST_DIR}/exported_symbols.map)

# cotwin_fmu_link(target): makes a module of what an exported unit's library is. It shows nothing but fmi2* and fmi3*, needs nothing but the
# C library (Windows: what comes with Windows), and carries the C++ runtime inside.
function(cotwin_fmu_link target)
  if(WIN32)   # what is shown is what fmi2.h and fmi3.h declare as dllexport
    set_target_properties(${target} PROPERTIES PREFIX "")
    target_sources(${target} PRIVATE $<TARGET_OBJECTS:cotwin_fmu_unload>)
    target_link_options(${target} PRIVATE -static -s LINKER:--gc-sections LINKER:--no-insert-timestamp)
    return()
  endif()
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
  set(folder ${COTWIN_FMU_FOLDER}/${COTWIN_FMU_PLATFORM}/licenses)
  configure_file(${PROJECT_SOURCE_DIR}/LICENSE ${folder}/license.txt COPYONLY)
  string(REGEX MATCH "^[0-9]+" major ${CMAKE_CXX_COMPILER_VERSION})
  set(runtime libstdc++-${major}-dev)
  if(CMAKE_CROSSCOMPILING)
    set(runtime ${COTWIN_RUNTIME_PACKAGES})
  endif()
  foreach(package IN ITEMS libsundials-dev libeigen3-dev libbullet-dev ${runtime})
    foreach(root IN ITEMS ${CMAKE_FIND_ROOT_PATH} /usr)
      if(EXISTS ${root}/share/doc/${package}/copyright)
        configure_file(${root}/share/doc/${package}/copyright ${folder}/${package}.txt COPYONLY)
        break()
      endif()
    endforeach()
  endforeach()
  install(DIRECTORY ${folder} DESTINATION lib/cotwin/fmu/${COTWIN_FMU_PLATFORM})
endfunction()

# Units that cannot be built for this platform (cotwin_left_out): instead of its library, <unit>.txt says why. pack_unit repeats it.
function(cotwin_fmu_left_out)
  get_property(units GLOBAL PROPERTY COTWIN_UNITS)
  foreach(unit IN LISTS units)
    file(REMOVE ${COTWIN_FMU_FOLDER}/${COTWIN_FMU_PLATFORM}/${unit}.txt)
  endforeach()
  get_property(left_out GLOBAL PROPERTY COTWIN_UNITS_LEFT_OUT)
  foreach(unit IN LISTS left_out)
    get_property(why GLOBAL PROPERTY COTWIN_LEFT_OUT_cotwin::${unit})
    file(REMOVE ${COTWIN_FMU_FOLDER}/${COTWIN_FMU_PLATFORM}/${unit}${CMAKE_SHARED_MODULE_SUFFIX})
    file(WRITE ${COTWIN_FMU_FOLDER}/${COTWIN_FMU_PLATFORM}/${unit}.txt "the unit ${unit} is left out: ${why} is not there for this platform")
  endforeach()
endfunction()
