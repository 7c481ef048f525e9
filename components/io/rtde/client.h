#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "components/io/rtde/rtde.h"

namespace cotwin::rtde {

/// A quantity that a client wants.
struct Wanted {
  std::string name;
  bool required = true;  // else the client goes on without it if the controller does not have it
};

struct ClientSettings {
  double frequency = 500;  // Hz of the data packages
  std::vector<Wanted> outputs, inputs;
  std::int64_t patience = 1'000'000'000;  // ns until a reply has to be there
};

/// s: time stamps that are further apart than this are not of one clock.
inline constexpr double kLongestPause = 3600;

/// The PC's side of RTDE: agrees on version 2 (else 1), asks for the controller's version, sets up the recipes, and starts. Bytes and
/// times in, bytes out. Nothing allocates after construction.
class Client {
 public:
  enum class State : std::uint8_t { kIdle, kProtocol, kVersion, kOutputs, kInputs, kStart, kRunning, kFailed };

  /// Throws Error at `place` for a name that UR's documentation does not have.
  Client(const ClientSettings& settings, const std::string& place);

  const Directory& directory() const { return directory_; }
  State state() const { return state_; }
  bool running() const { return state_ == State::kRunning; }
  /// Why the state is kFailed; the name of the quantity, where there is one.
  const char* reason() const { return reason_; }
  std::string_view culprit() const { return culprit_ != nullptr ? std::string_view(culprit_->name) : std::string_view(); }

  /// The stream has opened at `now` (ns): the set-up begins.
  void open(std::int64_t now);
  void close() { state_ = State::kIdle; }
  /// Where bytes of the controller go, and that so many have come.
  std::span<std::uint8_t> space() { return reader_.space(); }
  void received(std::size_t bytes) { reader_.received(bytes); }
  /// Handles packages until a data package has been read, at `now`; false: there are no more. Data before the start are not given.
  bool read(std::int64_t now);
  /// Handles replies of the set-up only: data packages stay for read().
  void set_up(std::int64_t now);
  /// The time stamp (s) of the newest data package that waits for read() and was not given before. Stamps that read() would refuse
  /// are left out.
  std::optional<double> look_ahead();
  /// Drops the oldest data packages that look_ahead() has seen, except the last one, until there is space for two more, and handles
  /// what is between them, at `now`: a caller that looks ahead again and again without read() does not come to a standstill.
  void make_room(std::int64_t now);
  /// Whether what follows the packages that look_ahead() has seen makes no sense.
  bool senseless() const { return reader_.senseless(looked_); }

  /// Values of the last data package, by slots of the directory.
  std::span<const double> values() const { return values_; }
  bool has(std::string_view output) const;
  double value(std::string_view name, std::size_t i = 0) const { return values_[directory_.slot(name) + i]; }
  /// Values to be sent; numbers that are not finite are refused by send().
  double& at(std::string_view name, std::size_t i = 0) { return sent_[directory_.slot(name) + i]; }
  /// Sends the inputs; false if there are none, one is not finite, or the stream has no room (it is lost then).
  bool send();

  std::span<const std::uint8_t> waiting() const { return writer_.waiting(); }
  void sent(std::size_t bytes) { writer_.sent(bytes); }

  const std::array<std::uint32_t, 4>& version() const { return version_; }  // of the controller
  std::uint64_t rejected() const { return rejected_; }                      // packages that could not be read
  std::uint64_t unsent() const { return unsent_; }                          // commands that had no room
  std::string_view text() const { return {text_.data(), text_size_}; }      // last warning or error of the controller

 private:
  void handle(const PackageReader::Raw& package, std::int64_t now);
  void ask(Package kind, State state, std::int64_t now);
  void ask_recipe(bool inputs, std::int64_t now);
  void read_types(bool inputs, std::span<const std::uint8_t> contents, std::int64_t now);
  void read_text(std::span<const std::uint8_t> contents);
  bool read_data(const PackageReader::Raw& package);
  bool read_stamp();
  void fail(const char* reason, const Field* culprit = nullptr);

  struct Row {
    const Field* field;
    bool required, available;
  };

  ClientSettings settings_;
  Directory directory_;
  std::vector<Row> outputs_, inputs_;
  Recipe output_recipe_, input_recipe_;
  Values values_, read_, sent_;
  PackageReader reader_;
  PackageWriter writer_;
  State state_ = State::kIdle;
  const char* reason_ = "";
  const Field* culprit_ = nullptr;
  int protocol_ = 1;
  std::uint8_t output_id_ = 0, input_id_ = 0;
  std::int64_t asked_ = 0;  // ns
  std::array<std::uint32_t, 4> version_{};
  std::uint64_t rejected_ = 0, unsent_ = 0;
  std::optional<double> stamp_;  // s, of the last data package that could be read
  std::size_t looked_ = 0;       // bytes after the next package up to which look_ahead() has looked
  std::array<char, 256> text_{};
  std::size_t text_size_ = 0;
};

}  // namespace cotwin::rtde
