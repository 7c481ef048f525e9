#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "models/numerics/device/device.h"
#include "models/optimisation/judgement/drawing.h"

namespace cotwin::optimisation {

/// Which processor judges very many motions: kAuto, a GPU that is fast in double precision, where there are enough motions for it.
enum class DeviceUse { kAuto, kCpu, kGpu };
/// The GPU for this use. Throws DeviceError.
std::shared_ptr<numerics::Device> device_for(DeviceUse use);

/// What a device found of a batch of motions.
class Verdicts {
 public:
  std::size_t count() const { return count_; }
  void clear() { count_ = 0; }
  /// Whether Evaluator has to look at the motion: a derivative comes closer to its bound than the device can tell.
  bool open(std::size_t k) const { return values_[2 * count_ + k] < 0; }
  /// As in Values.
  double kinematic(std::size_t k) const { return values_[k]; }
  double torque(std::size_t k) const { return values_[count_ + k]; }
  /// The bound that is exceeded most as bound · n + joint.
  std::size_t worst(std::size_t k) const { return static_cast<std::size_t>(values_[2 * count_ + k]); }
  /// NaN for motions that were pruned.
  double cost(std::size_t term, std::size_t k) const { return values_[(3 + term) * count_ + k]; }

 private:
  friend class DeviceJudge;
  std::size_t count_ = 0;
  std::vector<double> values_;
};

/// Judges motions of one problem on a GPU as Evaluator does on the processor, but for rounding.
class DeviceJudge {
 public:
  static constexpr std::size_t kCompared = 4096;

  /// Of motions that are drawn, at most `most` at a time. Compares the device with `evaluator` on the first kCompared before any other use. Throws
  /// DeviceError for what the judgement does not know of this problem, for failures of the device, and for one whose figures differ by more than 1e-6:
  /// at degree 31 rounding alone is 1e-8.
  DeviceJudge(const Evaluator& evaluator, const Drawing& drawing, std::size_t most, std::shared_ptr<numerics::Device> device);
  ~DeviceJudge();

  const std::string& device() const;
  /// difference() of the first kCompared.
  double rounding() const { return rounding_; }
  /// The largest relative difference to `evaluator` among the drawn motions first … first + count − 1, without those that are open.
  double difference(const Evaluator& evaluator, const Drawing& drawing, std::uint32_t first = 0, std::size_t count = kCompared);

  /// Begins with the drawn motions first … first + count − 1.
  void start(std::uint32_t first, std::size_t count, unsigned block = 128);
  /// Begins with motions that are given: of motion i of `count` the duration at [i], then its q_to and coefficients at [k · count + i]. They
  /// begin at the first posture of Drawing::from.
  void start(const std::vector<double>& given, std::size_t count);
  /// Waits for what start() began.
  void finish(Verdicts& verdicts);

 private:
  void launch(unsigned long long given, std::uint32_t first, std::size_t count, unsigned block);

  struct Impl;
  std::unique_ptr<Impl> impl_;
  double rounding_ = 0;
};

/// Blocks of kLanes motions of a problem, as a swarm has them, that a device judges together.
class JudgedBlocks {
 public:
  /// Throws DeviceError as DeviceJudge does.
  JudgedBlocks(const Evaluator& evaluator, std::size_t blocks, std::shared_ptr<numerics::Device> device);

  const DeviceJudge& judge() const { return judge_; }
  /// May be called for different blocks from several threads, as take().
  void put(std::size_t block, const Motions& motions);
  void run();
  /// What evaluate() finds of the motions of put(), but Values::worst.
  void take(std::size_t block, const Motions& motions, Evaluator::Scratch& scratch, Values& values) const;

 private:
  const Evaluator& evaluator_;
  std::size_t count_;
  DeviceJudge judge_;
  std::vector<double> given_;
  Verdicts verdicts_;
};

}  // namespace cotwin::optimisation
