#include "models/foundation/support/file.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <system_error>

#include "models/foundation/support/error.h"

#ifdef _WIN32
#include <io.h>
#else
#include <unistd.h>
#endif

namespace cotwin::text {

namespace {

[[noreturn]] void fail(const std::filesystem::path& file, const std::string& reason, const std::string& expected) {
  throw Error(file.string(), "cannot be read: " + reason + ", expected " + expected);
}

[[noreturn]] void fail_with_errno(const std::filesystem::path& file, const std::string& expected) {
  fail(file, std::generic_category().message(errno), expected);
}

#ifdef _WIN32

int open_descriptor(const std::filesystem::path& file) { return _wopen(file.c_str(), _O_RDONLY | _O_BINARY | _O_NOINHERIT); }
std::FILE* stream_of(int descriptor) { return _fdopen(descriptor, "rb"); }
void close_descriptor(int descriptor) { _close(descriptor); }
using Status = struct _stat64;
int status_of(int descriptor, Status& status) { return _fstat64(descriptor, &status); }
const char* kind_of(const Status& status) {
  if ((status.st_mode & _S_IFMT) == _S_IFREG) return nullptr;
  return (status.st_mode & _S_IFMT) == _S_IFDIR ? "is a folder" : "is a pipe or a device";
}

#else

// O_NONBLOCK avoids waiting for the writer of a FIFO; it has no effect on regular files.
int open_descriptor(const std::filesystem::path& file) {
  return ::open(file.c_str(), O_RDONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
}
std::FILE* stream_of(int descriptor) { return ::fdopen(descriptor, "rb"); }
void close_descriptor(int descriptor) { ::close(descriptor); }
using Status = struct stat;
int status_of(int descriptor, Status& status) { return ::fstat(descriptor, &status); }
const char* kind_of(const Status& status) {
  if (S_ISREG(status.st_mode)) return nullptr;
  if (S_ISDIR(status.st_mode)) return "is a folder";
  return S_ISFIFO(status.st_mode) ? "is a FIFO" : S_ISSOCK(status.st_mode) ? "is a socket" : "is a device";
}

#endif

File open_regular(const std::filesystem::path& file, const std::string& expected, std::uint64_t& size) {
  const int descriptor = open_descriptor(file);
  if (descriptor < 0) {
    if (errno == ENXIO) fail(file, "is a socket or a device", expected);
    fail_with_errno(file, expected);
  }
  Status status{};
  const bool known = status_of(descriptor, status) == 0;
  const char* const kind = known ? kind_of(status) : nullptr;
  if (!known || kind != nullptr) {
    close_descriptor(descriptor);
    if (!known) fail_with_errno(file, expected);
    fail(file, kind, expected);
  }
  size = static_cast<std::uint64_t>(status.st_size);
  std::FILE* const stream = stream_of(descriptor);
  if (stream == nullptr) {
    close_descriptor(descriptor);
    fail_with_errno(file, expected);
  }
  return File(stream);
}

}  // namespace

File open_file(const std::filesystem::path& file, const std::string& expected) {
  std::uint64_t size = 0;
  return open_regular(file, expected, size);
}

std::string read_file(const std::filesystem::path& file, const std::string& expected, std::uint64_t most) {
  const auto too_large = [&](std::uint64_t size) {
    throw Error(file.string(), std::to_string(size) + " bytes, expected " + expected + " of at most " + std::to_string(most));
  };
  std::uint64_t size = 0;
  const File in = open_regular(file, expected, size);
  if (size > most) too_large(size);
  // One additional byte detects the end; files of /proc have a size of 0, and others may grow meanwhile.
  std::string bytes;
  for (std::size_t got = 0;;) {
    bytes.resize(got + std::max<std::size_t>(got == 0 ? static_cast<std::size_t>(size) + 1 : 0, 65536));
    const std::size_t wanted = bytes.size() - got;
    const std::size_t n = std::fread(bytes.data() + got, 1, wanted, in.get());
    got += n;
    if (got > most) too_large(got);
    if (n == wanted) continue;
    if (std::ferror(in.get()) != 0) fail_with_errno(file, expected);
    bytes.resize(got);
    return bytes;
  }
}

}  // namespace cotwin::text
