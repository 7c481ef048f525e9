#pragma once
#include <filesystem>
#include <functional>
#include <iosfwd>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "components/services/robots.h"
#include "components/services/services.h"
#include "components/services/verification.h"
#include "models/foundation/support/error.h"
#include "models/trajectory/series/recording.h"

/// Requests and replies as JSON with units of measure in names (from_q_rad, T_s). Reading is strict: unknown members, wrong types
/// and numbers that are not finite are errors that name the JSON pointer, the fact and what was expected.
namespace cotwin::services {

/// A request that cannot be answered. The message is "pointer: detail".
class RequestError : public Error {
 public:
  /// `pointer`: of the member of the request, RFC 6901; "" for the request as a whole.
  RequestError(const std::string& pointer, const std::string& detail);
  const std::string& pointer() const { return pointer_; }
  const std::string& detail() const { return detail_; }

 private:
  std::string pointer_, detail_;
};

/// Receives a table of which no row is kept.
class RowSink {
 public:
  virtual ~RowSink() = default;
  virtual void begin(const std::vector<std::string>& columns, std::size_t rows) = 0;
  virtual void row(const std::vector<double>& values) = 0;
};

/// What a service may use while it works.
struct Context {
  numerics::Threads* threads = nullptr;
  /// Called on the thread of the request with the share of the work that is done, 0 to 1.
  std::function<void(double share, const std::string& message)> progress = {};
  /// Receives the particles of an optimisation as CSV (optimisation::ParticleTable).
  std::ostream* particles = nullptr;
  RowSink* rows = nullptr;   // receives the motions that grow draws
  Verify verify = {};        // the twin, for the service verify; master/services/verify.h
  Robots* robots = nullptr;  // set for each request: for the robots and the scene of clear_of
  bool only_read = false;    // the reply is null: the request is read and checked, and nothing is computed
};

/// The names of all services.
std::vector<std::string> service_names();

/// The JSON Schemas (2020-12) of a service as {"title", "description", "request": {…}, "reply": {…}}, one line. Throws Error for an
/// unknown service.
std::string schema(const std::string& service);

/// Answers a request {"service": "feasibility", "robot": "lwr4", …} with one line of JSON. Without the member "robot" the fallback of
/// `robots` is taken. "locked_q" holds joints, {"joint": position in rad or m}. Same request, same robot: same bytes. Throws Error.
std::string answer(Robots& robots, std::string_view request, const Context& context = {});
std::string answer_object(Robots& robots, const nlohmann::ordered_json& request, const Context& context = {});
/// Throws what answer_object() throws for a request that can never be answered by these robots: members that are unknown, missing or
/// of another type, sizes, limits. Quick: no motion is computed. An answer may still fail, as where no duration meets the bounds.
void check_object(Robots& robots, const nlohmann::ordered_json& request);

/// Which data the robot has: of each file of kDataFiles "missing", "given", "partly assumed" or "assumed".
nlohmann::ordered_json data_of(const Robot& robot);
/// The same of all robots by name, with the number of joints; of one that cannot be read {"problem": "…"}.
nlohmann::ordered_json data_of_all(Robots& robots);

/// The member of a request to `robots` that has this vector of joint positions: "from_q_rad", or "from_q" for a robot with prismatic
/// joints. Throws Error.
std::string posture_member(Robots& robots, const nlohmann::ordered_json& request, const std::string& plain);

/// The positions of a recording (CSV) as the member "series" of the request. Throws Error.
nlohmann::ordered_json series_member(Robots& robots, const nlohmann::ordered_json& request, const std::filesystem::path& file,
                                     trajectory::RecordingFormat format);

inline constexpr std::size_t kMostBodyValues = 100'000;    // of what a client sends
inline constexpr std::size_t kMostFileValues = 1'000'000;  // of a file, and of a line for a worker

/// Reads in time that grows with the length. Throws RequestError with the place for text that is not JSON, is nested deeper than 32, has a
/// member twice or more than 4096 members in an object, or more values (arrays and objects count, too) than `most_values`.
nlohmann::ordered_json parse_json(std::string_view text, std::size_t most_values = kMostFileValues);
/// The same, which must be an object.
nlohmann::ordered_json parse_object(std::string_view text, std::size_t most_values = kMostFileValues);

/// An error as {"title", "detail", "pointer"} in one line; "pointer" only for a RequestError with one.
std::string problem(const std::exception& error);

}  // namespace cotwin::services
