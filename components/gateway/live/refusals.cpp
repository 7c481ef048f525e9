#include "components/gateway/live/refusals.h"

#include <vector>

#include "components/bus/errors.h"
#include "components/gateway/http/problem.h"

namespace cotwin::gateway::live {

void refuse(int status, const std::string& detail, const std::string& pointer) {
  std::vector<http::Field> fields;
  if (status == 503 || status == 429) fields.push_back({"Retry-After", "1"});
  throw http::Refusal{{status, detail, pointer, ""}, fields};
}

std::string detail_of(const Error& error) {
  const std::string text = error.what();
  return text.starts_with("run: ") ? text.substr(5) : text;
}

void refuse_error(const std::string& pointer) {
  try {
    throw;
  } catch (const bus::NoRoom& error) {
    refuse(503, detail_of(error));
  } catch (const bus::RunEnded&) {
    refuse(409, "the run has ended");
  } catch (const Error& error) {
    refuse(422, detail_of(error), pointer);
  }
}

}  // namespace cotwin::gateway::live
