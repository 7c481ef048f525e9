#pragma once
#include <cstdint>
#include <utility>

/// What a scenario or a command line may choose of a foreign FMU.
namespace cotwin::fmu {

/// The interface that is used; kAny: Co-Simulation where the FMU offers it.
enum class InterfaceChoice : std::uint8_t { kAny, kCoSimulation, kModelExchange };
constexpr InterfaceChoice last(InterfaceChoice) { return InterfaceChoice::kModelExchange; }
inline constexpr std::pair<const char*, InterfaceChoice> kInterfaceWords[] = {
    {"any", InterfaceChoice::kAny}, {"cs", InterfaceChoice::kCoSimulation}, {"me", InterfaceChoice::kModelExchange}};

/// The process in which the FMU runs, see load().
enum class ProcessChoice : std::uint8_t { kAuto, kShared, kOwn };
inline constexpr std::pair<const char*, ProcessChoice> kProcessWords[] = {
    {"auto", ProcessChoice::kAuto}, {"shared", ProcessChoice::kShared}, {"own", ProcessChoice::kOwn}};

}  // namespace cotwin::fmu
