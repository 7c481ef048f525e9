#pragma once
#include "fmu/import/unit/fmu_unit.h"

namespace cotwin::fmu {

/// A foreign FMU for Model Exchange as a unit: ẋ = f(t, x, u) of the FMU, integrated with CVODE (BDF, Newton with a dense
/// Jacobian by differences). Relative tolerance: that of the scenario, else of the FMU's default experiment, else 1e-6;
/// absolute tolerance: 0.01 · relative · nominal value. Events: state events by CVODE's root finding on the event indicators,
/// time events that the FMU announces, step events that it requests, and jumps of inputs. Continuous inputs can be ramped over
/// a step. The solver's history is kept between communication steps while the inputs are continuous. The solver restarts after
/// an event and where a snapshot was taken or restored, so that a restored run gives the same bits.
class ModelExchangeUnit final : public ForeignUnit {
 public:
  ModelExchangeUnit(std::shared_ptr<const ForeignFmu> fmu, UnitOptions options);
  ~ModelExchangeUnit() override;

 private:
  struct Solver;  // the objects of SUNDIALS

  std::unique_ptr<ForeignInstance> make() override;
  void begin(Time start) override;
  bool advance(Time now, Duration h) override;
  void write_memory(ByteWriter& out) override;
  void read_memory(ByteReader& in) override;
  void make_solver();
  bool inputs_jump() const;
  /// Completes event mode and enters Continuous-Time Mode.
  void finish_events(double t);
  void handle_events(double t);

  std::unique_ptr<Solver> solver_;
  std::vector<double> last_values_, last_rates_;
  double last_h_ = 0, step_begin_ = 0;  // s
  bool restart_ = true, ramps_now_ = false;
};

}  // namespace cotwin::fmu
