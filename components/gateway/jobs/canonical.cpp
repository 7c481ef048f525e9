#include "components/gateway/jobs/canonical.h"

#include <openssl/evp.h>

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "components/gateway/jobs/jobs.h"
#include "components/services/json/json.h"
#include "models/foundation/support/error.h"

namespace cotwin::gateway {

namespace {

using Json = nlohmann::json;  // objects are sorted by the bytes of their members' names

constexpr double kExactIntegers = 9007199254740992.0;  // 2^53: whole numbers up to here are exact in a double
constexpr std::size_t kMostName = 200;                 // bytes of a service or a robot
constexpr std::size_t kMostMessage = 64 << 10;         // bytes of a message or a problem of a worker

/// Whole numbers become integers: 2.0 and 2 are the same number. −0.0 stays.
void unify_numbers(Json& value) {
  if (value.is_structured()) {
    for (Json& item : value) unify_numbers(item);
  } else if (value.is_number_float()) {
    const double x = value.get<double>();
    if (x == std::trunc(x) && std::abs(x) <= kExactIntegers && !(x == 0 && std::signbit(x)))
      value = static_cast<std::int64_t>(x);
  }
}

Json parse_request(std::string_view text) {
  try {
    Json request = services::parse_object(text);
    unify_numbers(request);
    return request;
  } catch (const services::RequestError& error) {
    throw Error(error.pointer().empty() ? "/" : error.pointer(), error.detail());
  }
}

std::string name_of(const Json& request, const char* member, bool optional) {
  const auto at = request.find(member);
  const std::string place = std::string("/") + member;
  if (at == request.end()) {
    if (optional) return "";
    throw Error(place, "is missing, expected it in the request");
  }
  if (!at->is_string()) throw Error(place, std::string("is of type ") + at->type_name() + ", expected a string");
  const auto& name = at->get_ref<const std::string&>();
  if (name.empty() || name.size() > kMostName)
    throw Error(place, "has " + std::to_string(name.size()) + " bytes, expected 1 to " + std::to_string(kMostName));
  return name;
}

/// Walks over one JSON text that is known to be valid.
class Scanner {
 public:
  explicit Scanner(std::string_view text) : text_(text) {}

  void skip_blanks() {
    while (at_ < text_.size() && std::string_view(" \t\r\n").find(text_[at_]) != std::string_view::npos) ++at_;
  }
  bool take(char c) {
    skip_blanks();
    if (at_ >= text_.size() || text_[at_] != c) return false;
    ++at_;
    return true;
  }
  std::string_view value() {
    skip_blanks();
    const std::size_t begin = at_;
    int depth = 0;
    while (at_ < text_.size()) {
      const char c = text_[at_];
      if (c == '"') {
        skip_string();
        if (depth == 0) break;
        continue;
      }
      if (depth == 0 && at_ > begin && (c == ',' || c == '}' || c == ']' || c == ' ' || c == '\t' || c == '\r' || c == '\n'))
        break;
      ++at_;
      if (c == '{' || c == '[') ++depth;
      if ((c == '}' || c == ']') && --depth == 0) break;
    }
    return text_.substr(begin, at_ - begin);
  }

 private:
  void skip_string() {
    for (++at_; at_ < text_.size() && text_[at_] != '"'; ++at_) {
      if (text_[at_] == '\\') ++at_;
    }
    ++at_;
  }

  std::string_view text_;
  std::size_t at_ = 0;
};

std::string shown(std::string_view line) {
  std::string s(line.substr(0, 60));
  for (char& c : s) {
    if (c < ' ' || c > '~') c = '?';
  }
  return "'" + s + (line.size() > s.size() ? "…'" : "'");
}

}  // namespace

std::string sha256(std::string_view bytes) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned size = 0;
  if (EVP_Digest(bytes.data(), bytes.size(), digest.data(), &size, EVP_sha256(), nullptr) != 1)
    throw Error("SHA-256 is not available in OpenSSL");
  std::string hex;
  hex.reserve(std::size_t{2} * size);
  for (unsigned i = 0; i < size; ++i) {
    hex += "0123456789abcdef"[digest[i] >> 4];
    hex += "0123456789abcdef"[digest[i] & 15];
  }
  return hex;
}

std::string canonical_json(std::string_view text) { return parse_request(text).dump(); }

CanonicalRequest canonical_request(std::string_view text) {
  const Json request = parse_request(text);
  const bool tool = request.contains("payload") && request["payload"].dump().find("\"tool\"") != std::string::npos;
  CanonicalRequest canonical{request.dump(), "", kChain, "", tool || request.contains("clear_of")};
  if (!request.contains("steps")) {
    canonical.service = name_of(request, "service", false);
    canonical.robot = name_of(request, "robot", true);
  }
  canonical.hash = sha256(canonical.text);
  return canonical;
}

WorkerLine parse_worker_line(std::string_view line) {
  if (!Json::accept(line)) throw Error("the worker wrote " + shown(line) + ", expected a line of JSON");
  Scanner scanner(line);
  if (!scanner.take('{')) throw Error("the worker wrote " + shown(line) + ", expected a JSON object");
  WorkerLine found;
  bool has_id = false;
  while (!scanner.take('}')) {
    scanner.take(',');
    const std::string name = Json::parse(scanner.value()).get<std::string>();
    scanner.take(':');
    const std::string_view value = scanner.value();
    if (name == "reply") {
      found.reply = value;
    } else if (name == "problem") {
      found.problem = value;
    } else if (name == "id" || name == "message") {
      const Json text = Json::parse(value);
      if (!text.is_string()) throw Error("the worker wrote " + shown(line) + ": " + name + " is not a string");
      (name == "id" ? found.id : found.message) = text.get<std::string>();
      has_id |= name == "id";
    } else if (name == "progress") {
      const Json number = Json::parse(value);
      if (!number.is_number() || !(number.get<double>() >= 0) || !(number.get<double>() <= 1))
        throw Error("the worker wrote " + shown(line) + ": progress is not a number from 0 to 1");
      found.progress = number.get<double>();
    }
  }
  const int kinds = (found.progress ? 1 : 0) + (found.reply.empty() ? 0 : 1) + (found.problem.empty() ? 0 : 1);
  if (!has_id || kinds != 1)
    throw Error("the worker wrote " + shown(line) + ", expected id and one of progress, reply and problem");
  if (found.message.size() > kMostMessage || found.problem.size() > kMostMessage)
    throw Error("the worker wrote a message or problem of more than " + std::to_string(kMostMessage) +
                " bytes, which is the limit");
  if (!found.problem.empty() && found.problem.front() != '{')
    throw Error("the worker wrote " + shown(line) + ": problem is not an object");
  return found;
}

}  // namespace cotwin::gateway
