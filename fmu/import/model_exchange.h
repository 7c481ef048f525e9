#pragma once
#include "fmu/import/fmu_unit.h"

namespace cotwin::fmu {

/// A foreign FMU for Model Exchange as a unit: ẋ = f(t, x, u) of the FMU, integrated with CVODE (BDF, Newton with a dense
/// Jacobian by differences), relative tolerance as the scenario or the FMU's default experiment has it (else 1e-6), absolute
/// tolerance 0.01 · relative · nominal value. Events: of state by CVODE's root finding on the FMU's indicators, of time as the
/// FMU announces them, of steps as it asks for; and where inputs jump. Continuous inputs may be ramped over a step. The
/// solver's history is kept from one communication step to the next as long as the inputs go on steadily; it begins afresh
/// after an event, and where a snapshot was taken or restored, so that both ways lead to the same bits.
class ModelExchangeUnit final : public ForeignUnit {
 public:
  ModelExchangeUnit(std::shared_ptr<const ForeignFmu> fmu, UnitOptions options);
  ~ModelExchangeUnit() override;

 private:
  struct Solver;  // what SUNDIALS owns

  std::unique_ptr<ForeignInstance> make() override;
  void begin(Time start) override;
  bool advance(Time now, Duration h) override;
  void write_memory(ByteWriter& out) override;
  void read_memory(ByteReader& in) override;
  void make_solver();
  bool inputs_jump() const;
  /// From event mode, in which the instance is, to continuous time.
  void finish_events(double t);
  void handle_events(double t);

  std::unique_ptr<Solver> solver_;
  std::vector<double> last_values_, last_rates_;
  double last_h_ = 0, step_begin_ = 0;  // s
  bool restart_ = true, ramps_now_ = false;
};

}  // namespace cotwin::fmu
