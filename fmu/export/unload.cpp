// Clean-up when the library of an exported unit is unloaded.

namespace __gnu_cxx {
void __freeres();  // libstdc++: frees its emergency memory for exceptions
}

namespace {

// The C++ run-time library is linked statically into the unit (fmu.cmake) and does not support unloading. Without this call,
// every load of an FMU would leak 72 KiB.
__attribute__((destructor(101))) void free_run_time_memory() { __gnu_cxx::__freeres(); }

}  // namespace
