#pragma once
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <system_error>

/// Files and folders of tests.
namespace cotwin::testing {

/// The bytes of a file; "" if it cannot be read.
inline std::string content(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// Of a file, bytes; 0 if there is none.
inline std::size_t size_of(const std::filesystem::path& file) {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(file, error);
  return error ? 0 : static_cast<std::size_t>(size);
}

/// A new folder; the destructor removes it.
class TemporaryFolder {
 public:
  explicit TemporaryFolder(const std::string& name)
      : path_(std::filesystem::temp_directory_path() / ("cotwin_" + name + "_" + std::to_string(std::random_device{}()))) {
    std::filesystem::create_directories(path_);
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
  const std::filesystem::path& path() const { return path_; }
  /// Writes a file, and the folders above it.
  std::filesystem::path write(const std::string& name, const std::string& text) const {
    std::filesystem::create_directories((path_ / name).parent_path());
    std::ofstream(path_ / name, std::ios::binary) << text;
    return path_ / name;
  }

 private:
  std::filesystem::path path_;
};

/// A new file with this text, in a folder of its own.
class TemporaryFile {
 public:
  explicit TemporaryFile(const std::string& text, const std::string& name = "file.csv")
      : folder_("file"), path_(folder_.write(name, text)) {}
  std::string path() const { return path_.string(); }

 private:
  TemporaryFolder folder_;
  std::filesystem::path path_;
};

/// A file that only its owner may use, as tokens and keys must be.
class SecretFile : public TemporaryFile {
 public:
  explicit SecretFile(const std::string& text) : TemporaryFile(text, "secret") {
    std::filesystem::permissions(path(), std::filesystem::perms(0600));
  }
};

/// Replaces a file by one with other content, as an administrator does: beside it, for the owner only, then renamed.
inline void rewrite_secret(const std::filesystem::path& file, const std::string& text) {
  const std::filesystem::path beside = file.string() + ".new";
  std::ofstream(beside, std::ios::binary) << text;
  std::filesystem::permissions(beside, std::filesystem::perms(0600));
  std::filesystem::rename(beside, file);
}

}  // namespace cotwin::testing
