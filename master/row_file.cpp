#include "master/row_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <system_error>

#include "models/text/error.h"

namespace cotwin::master {

RowFile::RowFile(std::filesystem::path file)
    : file_(std::move(file)),
      descriptor_(::open(file_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666)),
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
}

void RowFile::flush() {
  for (std::size_t done = 0; done < used_;) {
    const ssize_t n = ::write(descriptor_, buffer_.data() + done, used_ - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      used_ = 0;
      fail(n < 0 ? errno : EIO);
    }
    done += static_cast<std::size_t>(n);
  }
  used_ = 0;
}

void RowFile::close() {
  if (descriptor_ < 0) return;
  flush();
  const int descriptor = descriptor_;
  descriptor_ = -1;
  if (::close(descriptor) != 0) fail(errno);
}

void RowFile::fail(int error) const {
  throw Error(file_.string(), "cannot be written: " + std::generic_category().message(error));
}

void RowFile::save(void* self) noexcept {
  RowFile& file = *static_cast<RowFile*>(self);
  for (std::size_t done = 0; done < file.used_;) {
    const ssize_t n = ::write(file.descriptor_, file.buffer_.data() + done, file.used_ - done);
    if (n <= 0) return;
    done += static_cast<std::size_t>(n);
  }
}

}  // namespace cotwin::master
