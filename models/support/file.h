#pragma once
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

/// Reading of files: regular files alone, opened without waiting. A FIFO or a device may never answer, or never end.
namespace cotwin::text {

struct CloseFile {
  void operator()(std::FILE* file) const { static_cast<void>(std::fclose(file)); }
};
using File = std::unique_ptr<std::FILE, CloseFile>;

/// The most bytes of a file that is held in memory as a whole, where its reader sets no other limit.
inline constexpr std::uint64_t kMostBytes = std::uint64_t{256} << 20;

/// Opens a file to read bytes. Throws Error `file: cannot be read: reason, expected …` for one that is missing or must not be
/// read, and for a folder, FIFO, device or socket. The kind is that of the opened file, so that nobody can exchange it in
/// between.
File open_file(const std::filesystem::path& file, const std::string& expected);

/// All bytes of a file. Throws Error as open_file, and for a file of more than `most` bytes before any of them is read.
std::string read_file(const std::filesystem::path& file, const std::string& expected, std::uint64_t most = kMostBytes);

}  // namespace cotwin::text
