# Common to the tool chains of scripts/cross.sh: libraries come from COTWIN_THIRD_PARTY, never from this machine. Only libraries of headers,
# which are the same on all platforms, come from Debian's packages.
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES COTWIN_THIRD_PARTY)
set(CMAKE_FIND_ROOT_PATH ${COTWIN_THIRD_PARTY})
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)
set(ENV{PKG_CONFIG_LIBDIR} ${COTWIN_THIRD_PARTY}/lib/pkgconfig)
set(Eigen3_DIR /usr/share/eigen3/cmake)
