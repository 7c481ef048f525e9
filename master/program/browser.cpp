#include "master/program/browser.h"

#include <spawn.h>
#include <unistd.h>

#include <cstdlib>
#include <iostream>

namespace cotwin::master {

void open_in_browser(const std::string& target) {
  const bool has_display = std::getenv("DISPLAY") != nullptr || std::getenv("WAYLAND_DISPLAY") != nullptr;
  if (!isatty(STDOUT_FILENO) || !has_display) return;
  std::string program = "xdg-open", shown = target;
  char* arguments[] = {program.data(), shown.data(), nullptr};
  pid_t process = 0;
  if (::posix_spawnp(&process, program.c_str(), nullptr, nullptr, arguments, environ) != 0)
    std::cerr << "cotwin: warning: xdg-open cannot be started; open " << target << " yourself\n";
}

}  // namespace cotwin::master
