#include "master/results/results_folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <utility>

#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"

namespace cotwin::master {

namespace fs = std::filesystem;

namespace {

/// Returns the owner that is written in the lock file, as one line of ASCII characters.
std::string owner_of(int descriptor) {
  std::array<char, 200> text;
  const ssize_t n = ::pread(descriptor, text.data(), text.size(), 0);
  std::string owner;
  for (ssize_t i = 0; i < n && text[static_cast<std::size_t>(i)] != '\n'; ++i) {
    const char c = text[static_cast<std::size_t>(i)];
    owner += c >= ' ' && c <= '~' ? c : '?';
  }
  return owner.empty() ? "another process" : owner;
}

std::string this_process() {
  std::array<char, 256> host{};
  if (::gethostname(host.data(), host.size() - 1) != 0) host[0] = '\0';
  return "process " + std::to_string(::getpid()) + " on " + (host[0] != '\0' ? host.data() : "this machine");
}

/// Returns whether the descriptor still belongs to the file with this name, which its last owner may have removed.
bool is_named(int descriptor, const fs::path& file) {
  struct stat opened {
  }, named{};
  return ::fstat(descriptor, &opened) == 0 && ::stat(file.c_str(), &named) == 0 && opened.st_ino == named.st_ino &&
         opened.st_dev == named.st_dev;
}

}  // namespace

FileLock::FileLock(fs::path file, const std::string& what) : file_(std::move(file)) {
  for (;;) {
    descriptor_ = ::open(file_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0666);
    if (descriptor_ < 0) throw Error(file_.string(), "cannot be written: " + system_reason(errno));
    if (::flock(descriptor_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
      const std::string owner = owner_of(descriptor_);
      ::close(std::exchange(descriptor_, -1));
      throw Error(what, owner + " is writing there; choose another folder or wait until it has ended");
    }
    if (is_named(descriptor_, file_)) break;
    ::close(descriptor_);
  }
  const std::string owner = this_process() + "\n";
  if (::ftruncate(descriptor_, 0) == 0) {
    // The text is only needed for the message above, so an error is ignored.
    [[maybe_unused]] const ssize_t written = ::pwrite(descriptor_, owner.data(), owner.size(), 0);
  }
}

FileLock::~FileLock() {
  if (descriptor_ < 0) return;
  ::unlink(file_.c_str());
  ::close(descriptor_);
}

FileLock::FileLock(FileLock&& other) noexcept
    : file_(std::move(other.file_)), descriptor_(std::exchange(other.descriptor_, -1)) {}

FileLock& FileLock::operator=(FileLock&& other) noexcept {
  std::swap(file_, other.file_);
  std::swap(descriptor_, other.descriptor_);
  return *this;
}

ResultsFolder::ResultsFolder(fs::path folder, const fs::path& shown) : folder_(std::move(folder)), shown_(shown.string()) {
  std::error_code none;
  const fs::path lock = folder_ / kLock;
  if (fs::exists(lock, none)) const FileLock probe(lock, shown_);
}

void ResultsFolder::open() {
  make_folder(folder_);
  lock_ = FileLock(folder_ / kLock, shown_);
}

fs::path ResultsFolder::keep_earlier(std::span<const std::string> names, std::span<const fs::path> inputs) const {
  fs::path kept;
  for (const std::string& name : names) {
    std::error_code error;
    const fs::path file = folder_ / name;
    const fs::file_status status = fs::symlink_status(file, error);
    if (!fs::is_regular_file(status)) continue;
    for (int n = 1; kept.empty(); ++n) {
      const fs::path candidate = folder_ / ("earlier-" + std::to_string(n));
      if (::mkdir(candidate.c_str(), 0777) == 0) {
        kept = candidate;
      } else if (errno != EEXIST) {
        throw Error(candidate.string(), "cannot be created: " + system_reason(errno));
      }
    }
    const bool is_input = std::any_of(inputs.begin(), inputs.end(), [&](const fs::path& input) {
      std::error_code none;
      return fs::equivalent(input, file, none);
    });
    if (is_input) {
      fs::copy_file(file, kept / name, error);
    } else {
      fs::rename(file, kept / name, error);
    }
    if (error) throw Error(file.string(), "cannot be moved to " + kept.string() + ": " + error.message());
  }
  return kept;
}

fs::path ResultsFolder::keep_earlier_run() const {
  const std::array<std::string, 9> names = {
      kSignals, std::string(kSignals) + ".part", kView, std::string(kView) + ".part", kRecord, kSummary, kCheckpoint, kHistory,
      kPage};
  return keep_earlier(names);
}

}  // namespace cotwin::master
