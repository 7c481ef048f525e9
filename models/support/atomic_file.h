#pragma once
#include <array>
#include <filesystem>
#include <ostream>
#include <streambuf>
#include <string>
#include <string_view>

namespace cotwin {

/// Why a system call failed, in the system's words: "Read-only file system".
std::string system_reason(int error_number);

/// Creates the folder and those above it. Throws Error with the system's reason.
void make_folder(const std::filesystem::path& folder);

/// A file that appears under its name when it is complete. It is written beside its place, as <name>.part<process>; commit()
/// brings it to the disk and renames it, and an earlier file of that name stays until then. Without commit() nothing remains. A
/// link to a file is followed; a place that is no regular file, as a device or a pipe, is written to directly. Throws Error
/// with the system's reason.
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
    int failure = 0;  // errno of the first write that failed

   protected:
    int_type overflow(int_type c) override;
    int sync() override;

   private:
    std::array<char, 1 << 16> bytes_;
  };

  [[noreturn]] void fail(int error_number) const;

  std::filesystem::path place_, target_, beside_;  // as given; links followed; empty where it is written to directly
  Buffer buffer_;
  std::ostream out_;
  bool done_ = false;
};

/// A whole file by AtomicFile.
void write_file(const std::filesystem::path& place, std::string_view content);

/// Makes earlier renames and removals in the folder durable; a file system that cannot do that is left alone.
void sync_folder(const std::filesystem::path& folder);

}  // namespace cotwin
