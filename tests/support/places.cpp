#include "tests/support/places.h"

namespace cotwin::places {

std::string source() { return COTWIN_SOURCE_DIR; }
std::string shared() { return source() + "/../shared"; }
std::string program() { return COTWIN_BINARY_DIR "/bin/cotwin"; }
std::string linear_libraries() { return COTWIN_BINARY_DIR "/tests/linear"; }
std::string foreign_libraries() { return COTWIN_BINARY_DIR "/tests/fmu/foreign"; }

}  // namespace cotwin::places
