#pragma once
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <ostream>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "fmu/export/pack.h"
#include "tests/support/places.h"
#include "tests/support/unit_sources.h"

/// The exported units under test: all of the generated table, with settings and start values from tests/components/properties,
/// as in tests/components/unit/properties_test.cpp.
namespace cotwin::fmu::testing {

using cotwin::testing::properties_folder;

struct Subject {
  std::string source;
  Version version;
};

inline void PrintTo(const Subject& subject, std::ostream* out) {
  *out << subject.source << ", FMI " << static_cast<int>(subject.version);
}

/// Every unit in both versions, with each of its variants or with the first.
inline std::vector<Subject> subjects(bool variants) {
  std::vector<Subject> all;
  for (const UnitType& type : unit_types()) {
    if (cotwin::testing::is_host_only(type)) continue;
    std::vector<std::string> sources = cotwin::testing::unit_sources(type);
    if (!variants) sources.resize(1);
    for (const std::string& s : sources) {
      all.push_back({s, Version::k2});
      all.push_back({s, Version::k3});
    }
  }
  return all;
}

inline PackRequest request_for(const Subject& subject) {
  PackRequest request;
  request.source = subject.source;
  request.defaults = {{"robot", "lwr4"}};
  request.folders = {properties_folder(), std::filesystem::path(places::source()) / "models"};
  request.types = unit_types();
  request.version = subject.version;
  request.values = cotwin::testing::start_values(subject.source);
  return request;
}

inline Instance in_process(const PackRequest& request) {
  Instance instance = make_unit(request.source, request.defaults, request.folders, request.types);
  for (const ParameterSet& values : request.values) apply(values, instance.variables);
  return instance;
}

/// Inputs of step `number`: smooth, small, different for each element, within the declared range.
inline std::vector<double> excitation(const Variable& v, std::size_t channel, int number) {
  std::vector<double> values(v.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double wave = 0.1 * std::sin(0.013 * number + 0.7 * static_cast<double>(channel + i));
    values[i] = std::min(std::max(wave, v.min), v.max);
  }
  return values;
}

inline std::string name_of(const ::testing::TestParamInfo<Subject>& subject) {
  std::string name = subject.param.source.substr(5) + (subject.param.version == Version::k2 ? "_fmi2" : "_fmi3");
  for (char& c : name) {
    if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
  }
  return name;
}

}  // namespace cotwin::fmu::testing
