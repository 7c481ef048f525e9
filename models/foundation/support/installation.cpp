#include "models/foundation/support/installation.h"

#include <dlfcn.h>
#include <link.h>

#include <system_error>

namespace cotwin {

namespace fs = std::filesystem;

fs::path installation() {
  Dl_info info{};
  link_map* object = nullptr;
  const auto here = reinterpret_cast<const void*>(&installation);
  const bool found = dladdr1(here, &info, reinterpret_cast<void**>(&object), RTLD_DL_LINKMAP) != 0 && object != nullptr;
  const bool in_program = !found || object->l_name == nullptr || *object->l_name == '\0';
  std::error_code error;
  const fs::path file = in_program ? fs::read_symlink("/proc/self/exe", error) : fs::canonical(object->l_name, error);
  return error ? fs::path() : file.parent_path().parent_path();
}

}  // namespace cotwin
