#pragma once
#include <filesystem>

namespace cotwin {

/// The folder that this code is installed in: the parent of the folder (bin, lib) that has the shared library with this
/// function in it or, where there is none, the running program. Links are resolved. The build tree has the same layout below
/// it. Empty if the system does not say where the program is.
std::filesystem::path installation();

}  // namespace cotwin
