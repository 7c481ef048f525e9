#pragma once
#include <span>
#include <string>
#include <vector>

#include "components/unit/time.h"
#include "master/engine/wiring/members.h"
#include "master/engine/wiring/wiring.h"
#include "models/foundation/support/bytes.h"

/// The error of coupling, for the choice of the communication step.
namespace cotwin::master {

class Engine;

/// Compares the inputs at the end of a step with the values that were expected at its beginning: the linear continuation (with
/// the declared derivative, otherwise with the slope of the last step) of inputs that their unit follows or that are solved for,
/// the last value of others. The difference is the error of explicit coupling, and the term that implicit coupling leaves out.
/// Not compared are sampled values: discrete sources, and units with a period or without a way back; and outputs that have jumped
/// to and fro in kMostJumps steps one after the other: noise, which no step is short enough for.
class InputError {
 public:
  /// `tolerance`: relative to the largest magnitude that the variable has had, at least its nominal value (kSmall if it has
  /// none).
  InputError(const std::vector<ResolvedConnection>& links, std::span<const Member> members, double tolerance);

  /// Call after the initialisation.
  void start(const Engine& engine);
  void begin(Duration h);
  /// The largest difference; 1 is just within the tolerance.
  double end();
  /// The step is kept. Call after end(). `shortest`: it cannot be made shorter.
  void accept(Duration h, bool shortest);
  /// Names of the outputs that are not compared any more.
  std::vector<std::string> noisy() const;

  void read(ByteReader& in);
  static auto fields(auto& e, auto each) { return each(e.last_, e.slope_, e.first_, e.sources_); }

  static constexpr int kMostJumps = 32;
  static constexpr double kSmall = 1e-6;  // in the variable's SI measure

 private:
  struct Source {
    const ResolvedConnection* link = nullptr;
    std::span<const double> values;
    std::size_t first = 0;  // of its elements in the lists below
    bool linear = false;    // continued linearly
    double scale = 0;
    double error = 0;  // of the last step
    int jumps = 0;     // shortest steps since the last one that kept the tolerance, or since values had drifted

    static auto fields(auto& s, auto each) { return each(s.scale, s.jumps); }
    static auto left_out(auto& s, auto each) { return each(s.link, s.values, s.first, s.linear, s.error); }
  };
  std::vector<Source> sources_;
  bool has_drifted(const Source& source) const;
  std::vector<double> last_, slope_, expected_;
  std::vector<double> first_;  // before the first of the jumps
  double tolerance_;
};

}  // namespace cotwin::master
