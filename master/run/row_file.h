#pragma once
#include <sys/types.h>

#include <array>
#include <cstddef>
#include <filesystem>
#include <string_view>

#include "master/run/crash.h"

namespace cotwin::master {

/// A text file that is written row by row, through a buffer that is saved when the program crashes. It is <file>.part until
/// close(), which renames it; a file that is no regular one (a pipe) is written to directly. After a write that failed it
/// ends with a whole row.
class RowFile {
 public:
  /// Throws Error if the file cannot be written, as all of these do.
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
  off_t size_ = 0, rows_end_ = 0;  // bytes in the file, and those of whole rows
  std::size_t used_ = 0;
  std::array<char, 1 << 16> buffer_;
  SavedOnCrash saved_;
};

}  // namespace cotwin::master
