#include "components/gateway/http/channel.h"

#include <string_view>

#include "models/foundation/support/text.h"

namespace cotwin::gateway::http {

namespace {

/// Without line ends, which would begin another field.
std::string line(std::string_view text) {
  std::string out(text);
  for (char& c : out) {
    if (c == '\n' || c == '\r' || c == '\0') c = ' ';
  }
  return out;
}

std::string event_text(const Event& event) {
  std::string text;
  if (!event.name.empty()) text += "event: " + line(event.name) + "\n";
  if (!event.id.empty()) text += "id: " + line(event.id) + "\n";
  for (const std::string_view part : text::split(event.data, '\n')) text += "data: " + line(part) + "\n";
  return text + "\n";
}

/// Names and ids are of this program and need no more than these escapes.
std::string quoted_text(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  }
  return out + "\"";
}

std::string message_text(const Event& event) {
  std::string text = "{\"event\":" + quoted_text(event.name);
  if (!event.id.empty()) text += ",\"id\":" + quoted_text(event.id);
  return text + ",\"data\":" + (event.data.empty() ? "null" : event.data) + "}";
}

}  // namespace

bool Channel::send(const Event& event) { return push(kind_ == Kind::kEvents ? event_text(event) : message_text(event)); }

bool Channel::push(std::string text) {
  const std::lock_guard lock(mutex_);
  if (closing_ || aborted_ || ended_) return false;
  if (bytes_ + text.size() > limit_) {
    aborted_ = true;
    texts_.clear();
    bytes_ = taken_;
    ++dropped_;
    wake_();
    return false;
  }
  bytes_ += text.size();
  texts_.push_back(std::move(text));
  if (texts_.size() == 1) wake_();
  return true;
}

std::size_t Channel::waiting() const {
  const std::lock_guard lock(mutex_);
  return bytes_;
}

bool Channel::closed() const {
  const std::lock_guard lock(mutex_);
  return closing_ || aborted_ || ended_;
}

void Channel::close() {
  const std::lock_guard lock(mutex_);
  if (closing_ || ended_) return;
  closing_ = true;
  wake_();
}

void Channel::on_close(std::function<void()> function) {
  {
    const std::lock_guard lock(mutex_);
    if (!ended_) {
      at_close_.push_back(std::move(function));
      return;
    }
  }
  function();
}

bool Channel::take(std::string& text) {
  const std::lock_guard lock(mutex_);
  if (texts_.empty()) return false;
  text = std::move(texts_.front());
  texts_.pop_front();
  taken_ = text.size();
  return true;
}

void Channel::written() {
  const std::lock_guard lock(mutex_);
  bytes_ -= taken_;
  taken_ = 0;
}

Channel::Wish Channel::wish() const {
  const std::lock_guard lock(mutex_);
  if (aborted_ || ended_) return Wish::kAbort;
  return closing_ && texts_.empty() ? Wish::kCloseInOrder : Wish::kStay;
}

void Channel::end() {
  std::vector<std::function<void()>> functions;
  {
    const std::lock_guard lock(mutex_);
    if (ended_) return;
    ended_ = true;
    texts_.clear();
    bytes_ = taken_ = 0;
    functions.swap(at_close_);
    wake_ = [] {};
  }
  for (const auto& function : functions) function();
}

}  // namespace cotwin::gateway::http
