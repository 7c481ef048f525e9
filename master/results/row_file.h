#pragma once
#include <sys/types.h>

#include <array>
#include <chrono>
#include <cstddef>
#include <filesystem>
#include <string_view>

#include "master/run/crash.h"

namespace cotwin::master {

/// Writes a text file row by row, through a buffer that is saved when the program crashes. The file is <file>.part until
/// close() renames it; a file that is not regular (a pipe) is written to directly. After a failed write it ends with a whole
/// row.
class RowFile {
 public:
  /// Throws Error if the file cannot be written, as do all functions here.
  explicit RowFile(std::filesystem::path file);
  ~RowFile();
  void write(std::string_view row);
  void close();

 private:
  void flush();
  [[noreturn]] void fail(int error) const;
  static void save(void* self) noexcept;

  std::filesystem::path file_, written_to_;
  int descriptor_ = -1;
  off_t size_ = 0, rows_end_ = 0;  // bytes in the file, and in whole rows
  std::size_t used_ = 0;
  std::chrono::steady_clock::time_point flush_due_{};
  std::array<char, 1 << 16> buffer_;
  SavedOnCrash saved_;
};

}  // namespace cotwin::master
