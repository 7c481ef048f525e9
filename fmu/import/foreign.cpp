#include "fmu/import/foreign.h"

#include <algorithm>
#include <cctype>

#include "fmu/import/load.h"
#include "models/foundation/support/error.h"

namespace cotwin::fmu {

namespace {

constexpr int kMaxEventIterations = 10'000;

}  // namespace

EventOutcome ForeignInstance::update_discrete_states(const std::function<void()>& before_each) {
  EventOutcome out;
  for (int i = 0; i < kMaxEventIterations; ++i) {
    if (before_each) before_each();
    if (!update_once(out) || out.terminate) return out;
  }
  throw Error("the update of the FMU's discrete states did not converge in " + std::to_string(kMaxEventIterations) +
              " iterations");
}

bool ForeignInstance::step(PlainStep& step, bool sets) {
  if (sets) set(Type::kFloat64, step.set_references, step.set_values.data(), step.set_values.size(), nullptr);
  step.outcome = do_step(step.now, step.h);
  const StepOutcome& out = step.outcome;
  if (out.discarded || out.terminate || out.event || out.reached != step.now + step.h) return false;
  if (!step.get_references.empty()) {
    get(Type::kFloat64, step.get_references, step.get_values.data(), step.get_values.size(), nullptr);
  }
  return true;
}

void Messages::add(std::string_view level, std::string_view category, std::string_view text) {
  const std::lock_guard lock(mutex_);
  ++count_;
  ++new_;
  std::string line = "[" + std::string(level) + (category.empty() ? "" : ", " + std::string(category.substr(0, 60))) + "] " +
                     std::string(text.substr(0, kLength)) + (text.size() > kLength ? "…" : "");
  for (char& c : line) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';  // an FMU must not control the terminal
  }
  while (!line.empty() && line.back() == ' ') line.pop_back();
  // Repeated messages are kept once.
  if (std::find(kept_.begin(), kept_.end(), line) != kept_.end()) return;
  if (kept_.size() == kKept) kept_.pop_front();
  kept_.push_back(std::move(line));
}

std::string Messages::take() {
  const std::lock_guard lock(mutex_);
  if (kept_.empty()) return "";
  std::string all = "; messages of the FMU: ";
  if (new_ > kept_.size()) all += "(the last of " + std::to_string(new_) + ") ";
  for (std::size_t i = 0; i < kept_.size(); ++i) all += (i == 0 ? "" : " | ") + kept_[i];
  kept_.clear();
  new_ = 0;
  return all;
}

std::uint64_t Messages::count() const {
  const std::lock_guard lock(mutex_);
  return count_;
}

const Interface& interface_of(const ModelDescription& description, InterfaceKind kind) {
  const std::optional<Interface>& found =
      kind == InterfaceKind::kCoSimulation ? description.co_simulation : description.model_exchange;
  if (found) return *found;
  std::string offered;
  const auto offer = [&](bool there, const char* what) {
    if (there) offered += (offered.empty() ? "" : " and ") + std::string(what);
  };
  offer(description.co_simulation.has_value(), "Co-Simulation");
  offer(description.model_exchange.has_value(), "Model Exchange");
  offer(description.scheduled_execution.has_value(), "Scheduled Execution");
  throw Error("the FMU offers " + offered + ", expected " +
              (kind == InterfaceKind::kCoSimulation ? "Co-Simulation" : "Model Exchange"));
}

InterfaceKind chosen_kind(const ModelDescription& description, InterfaceChoice kind) {
  const bool me_alone = description.model_exchange && !description.co_simulation;
  return kind == InterfaceChoice::kModelExchange || (kind == InterfaceChoice::kAny && me_alone) ? InterfaceKind::kModelExchange
                                                                                                : InterfaceKind::kCoSimulation;
}

std::vector<const char*> error_categories(const ModelDescription& description) {
  std::vector<const char*> found;
  for (const LogCategory& category : description.log_categories) {
    std::string name = category.name;
    std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    for (const char* word : {"error", "fatal", "warning", "discard"}) {
      if (name.find(word) != std::string::npos) {
        found.push_back(category.name.c_str());
        break;
      }
    }
  }
  return found;
}

}  // namespace cotwin::fmu
