#pragma once
#include <string>

namespace cotwin::master {

/// Shows a file or a URL in the browser of a desktop, if a person is there: stdout is a terminal, and there is a display. The browser goes on
/// alone. Without xdg-open a warning is printed.
void open_in_browser(const std::string& target);

}  // namespace cotwin::master
