// What an exported unit gives back when its library is unloaded.

namespace __gnu_cxx {
void __freeres();  // libstdc++: frees the memory that it holds ready for exceptions thrown when there is none left
}

namespace {

// The C++ run-time library is linked into the unit (fmu.cmake) and knows no unloading: without this, every load of an FMU would
// cost 72 KiB for good.
__attribute__((destructor(101))) void give_back() { __gnu_cxx::__freeres(); }

}  // namespace
