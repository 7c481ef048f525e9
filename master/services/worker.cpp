#include "master/services/worker.h"

#include <istream>
#include <nlohmann/json.hpp>
#include <ostream>

namespace cotwin::master {

namespace {

using Json = nlohmann::ordered_json;
using services::RequestError;

enum class Line { kRead, kTooLong, kEnd };

/// Reads a line without keeping more than kLongestLine bytes of it.
Line read_line(std::istream& in, std::string& line) {
  line.clear();
  std::streambuf& bytes = *in.rdbuf();
  using Traits = std::streambuf::traits_type;
  bool too_long = false;
  for (;;) {
    const auto c = bytes.sbumpc();
    if (Traits::eq_int_type(c, Traits::eof()))
      return line.empty() && !too_long ? Line::kEnd : too_long ? Line::kTooLong : Line::kRead;
    if (Traits::to_char_type(c) == '\n') return too_long ? Line::kTooLong : Line::kRead;
    if (too_long) continue;
    line += Traits::to_char_type(c);
    if (line.size() > kLongestLine) {
      too_long = true;
      line.clear();
    }
  }
}

bool is_blank(const std::string& line) { return line.find_first_not_of(" \t\r") == std::string::npos; }

std::string text_of(const Json& value) { return value.dump(-1, ' ', false, Json::error_handler_t::replace); }

}  // namespace

bool run_worker(std::istream& in, std::ostream& out, services::Robots& robots, const services::Context& context) {
  std::string line;
  for (;;) {
    const Line read = read_line(in, line);
    if (read == Line::kEnd) return out.good();
    if (read == Line::kRead && is_blank(line)) continue;
    std::string id = "null";
    const auto write = [&](const std::string& member, const std::string& value) {
      out << "{\"id\":" << id << "," << member << value << "}\n" << std::flush;
    };
    try {
      if (read == Line::kTooLong)
        throw RequestError("", "is longer than " + std::to_string(kLongestLine) + " bytes, expected a shorter line");
      const Json job = services::parse_object(line);
      if (const auto at = job.find("id"); at != job.end() && (at->is_string() || at->is_number_integer())) id = text_of(*at);
      if (id == "null") throw RequestError("/id", "is missing, expected the job's id as a string");
      for (const auto& [name, value] : job.items())
        if (name != "id" && name != "request")
          throw RequestError("", "the line has the unknown member '" + name.substr(0, 40) + "', expected id and request");
      if (!job.contains("request"))
        throw RequestError("", "the line has no member 'request', expected the request of a service");
      services::Context own = context;
      own.progress = [&](double share, const std::string& message) {
        write("\"progress\":", text_of(share) + ",\"message\":" + text_of(message));
      };
      write("\"reply\":", services::answer_object(robots, job["request"], own));
    } catch (const std::exception& e) {
      write("\"problem\":", services::problem(e));
    }
    if (!out) return false;
  }
}

}  // namespace cotwin::master
