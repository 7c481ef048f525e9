#include "master/run/identity.h"

#include <system_error>
#include <variant>
#include <vector>

#include "master/engine/wiring/members.h"
#include "models/foundation/support/bytes.h"
#include "models/foundation/support/file_hash.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace fs = std::filesystem;

namespace {

/// Collects the fields of a scenario as bytes, each text with its length.
class Text {
 public:
  explicit Text(const Scenario& scenario) : scenario_(scenario) {}

  void add(const std::string& text) { out_.text(text); }
  void add(double number) { out_.value(number); }
  void add(std::int64_t number) { out_.value(number); }
  void add(const ParameterValue& value) {
    add(value.name);
    add(static_cast<std::int64_t>(value.value.index()));
    std::visit([this](const auto& v) { add_value(v); }, value.value);
    add(value.unit);
  }
  /// Adds a text and, if it names a file, a hash of the file.
  void add_with_file(const std::string& text) {
    add(text);
    std::error_code none;
    for (const fs::path& folder : {scenario_.folder, fs::path()}) {
      const fs::path file = folder / text;
      if (text.empty() || !fs::is_regular_file(file, none)) continue;
      out_.value(hash_of_file(file));
      return;
    }
  }
  void add_fmu(const fs::path& path) {
    std::error_code none;
    if (fs::is_regular_file(path, none)) {
      out_.value(hash_of_file(path));
    } else if (fs::is_regular_file(path / "modelDescription.xml", none)) {
      out_.value(hash_of_file(path / "modelDescription.xml"));
    }
  }
  std::uint64_t hash() const { return cotwin::hash_of(out_.bytes()); }

 private:
  void add_value(double v) { add(v); }
  void add_value(const std::string& v) { add_with_file(v); }
  template <class T>
  void add_value(const T& v) {
    add(static_cast<std::int64_t>(v));
  }

  const Scenario& scenario_;
  ByteWriter out_;
};

/// The values of a unit's query, "robot=arm.urdf&kind=csv", may also name files.
void add_query(Text& text, const std::string& source) {
  const std::size_t query = source.find('?');
  if (query == std::string::npos) return;
  for (const std::string_view setting : text::split(std::string_view(source).substr(query + 1), '&')) {
    const std::size_t equals = setting.find('=');
    if (equals != std::string_view::npos) text.add_with_file(std::string(setting.substr(equals + 1)));
  }
}

}  // namespace

std::uint64_t hash_of(const Scenario& s) {
  Text text(s);
  text.add(s.name);
  for (const std::int64_t number : {s.start.ns, s.stop.ns, s.tick.ns, std::int64_t{s.decimation}}) text.add(number);
  text.add(s.tolerance);
  text.add(static_cast<std::int64_t>(s.coupling));
  text.add(static_cast<std::int64_t>(s.ignore_unknown_parameters));
  for (const auto& [name, value] : s.settings) {
    text.add(name);
    text.add_with_file(value);
  }
  for (const NestedSetting& setting : s.nested_settings) {
    text.add(setting.scope);
    text.add(setting.name);
    text.add_with_file(setting.value);
  }
  text.add(static_cast<std::int64_t>(s.all_outputs));
  for (const ComponentSpec& c : s.components) {
    text.add(c.name);
    text.add(c.source);
    for (const int number : {c.stage, c.period}) text.add(static_cast<std::int64_t>(number));
    text.add(static_cast<std::int64_t>(c.implementation));
    for (const ParameterValue& value : c.start_values) text.add(value);
    if (is_unit(c)) {
      add_query(text, c.source);
    } else {
      text.add_fmu(fmu_source(c, s).path);
    }
  }
  for (const ConnectionSpec& c : s.connections) {
    for (const Port& port : {c.from, c.to}) {
      text.add(port.component);
      text.add(port.variable);
      text.add(port.unit);
    }
    text.add(c.factor);
    text.add(c.offset);
    text.add(static_cast<std::int64_t>(c.suppress_unit_conversion));
  }
  for (const EventSpec& e : s.events) {
    text.add(e.time.ns);
    text.add(e.variable);
    text.add(e.value);
    text.add(e.ramp.ns);
  }
  for (const ToolSpec& t : s.tools) {
    text.add(t.time.ns);
    for (const bool flag : {t.attach, t.known}) text.add(static_cast<std::int64_t>(flag));
    for (const std::string& word : {t.name, t.parent, t.robot, t.scope}) text.add(word);
    for (const auto& numbers : {t.xyz, t.rpy, t.com}) {
      for (const double number : numbers) text.add(number);
    }
    text.add_with_file(t.shapes.string());
    text.add(t.mass);
    for (const double moment : t.inertia) text.add(moment);
    for (const ToolSpec::Frame& frame : t.frames) {
      text.add(frame.name);
      for (const auto& numbers : {frame.xyz, frame.rpy}) {
        for (const double number : numbers) text.add(number);
      }
    }
    for (const std::string& component : t.components) text.add(component);
  }
  for (const RecordSpec& r : s.recording) text.add(r.variables);
  for (const ComparisonSpec& c : s.comparisons) {
    for (const std::string& name : {c.name, c.a, c.b}) text.add(name);
    text.add(static_cast<std::int64_t>(c.segments));
    text.add(c.from.value_or(s.start).ns);
    text.add(c.to.value_or(s.stop).ns);
  }
  for (const BondSpec& b : s.bonds) {
    for (const std::string& name : {b.name, b.effort_a, b.flow_a, b.effort_b, b.flow_b}) text.add(name);
    text.add(b.tolerance);
    text.add(b.reference);
  }
  for (const ReportSpec& r : s.reports) {
    for (const std::string& name : {r.name, r.a, r.b}) text.add(name);
    text.add(static_cast<std::int64_t>(r.kind));
  }
  for (const UnitDefinition& unit : s.units) text.add(unit.name);
  return text.hash();
}

}  // namespace cotwin::master
