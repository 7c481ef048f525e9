# Linux on 64-bit ARM (aarch64-linux), with Debian's cross compiler.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_C_COMPILER aarch64-linux-gnu-gcc)
set(CMAKE_CXX_COMPILER aarch64-linux-gnu-g++)
set(COTWIN_RUNTIME_PACKAGES libstdc++-12-dev-arm64-cross)   # its code becomes part of the libraries
include(${CMAKE_CURRENT_LIST_DIR}/common.cmake)
