# Windows on x86-64 (x86_64-windows, in FMI 2 win64), with Debian's mingw-w64 and its POSIX threads: std::thread and std::atomic::wait need them.
set(CMAKE_SYSTEM_NAME Windows)
set(CMAKE_SYSTEM_PROCESSOR x86_64)
set(CMAKE_C_COMPILER x86_64-w64-mingw32-gcc-posix)
set(CMAKE_CXX_COMPILER x86_64-w64-mingw32-g++-posix)
set(CMAKE_RC_COMPILER x86_64-w64-mingw32-windres)
# Windows aligns the stack to 16 bytes only; GCC sometimes assumes more for vector registers (GCC bug 54412).
set(CMAKE_CXX_FLAGS_INIT "-Wa,-muse-unaligned-vector-move -D_USE_MATH_DEFINES")   # the latter declares M_PI
set(COTWIN_RUNTIME_PACKAGES g++-mingw-w64-x86-64-posix mingw-w64-x86-64-dev)   # their code becomes part of the libraries
include(${CMAKE_CURRENT_LIST_DIR}/common.cmake)
