#include "master/results/row_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <system_error>

#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"

namespace cotwin::master {

namespace {

std::filesystem::path part_of(const std::filesystem::path& file) {
  struct stat status {};
  const bool regular = ::stat(file.c_str(), &status) != 0 || S_ISREG(status.st_mode);
  return regular ? std::filesystem::path(file.string() + ".part") : file;
}

constexpr auto kFlush = std::chrono::milliseconds(200);  // largest age of a row in memory while rows are written

}  // namespace

RowFile::RowFile(std::filesystem::path file)
    : file_(std::move(file)),
      written_to_(part_of(file_)),
      descriptor_(::open(written_to_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666)),
      saved_(save, this, file_.string()) {
  if (descriptor_ < 0) fail(errno);
}

RowFile::~RowFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

void RowFile::write(std::string_view row) {
  while (row.size() > buffer_.size() - used_) {
    const std::size_t part = buffer_.size() - used_;
    std::memcpy(buffer_.data() + used_, row.data(), part);
    used_ += part;
    row.remove_prefix(part);
    flush();
  }
  std::memcpy(buffer_.data() + used_, row.data(), row.size());
  used_ += row.size();
  const auto now = std::chrono::steady_clock::now();
  if (now < flush_due_) return;
  flush();  // the heading at once
  flush_due_ = now + kFlush;
}

void RowFile::flush() {
  for (std::size_t done = 0; done < used_;) {
    const ssize_t n = ::write(descriptor_, buffer_.data() + done, used_ - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      const int error = n < 0 ? errno : EIO;
      used_ = 0;
      if (size_ > rows_end_ && ::ftruncate(descriptor_, rows_end_) == 0) size_ = rows_end_;
      fail(error);
    }
    const std::string_view written(buffer_.data() + done, static_cast<std::size_t>(n));
    const std::size_t row_end = written.rfind('\n');
    if (row_end != std::string_view::npos) rows_end_ = size_ + static_cast<off_t>(row_end) + 1;
    size_ += n;
    done += written.size();
  }
  used_ = 0;
}

void RowFile::close() {
  if (descriptor_ < 0) return;
  flush();
  const int descriptor = descriptor_;
  descriptor_ = -1;
  if (::close(descriptor) != 0) fail(errno);
  if (written_to_ != file_ && ::rename(written_to_.c_str(), file_.c_str()) != 0) fail(errno);
}

void RowFile::fail(int error) const { fail_to_write(file_.string(), error); }

void RowFile::save(void* self) noexcept {
  RowFile& file = *static_cast<RowFile*>(self);
  for (std::size_t done = 0; done < file.used_;) {
    const ssize_t n = ::write(file.descriptor_, file.buffer_.data() + done, file.used_ - done);
    if (n <= 0) break;
    done += static_cast<std::size_t>(n);
  }
  if (file.written_to_ != file.file_) static_cast<void>(std::rename(file.written_to_.c_str(), file.file_.c_str()));
}

}  // namespace cotwin::master
