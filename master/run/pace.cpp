#include "master/run/pace.h"

#include <algorithm>
#include <atomic>
#include <utility>

#include "master/clock/realtime.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

Pace::Pace(const Scenario& scenario, std::span<const Member> members, std::unique_ptr<Clock> given, HostTime* host)
    : spec_(scenario.clock),
      tick_(scenario.tick),
      clock_(given ? std::move(given)
                   : make_clock(scenario.clock, scenario.tick, members, host != nullptr ? *host : HostTime::system())),
      waits_(!clock_->never_waits()) {
  realtime::check(spec_);
  clock_->state().declare(variables_);
}

void Pace::prepare_threads(Engine& engine) {
  if (std::exchange(prepared_, true) || !spec_.real_time_thread()) return;
  if (spec_.priority > 0) realtime::prepare_process(refused_);
  struct Work {
    const ClockSpec& spec;
    std::vector<std::vector<std::string>> refused;  // per thread
  } work{spec_, std::vector<std::vector<std::string>>(static_cast<std::size_t>(engine.threads()))};
  engine.on_each_thread(
      [](void* context, std::size_t i) {
        Work& all = *static_cast<Work*>(context);
        realtime::prepare_thread(all.spec, i, all.refused[i]);
      },
      &work);
  for (const auto& sentences : work.refused) {
    for (const std::string& sentence : sentences) {
      if (std::ranges::find(refused_, sentence) == refused_.end()) refused_.push_back(sentence);
    }
  }
}

bool Pace::wait(Engine& engine, std::int64_t tick) {
  const Time now = engine.schedule.time(tick);
  if (!started_) {
    prepare_threads(engine);
    loop_thread_ = std::this_thread::get_id();
    faults_at_start_ = count_page_faults(engine);
    started_ = true;
    clock_->start(now);
  }
  late_ticks_ = 0;
  if (!clock_->wait(now)) return false;
  if (clock_->overrun()) [[unlikely]]
    handle_overrun(engine, tick);
  return true;
}

void Pace::handle_overrun(const Engine& engine, std::int64_t tick) {
  if (spec_.overrun == OverrunPolicy::kSkip) late_ticks_ = clock_->lateness().ns / tick_.ns;
  if (spec_.overrun != OverrunPolicy::kStop) return;
  const auto milliseconds = [](Duration d) { return text::to_text(1e-6 * static_cast<double>(d.ns), 6) + " ms"; };
  fail(spec_.place, "tick " + std::to_string(tick) + " at t = " + text::to_text(engine.schedule.time(tick).seconds()) +
                        " s began " + milliseconds(clock_->lateness()) + " late, more than " + milliseconds(spec_.late) +
                        " (overrun=stop)");
}

Tick Pace::long_tick(const Engine& engine, std::int64_t tick) {
  const Tick all = engine.schedule.long_tick(tick, late_ticks_, engine.events.next_after(engine.schedule.time(tick)));
  clock_->skip(all.skipped);
  return all;
}

std::int64_t Pace::count_page_faults(Engine& engine) {
  std::atomic<std::int64_t> faults{0};
  engine.on_each_thread(
      [](void* context, std::size_t) { *static_cast<std::atomic<std::int64_t>*>(context) += realtime::page_faults(); },
      &faults);
  return faults;
}

void Pace::finish(Engine& engine) {
  if (started_ && !page_faults_ && std::this_thread::get_id() == loop_thread_)
    page_faults_ = count_page_faults(engine) - faults_at_start_;
}

ClockReport Pace::report() const {
  return {waits_ ? spec_.kind : ClockKind::kFree,
          clock_->state(),
          clock_->rms_offset(),
          clock_->start_delays(),
          clock_->run_times(),
          page_faults_};
}

}  // namespace cotwin::master
