#include "models/foundation/support/atomic_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>
#include <utility>

#include "models/foundation/support/error.h"

namespace cotwin {

namespace fs = std::filesystem;

std::string system_reason(int error_number) { return std::generic_category().message(error_number); }

void make_folder(const fs::path& folder) {
  if (folder.empty()) return;
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw Error(folder.string(), "cannot be created: " + error.message());
}

void sync_folder(const fs::path& folder) {
  const int descriptor = ::open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return;
  ::fsync(descriptor);
  ::close(descriptor);
}

AtomicFile::Buffer::Buffer() { setp(bytes_.data(), bytes_.data() + bytes_.size()); }

AtomicFile::Buffer::int_type AtomicFile::Buffer::overflow(int_type c) {
  if (sync() != 0) return traits_type::eof();
  if (!traits_type::eq_int_type(c, traits_type::eof())) sputc(traits_type::to_char_type(c));
  return traits_type::not_eof(c);
}

int AtomicFile::Buffer::sync() {
  for (const char* from = pbase(); from != pptr() && failure == 0;) {
    const ssize_t n = ::write(descriptor, from, static_cast<std::size_t>(pptr() - from));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) failure = n < 0 ? errno : EIO;
    if (n > 0) from += n;
  }
  setp(bytes_.data(), bytes_.data() + bytes_.size());
  return failure == 0 ? 0 : -1;
}

AtomicFile::AtomicFile(fs::path place) : place_(std::move(place)), target_(place_), out_(&buffer_) {
  std::error_code ignored;
  if (fs::is_symlink(place_, ignored) && fs::exists(place_, ignored)) target_ = fs::canonical(place_, ignored);
  const bool directly = fs::exists(target_, ignored) && !fs::is_regular_file(target_, ignored);
  if (!directly) {
    beside_ = target_;
    beside_ += ".part" + std::to_string(::getpid());
  }
  const fs::path& opened = directly ? target_ : beside_;
  buffer_.descriptor = ::open(opened.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (buffer_.descriptor < 0) fail(errno);
}

AtomicFile::~AtomicFile() {
  if (done_) return;
  if (buffer_.descriptor >= 0) ::close(buffer_.descriptor);
  if (!beside_.empty()) ::unlink(beside_.c_str());
}

void AtomicFile::commit() {
  out_.flush();
  if (buffer_.failure != 0) fail(buffer_.failure);
  if (!beside_.empty() && ::fsync(buffer_.descriptor) != 0 && errno != EINVAL && errno != ENOTSUP) fail(errno);
  if (::close(std::exchange(buffer_.descriptor, -1)) != 0) fail(errno);
  if (!beside_.empty()) {
    if (::rename(beside_.c_str(), target_.c_str()) != 0) fail(errno);
    sync_folder(target_.parent_path());
  }
  done_ = true;
}

void AtomicFile::fail(int error_number) const { fail_to_write(place_.string(), error_number); }

void fail_to_write(const std::string& place, int error_number) {
  const std::string what = "cannot be written: " + system_reason(error_number);
  for (const int cut : {ENOSPC, EDQUOT, EFBIG, EIO}) {
    if (error_number == cut) throw CutOutput(place, what);
  }
  throw Error(place, what);
}

void write_file(const fs::path& place, std::string_view content) {
  AtomicFile file(place);
  file.stream().write(content.data(), static_cast<std::streamsize>(content.size()));
  file.commit();
}

}  // namespace cotwin
