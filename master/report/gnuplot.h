#pragma once
#include <chrono>
#include <string>
#include <string_view>

/// The program gnuplot, which draws curves. It gets its script and data through its stdin.
namespace cotwin::report {

class Gnuplot {
 public:
  /// Looks for the program COTWIN_GNUPLOT of the environment, otherwise for `gnuplot` in PATH, and asks for its version.
  Gnuplot();

  /// "gnuplot 5.4 patchlevel 4"; empty if there is none that works.
  const std::string& version() const { return version_; }
  bool available() const { return !version_.empty(); }
  /// Why there is none: one sentence; empty if there is one.
  const std::string& lacking() const { return lacking_; }

  /// Runs a script and returns what it wrote to stdout. Throws Error with gnuplot's own message if it ends with an error, is not
  /// done after `limit`, or is not available.
  std::string run(std::string_view script, std::chrono::seconds limit = std::chrono::seconds(60)) const;

  /// `text` as a string in single quotes, in which gnuplot replaces nothing. Control characters become blanks, bytes that
  /// are not UTF-8 question marks, and apostrophes typographic ones, because gnuplot 5.4 ends a string at a doubled quote at its beginning.
  static std::string quoted(std::string_view text);

 private:
  std::string program_, version_, lacking_;
};

}  // namespace cotwin::report
