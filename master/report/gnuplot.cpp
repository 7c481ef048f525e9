#include "master/report/gnuplot.h"

#include <cerrno>
#include <cstdlib>
#include <utility>
#include <vector>

#include "models/foundation/formats/xml.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/process.h"
#include "models/foundation/support/text.h"

namespace cotwin::report {

namespace {

/// The line of gnuplot's stderr that names the error: the last one that is neither empty nor the marker under the script.
std::string message_of(const std::string& err) {
  std::string message;
  for (const std::string_view line : text::split(err, '\n')) {
    const std::string_view trimmed = text::trim(line);
    if (!trimmed.empty() && trimmed != "^") message = std::string(trimmed.substr(0, 300));
  }
  return message;
}

}  // namespace

Gnuplot::Gnuplot() {
  const char* given = std::getenv("COTWIN_GNUPLOT");
  program_ = given != nullptr && *given != '\0' ? given : "gnuplot";
  const Ended ended = run_process({program_, "--version"}, {}, std::chrono::seconds(20));
  const std::string first(text::trim(std::string_view(ended.out).substr(0, ended.out.find('\n'))));
  if (ended.well() && first.starts_with("gnuplot ")) {
    version_ = first.substr(0, 100);
  } else if (ended.error == ENOENT) {
    lacking_ = "the program '" + program_ + "' is not installed (Debian: gnuplot-nox)";
  } else {
    lacking_ = "the program '" + program_ + "' does not work" +
               (ended.error != 0 ? ": " + system_reason(ended.error) : std::string(", expected gnuplot"));
  }
}

std::string Gnuplot::run(std::string_view script, std::chrono::seconds limit) const {
  if (!available()) throw Error("gnuplot", lacking_);
  Ended ended = run_process({program_, "--default-settings", "-"}, script, limit);
  if (ended.error != 0) throw Error(program_, "cannot be started: " + system_reason(ended.error));
  if (ended.late) throw Error(program_, "was not done after " + std::to_string(limit.count()) + " s");
  if (!ended.well()) {
    const std::string message = message_of(ended.err);
    throw Error(program_, message.empty() ? "ended with an error and no message" : message);
  }
  return std::move(ended.out);
}

std::string Gnuplot::quoted(std::string_view text) {
  std::string plain;
  for (const char c : text) plain += static_cast<unsigned char>(c) < 0x20 || c == 0x7f ? ' ' : c;
  try {
    static_cast<void>(xml::escaped(plain));
  } catch (const Error&) {
    for (char& c : plain) {
      if (static_cast<unsigned char>(c) >= 0x80) c = '?';
    }
  }
  std::string out = "'";
  for (const char c : plain) {
    if (c == '\'')
      out += "’";
    else
      out += c;
  }
  return out + "'";
}

}  // namespace cotwin::report
