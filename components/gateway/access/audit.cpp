#include "components/gateway/access/audit.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <mutex>
#include <nlohmann/json.hpp>
#include <utility>

#include "components/gateway/access/utc.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"

namespace cotwin::gateway::access {

namespace {

using Json = nlohmann::ordered_json;

// All of this process: several gateways of one run write to one file.
std::mutex audits;
std::uint64_t last_number = 0;

std::string line_of(const Json& line) { return line.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n"; }

Json head_of(const Deed& deed) {
  Json line{{"time", to_text(utc_now())}};
  if (!deed.by.empty()) line["by"] = deed.by;
  if (!deed.address.empty()) line["address"] = deed.address;
  line["what"] = deed.what;
  if (!deed.body.empty()) line["body"] = deed.body.substr(0, Audit::kMostOfBody);
  if (deed.body.size() > Audit::kMostOfBody) line["body_bytes"] = deed.body.size();
  return line;
}

std::string words_of(const Deed& deed, int status, const std::string& why) {
  constexpr std::size_t kShown = 120;
  std::string words = deed.what + (deed.body.empty() ? "" : " " + deed.body.substr(0, kShown));
  if (deed.body.size() > kShown) words += "...";
  words += " by " + (deed.by.empty() ? std::string("unknown") : deed.by) + (deed.address.empty() ? "" : " at " + deed.address);
  return words + ": " + std::to_string(status) + (why.empty() ? "" : ", " + why);
}

}  // namespace

void log(const std::string& line) noexcept {
  static std::mutex logging;
  static std::uint64_t left_out = 0;
  try {
    const std::lock_guard lock(logging);
    // Whoever started the program may not read its stderr: a full pipe must not stop the gateway.
    pollfd out = {STDERR_FILENO, POLLOUT, 0};
    if (::poll(&out, 1, 0) != 1 || (out.revents & POLLOUT) == 0) {
      ++left_out;
      return;
    }
    std::string text = (::isatty(STDERR_FILENO) != 0 ? "\r\x1b[K" : "") + std::string("cotwin: gateway: ");
    if (left_out > 0) text += "(" + std::to_string(std::exchange(left_out, 0)) + " lines before this were left out) ";
    for (const char c : line.substr(0, 1000)) text += c == '\n' ? ' ' : c >= 0x20 && c < 0x7f ? c : '?';
    text += '\n';
    (void)!::write(STDERR_FILENO, text.data(), text.size());  // as a whole, between the lines of others
  } catch (const std::bad_alloc&) {
  }
}

Audit::~Audit() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

void Audit::open_file() {
  if (descriptor_ >= 0) ::close(descriptor_);
  // Without O_NOFOLLOW a link in the folder could lead the lines anywhere.
  descriptor_ = ::open(file_.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0600);
  struct stat status = {};
  if (descriptor_ < 0 || ::fstat(descriptor_, &status) != 0 || ::fchmod(descriptor_, 0600) != 0)
    throw Error(file_.string(), "cannot be appended to: " + system_reason(errno));
  if (!S_ISREG(status.st_mode)) throw Error(file_.string(), "is not a regular file");
}

/// Whether the open file is still the one of this name: another one may have begun a new file.
bool Audit::is_there() const {
  struct stat open = {}, named = {};
  return descriptor_ >= 0 && ::fstat(descriptor_, &open) == 0 && ::lstat(file_.c_str(), &named) == 0 &&
         open.st_dev == named.st_dev && open.st_ino == named.st_ino;
}

void Audit::open(const std::filesystem::path& folder) {
  const std::lock_guard lock(audits);
  const std::string waiting = std::exchange(waiting_, "");
  state_ = State::kNone;
  if (folder.empty()) return;
  make_folder(folder);
  file_ = folder / kFile;
  open_file();
  state_ = State::kOpen;
  if (!waiting.empty()) append(waiting);
}

void Audit::append(const std::string& line) {
  if (state_ == State::kNone) return;
  if (state_ == State::kWaiting) {
    if (waiting_.size() + line.size() > kMostWaiting)
      throw Error(kFile, "its folder is not known yet, and too much waits for it, expected it after the beginning of the run");
    waiting_ += line;
    return;
  }
  if (!is_there()) open_file();
  off_t size = ::lseek(descriptor_, 0, SEEK_END);
  if (size > 0 && static_cast<std::uint64_t>(size) + line.size() > kMost) {
    if (::rename(file_.c_str(), (file_.parent_path() / kEarlier).c_str()) != 0)
      throw Error(file_.string(), "cannot be renamed: " + system_reason(errno));
    open_file();
    size = 0;
  }
  const ssize_t written = ::write(descriptor_, line.data(), line.size());
  if (written == static_cast<ssize_t>(line.size())) return;
  const std::string reason = written < 0 ? system_reason(errno) : "there is no room for a whole line";
  if (written > 0) (void)!::ftruncate(descriptor_, size);  // half a line
  throw Error(file_.string(), "cannot be appended to: " + reason);
}

void Audit::on_done(std::function<void(const Deed&)> function) {
  const std::lock_guard lock(audits);
  done_ = std::move(function);
}

std::uint64_t Audit::begin(const Deed& deed) {
  Json line = head_of(deed);
  const std::lock_guard lock(audits);
  line["number"] = last_number + 1;
  append(line_of(line));
  return ++last_number;
}

void Audit::end(std::uint64_t number, const Deed& deed, int status, const std::string& why) noexcept {
  try {
    log(words_of(deed, status, why));
    Json line = head_of(deed);
    line["number"] = number;
    line["status"] = status;
    if (!why.empty()) line["why"] = why;
    const std::lock_guard lock(audits);
    if (done_ && status < 400) done_(deed);
    append(line_of(line));
  } catch (const std::exception& error) {
    log(error.what());
  }
}

void Audit::refused(const Deed& deed, int status, const std::string& why) noexcept {
  try {
    const std::lock_guard lock(audits);
    const Offences::Verdict verdict =
        refusals_.note(deed.by.empty() ? deed.address : deed.by, std::chrono::steady_clock::now());
    if (!verdict.told) return;
    log(words_of(deed, status, why));
    Json line = head_of(deed);
    line["status"] = status;
    if (!why.empty()) line["why"] = why;
    if (verdict.since_told > 0) line["others_refused"] = verdict.since_told;
    append(line_of(line));
  } catch (const std::exception& error) {
    log(error.what());
  }
}

}  // namespace cotwin::gateway::access
