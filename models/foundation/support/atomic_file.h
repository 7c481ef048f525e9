#pragma once
#include <array>
#include <filesystem>
#include <ostream>
#include <streambuf>
#include <string>
#include <string_view>

#include "models/foundation/support/error.h"

namespace cotwin {

/// The system's message for a failed call: "Read-only file system".
std::string system_reason(int error_number);

/// A file or a stream that is not written to its end: the disk is full, a limit is reached, the device fails.
class CutOutput : public Error {
 public:
  using Error::Error;
};

/// Throws "place: cannot be written: reason": a CutOutput for such a reason, else an Error.
[[noreturn]] void fail_to_write(const std::string& place, int error_number);

/// Creates the folder and its parents. Throws Error with the system's message.
void make_folder(const std::filesystem::path& folder);

/// A file that appears under its name only when it is complete. It is written beside its final path as <name>.part<process>;
/// commit() flushes it to the disk and renames it over an earlier file of that name. Without commit() it is removed. A link to
/// a file is followed; a path that is not a regular file, such as a device or a pipe, is written directly. Throws Error with
/// the system's message.
class AtomicFile {
 public:
  explicit AtomicFile(std::filesystem::path place);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;
  std::ostream& stream() { return out_; }
  void commit();

 private:
  class Buffer final : public std::streambuf {
   public:
    Buffer();
    int descriptor = -1;
    int failure = 0;  // errno of the first failed write

   protected:
    int_type overflow(int_type c) override;
    int sync() override;

   private:
    std::array<char, 1 << 16> bytes_;
  };

  [[noreturn]] void fail(int error_number) const;

  std::filesystem::path place_, target_, beside_;  // as given; links followed; temporary file, empty if written directly
  Buffer buffer_;
  std::ostream out_;
  bool done_ = false;
};

/// Writes a whole file by AtomicFile.
void write_file(const std::filesystem::path& place, std::string_view content);

/// Makes earlier renames and removals in the folder durable, if the file system supports it.
void sync_folder(const std::filesystem::path& folder);

}  // namespace cotwin
