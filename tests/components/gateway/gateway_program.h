#pragma once
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/support/http_client.h"
#include "tests/support/patience.h"
#include "tests/support/run_program.h"

namespace cotwin::testing {

/// Whether this machine has a program.
inline bool has(const std::string& program) { return run_command({"sh", "-c", "command -v " + program}).code == 0; }

/// The program `cotwin serve` at a free port.
class Gateway {
 public:
  explicit Gateway(const std::filesystem::path& out, const std::vector<std::string>& options = {})
      : Gateway(options, out, {"serve", "--port", "0", "--out", out, "--quiet"}) {}
  /// The unit in a run, with everything that clients can ask of it.
  static Gateway in_run(const std::filesystem::path& scenario, const std::filesystem::path& out,
                        const std::vector<std::string>& more = {}) {
    std::vector<std::string> options;
    for (const std::string& value :
         {std::string("port=0"), "url_file=" + (out / "url.txt").string(), "database=" + (out / "jobs.sqlite").string()})
      options.insert(options.end(), {"--set", "gateway." + value});
    for (const std::string& value : more) options.insert(options.end(), {"--set", "gateway." + value});
    return Gateway(options, out, {"run", scenario, "--out", out, "--quiet"});
  }
  Gateway(const std::vector<std::string>& options, const std::filesystem::path& out, std::vector<std::string> arguments)
      : out_(out) {
    std::filesystem::remove(out / "url.txt");
    arguments.insert(arguments.end(), options.begin(), options.end());
    process_ = std::make_unique<Process>(start_program(std::move(arguments)));
    if (!within_patience([&] { return !url().empty(); })) throw std::runtime_error("no gateway: " + process_->wait().err);
    port_ = static_cast<std::uint16_t>(std::stoi(url().substr(url().rfind(':') + 1)));
  }
  std::string url() const {
    std::ifstream in(out_ / "url.txt");
    std::string line;
    std::getline(in, line);
    return in.eof() ? "" : line;
  }
  std::uint16_t port() const { return port_; }
  Process& process() { return *process_; }
  HttpReply call(const std::string& method, const std::string& target, const std::string& body = "",
                 const std::string& fields = "") const {
    return http_call(port_, method, target, body, fields);
  }
  nlohmann::json get(const std::string& target) const { return nlohmann::json::parse(call("GET", target).body); }

 private:
  std::filesystem::path out_;
  std::unique_ptr<Process> process_;
  std::uint16_t port_ = 0;
};

}  // namespace cotwin::testing
