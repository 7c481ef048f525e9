#include "master/twin/ssd_write.h"

#include <algorithm>
#include <set>
#include <sstream>

#include "master/scenario/annotation.h"
#include "master/scenario/system.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

/// Writes a start tag, attribute by attribute.
class Tag {
 public:
  Tag(std::ostream& out, int depth, const char* name) : out_(out) {
    out_ << std::string(2 * static_cast<std::size_t>(depth), ' ') << '<' << name;
  }
  Tag& with(const char* name, const std::string& value) {
    out_ << ' ' << name << "=\"" << xml::escaped(value) << '"';
    return *this;
  }
  Tag& with(const char* name, double value) { return with(name, text::to_text(value)); }
  Tag& with(const char* name, int value) { return with(name, std::to_string(value)); }
  Tag& with_if(bool wanted, const char* name, const std::string& value) { return wanted ? with(name, value) : *this; }
  void open() { out_ << ">\n"; }
  void end() { out_ << "/>\n"; }

 private:
  std::ostream& out_;
};

void close(std::ostream& out, int depth, const char* name) {
  out << std::string(2 * static_cast<std::size_t>(depth), ' ') << "</" << name << ">\n";
}

const char* connector_kind(Role role) {
  switch (role) {
    case Role::kInput:
      return "input";
    case Role::kOutput:
      return "output";
    default:
      return "parameter";
  }
}

const char* connector_type(Kind kind) {
  switch (kind) {
    case Kind::kReal:
      return "ssc:Real";
    case Kind::kInteger:
      return "ssc:Integer";
    case Kind::kBoolean:
      return "ssc:Boolean";
    case Kind::kString:
      return "ssc:String";
  }
  return "";
}

/// Names of the connectors for `count` elements of a variable.
std::vector<std::string> connectors_of(const Variable& variable, std::size_t first, std::size_t count, bool scalars) {
  if (count == variable.size() && (count == 1 || !scalars)) return {variable.name};
  std::vector<std::string> names;
  for (std::size_t i = first; i < first + count; ++i) names.push_back(variable.name + "[" + std::to_string(i + 1) + "]");
  return names;
}

class Writer {
 public:
  Writer(const Scenario& scenario, const std::vector<Member>& members, const std::vector<ResolvedConnection>& links,
         const std::vector<PackedComponent>& components, bool scalars)
      : scenario_(scenario), members_(members), links_(links), components_(components), scalars_(scalars) {}

  std::string write() {
    out_ << "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
    Tag(out_, 0, "ssd:SystemStructureDescription")
        .with("xmlns:ssd", ssp::kSsd)
        .with("xmlns:ssc", ssp::kSsc)
        .with("xmlns:oms", "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd")
        .with("xmlns:osp", "http://opensimulationplatform.com/SSP/OSPAnnotations")
        .with("version", "1.0")
        .with("name", scenario_.name)
        .with("generationTool", "cotwin")
        .open();
    Tag(out_, 1, "ssd:System").with("name", scenario_.name.empty() ? "system" : scenario_.name).open();
    if (!members_.empty()) {
      Tag(out_, 2, "ssd:Elements").open();
      for (std::size_t m = 0; m < members_.size(); ++m) write_component(m);
      close(out_, 2, "ssd:Elements");
    }
    if (!links_.empty()) {
      Tag(out_, 2, "ssd:Connections").open();
      for (const ResolvedConnection& link : links_) write_connections(link);
      close(out_, 2, "ssd:Connections");
    }
    Tag(out_, 2, "ssd:Annotations").open();
    write_openmodelica();
    write_annotation();
    close(out_, 2, "ssd:Annotations");
    close(out_, 1, "ssd:System");
    write_measures();
    Tag(out_, 1, "ssd:DefaultExperiment")
        .with("startTime", scenario_.start.seconds())
        .with("stopTime", scenario_.stop.seconds())
        .open();
    Tag(out_, 2, "ssd:Annotations").open();
    begin_osp(3);
    Tag(out_, 4, "osp:Algorithm").open();
    Tag(out_, 5, "osp:FixedStepAlgorithm").with("baseStepSize", scenario_.tick.seconds()).end();
    close(out_, 4, "osp:Algorithm");
    close(out_, 3, "ssc:Annotation");
    close(out_, 2, "ssd:Annotations");
    close(out_, 1, "ssd:DefaultExperiment");
    close(out_, 0, "ssd:SystemStructureDescription");
    return out_.str();
  }

 private:
  void write_component(std::size_t m) {
    const Member& member = members_[m];
    Tag(out_, 3, "ssd:Component")
        .with("name", member.name())
        .with("type",
              components_[m].source.starts_with("unit:") ? "application/x-cotwin-unit" : "application/x-fmu-sharedlibrary")
        .with("source", components_[m].source)
        .with_if(member.spec.implementation != fmu::InterfaceChoice::kAny, "implementation",
                 text::word_of(member.spec.implementation, kImplementationWords))
        .open();
    Tag(out_, 4, "ssd:Connectors").open();
    for (const Variable& v : member.variables()) {
      const auto write = [&](const std::string& name) {
        const std::ptrdiff_t element = find_element(member.variables(), name).element;
        write_connector(name, v,
                        components_[m].foreign ? "" : v.si_of(static_cast<std::size_t>(std::max<std::ptrdiff_t>(element, 0))));
      };
      std::set<std::string> linked = linked_connectors(v);
      for (const std::string& name : connectors_of(v, 0, v.size(), scalars_ || v.mixed())) {
        const bool is_linked = linked.erase(name) != 0, has_value = components_[m].valued.count(name) != 0;
        // FMPy stops at an output that is no number and connects inputs without a connection; openMCx stops at parameters without a value.
        const bool is_output = v.role == Role::kOutput && v.kind() != Kind::kString;
        if (is_linked || is_output || (has_value && v.role != Role::kState)) write(name);
      }
      std::for_each(linked.begin(), linked.end(), write);  // elements of an array
    }
    close(out_, 4, "ssd:Connectors");
    if (!components_[m].values.empty()) {
      Tag(out_, 4, "ssd:ParameterBindings").open();
      Tag(out_, 5, "ssd:ParameterBinding").open();
      Tag(out_, 6, "ssd:ParameterValues").open();
      out_ << components_[m].values;
      close(out_, 6, "ssd:ParameterValues");
      close(out_, 5, "ssd:ParameterBinding");
      close(out_, 4, "ssd:ParameterBindings");
    }
    if (member.spec.period > 1) {
      Tag(out_, 4, "ssd:Annotations").open();
      begin_osp(5);
      Tag(out_, 6, "osp:StepSizeHint").with("value", static_cast<double>(member.spec.period) * scenario_.tick.seconds()).end();
      close(out_, 5, "ssc:Annotation");
      close(out_, 4, "ssd:Annotations");
    }
    close(out_, 3, "ssd:Component");
  }

  std::set<std::string> linked_connectors(const Variable& variable) const {
    std::set<std::string> names;
    for (const ResolvedConnection& link : links_) {
      for (const Signal* end : {&link.from, &link.to}) {
        if (end->variable == &variable) names.merge(set_of(connectors_of(variable, end->first, end->count, scalars(link))));
      }
    }
    return names;
  }
  /// Whether FMUs have elements in place of the vectors that it connects (fmu::describe).
  bool scalars(const ResolvedConnection& link) const {
    return scalars_ || link.from.variable->mixed() || link.to.variable->mixed();
  }
  static std::set<std::string> set_of(const std::vector<std::string>& names) { return {names.begin(), names.end()}; }

  void begin_osp(int depth) { Tag(out_, depth, "ssc:Annotation").with("type", "com.opensimulationplatform").open(); }

  /// OMSimulator reads a system's first annotation only.
  void write_openmodelica() {
    Tag(out_, 3, "ssc:Annotation").with("type", "org.openmodelica").open();
    Tag(out_, 4, "oms:Annotations").open();
    Tag(out_, 5, "oms:SimulationInformation").open();
    Tag(out_, 6, "oms:FixedStepMaster")
        .with("description", "oms-ma")
        .with("stepSize", scenario_.tick.seconds())
        .with("relativeTolerance", 1e-4)  // its default; without the attribute it is 0
        .end();
    close(out_, 5, "oms:SimulationInformation");
    close(out_, 4, "oms:Annotations");
    close(out_, 3, "ssc:Annotation");
  }

  void write_connector(const std::string& name, const Variable& variable, const std::string& measure) {
    Tag(out_, 5, "ssd:Connector").with("name", name).with("kind", connector_kind(variable.role)).open();
    Tag(out_, 6, connector_type(variable.kind())).with_if(!measure.empty(), "unit", measure).end();
    close(out_, 5, "ssd:Connector");
    if (!measure.empty()) measures_.insert(measure);
  }

  void write_connections(const ResolvedConnection& link) {
    const auto from = connectors_of(*link.from.variable, link.from.first, link.from.count, scalars(link));
    const auto to = connectors_of(*link.to.variable, link.to.first, link.to.count, scalars(link));
    const bool affine = link.factor != 1 || link.offset != 0;
    for (std::size_t i = 0; i < from.size(); ++i) {
      Tag tag(out_, 3, "ssd:Connection");
      tag.with("startElement", members_[link.from.member].name()).with("startConnector", from[i]);
      tag.with("endElement", members_[link.to.member].name()).with("endConnector", to[i]);
      tag.with_if(affine || link.suppress_unit_conversion, "suppressUnitConversion", "true");
      if (!affine) {
        tag.end();
        continue;
      }
      tag.open();
      Tag(out_, 4, "ssc:LinearTransformation").with("factor", link.factor).with("offset", link.offset).end();
      close(out_, 3, "ssd:Connection");
    }
  }

  void write_measures() {
    if (measures_.empty()) return;
    static constexpr const char* kBases[] = {"kg", "m", "s", "A", "K", "mol", "cd", "rad"};
    Tag(out_, 1, "ssd:Units").open();
    for (const std::string& name : measures_) {
      const si::Measure measure = si::parse(name);
      Tag(out_, 2, "ssc:Unit").with("name", name).open();
      Tag base(out_, 3, "ssc:BaseUnit");
      for (std::size_t i = 0; i < measure.exponents.size(); ++i) {
        if (measure.exponents[i] != 0) base.with(kBases[i], measure.exponents[i]);
      }
      if (measure.factor != 1) base.with("factor", measure.factor);
      if (measure.offset != 0) base.with("offset", measure.offset);
      base.end();
      close(out_, 2, "ssc:Unit");
    }
    close(out_, 1, "ssd:Units");
  }

  void write(const ToolSpec& tool) {
    const std::string components = text::joined(tool.components, " ");
    Tag tag(out_, 5, "cotwin:Event");
    tag.with("time", tool.time.seconds()).with(tool.attach ? "attach" : "detach", tool.name);
    if (tool.attach) {
      tag.with("parent", tool.parent)
          .with("xyz", text::joined(tool.xyz))
          .with("rpy", text::joined(tool.rpy))
          .with("mass", tool.mass)
          .with("com", text::joined(tool.com))
          .with("inertia", text::joined(tool.inertia))
          .with_if(!tool.known, "known", "false");
    }
    tag.with_if(!tool.robot.empty(), "robot", tool.robot)
        .with_if(!components.empty(), "components", components)
        .with_if(!tool.scope.empty(), "scope", tool.scope)
        .with_if(!tool.reason.empty(), "reason", tool.reason);
    if (tool.frames.empty()) return tag.end();
    tag.open();
    for (const ToolSpec::Frame& frame : tool.frames)
      Tag(out_, 6, "cotwin:Frame")
          .with("name", frame.name)
          .with("xyz", text::joined(frame.xyz))
          .with("rpy", text::joined(frame.rpy))
          .end();
    close(out_, 5, "cotwin:Event");
  }

  void write_clock() {
    const ClockSpec& clock = scenario_.clock;
    if (clock.kind == ClockKind::kFree) return;
    const ClockSpec plain;
    std::string cpus;
    for (const int cpu : clock.cpus) text::append(cpus, std::to_string(cpu), " ");
    Tag(out_, 5, "cotwin:Clock")
        .with("kind", text::word_of(clock.kind, kClockWords))
        .with_if(!clock.component.empty(), "component", clock.component)
        .with_if(clock.overrun != plain.overrun, "overrun", text::word_of(clock.overrun, kOverrunWords))
        .with_if(clock.late != plain.late, "late", text::to_text(clock.late.seconds()))
        .with_if(clock.silence != plain.silence, "silence", text::word_of(clock.silence, kSilenceWords))
        .with_if(clock.timeout != plain.timeout, "timeout", text::to_text(clock.timeout.seconds()))
        .with_if(clock.cycle != plain.cycle, "cycle", text::to_text(clock.cycle.seconds()))
        .with_if(clock.shift != plain.shift, "shift", text::to_text(clock.shift.seconds()))
        .with_if(clock.bandwidth != plain.bandwidth, "bandwidth", text::to_text(clock.bandwidth))
        .with_if(clock.within != plain.within, "within", text::to_text(clock.within.seconds()))
        .with_if(clock.priority != 0, "priority", std::to_string(clock.priority))
        .with_if(!cpus.empty(), "cpu", cpus)
        .end();
  }

  void write_annotation() {
    Tag(out_, 3, "ssc:Annotation").with("type", kAnnotationType).open();
    Tag(out_, 4, "cotwin:Master")
        .with("xmlns:cotwin", kAnnotationSpace)
        .with("tick", scenario_.tick.seconds())
        .with("threads", scenario_.threads)
        .with("tolerance", scenario_.tolerance)
        .with("coupling", text::word_of(scenario_.coupling, kCouplingWords))
        .with("unknownParameters", scenario_.ignore_unknown_parameters ? "ignore" : "error")
        .open();
    write_clock();
    for (const Member& member : members_) {
      Tag(out_, 5, "cotwin:Component")
          .with("name", member.name())
          .with("stage", member.spec.stage)
          .with("period", member.spec.period)
          .with_if(!member.spec.threads, "threads", "false")
          .with_if(member.spec.beside, "beside", "true")
          .with_if(member.spec.process != fmu::ProcessChoice::kAuto, "process",
                   text::word_of(member.spec.process, fmu::kProcessWords))
          .end();
    }
    for (const EventSpec& e : scenario_.events) {
      Tag(out_, 5, "cotwin:Event")
          .with("time", e.time.seconds())
          .with("variable", e.variable)
          .with("value", e.value)
          .with("ramp", e.ramp.seconds())
          .end();
    }
    for (const ToolSpec& tool : scenario_.tools) write(tool);
    Tag(out_, 5, "cotwin:Recording")
        .with("decimation", scenario_.decimation)
        .with_if(scenario_.all_outputs && !scenario_.recording.empty(), "outputs", "true")
        .open();
    for (const RecordSpec& r : scenario_.recording) Tag(out_, 6, "cotwin:Record").with("variables", r.variables).end();
    close(out_, 5, "cotwin:Recording");
    for (const ComparisonSpec& c : scenario_.comparisons) {
      Tag tag(out_, 5, "cotwin:Comparison");
      tag.with("name", c.name).with("a", c.a).with("b", c.b).with("segments", c.segments);
      if (c.from) tag.with("from", c.from->seconds());
      if (c.to) tag.with("to", c.to->seconds());
      tag.end();
    }
    for (const ReportSpec& r : scenario_.reports) {
      Tag(out_, 5, "cotwin:Report")
          .with("name", r.name)
          .with("kind", text::word_of(r.kind, kReportWords))
          .with("a", r.a)
          .with_if(!r.b.empty(), "b", r.b)
          .end();
    }
    for (const BondSpec& b : scenario_.bonds) {
      Tag(out_, 5, "cotwin:Bond")
          .with("name", b.name)
          .with("effortA", b.effort_a)
          .with("flowA", b.flow_a)
          .with("effortB", b.effort_b)
          .with("flowB", b.flow_b)
          .with("tolerance", b.tolerance)
          .with("reference", b.reference)
          .end();
    }
    close(out_, 4, "cotwin:Master");
    close(out_, 3, "ssc:Annotation");
  }

  const Scenario& scenario_;
  const std::vector<Member>& members_;
  const std::vector<ResolvedConnection>& links_;
  const std::vector<PackedComponent>& components_;
  bool scalars_;
  std::set<std::string> measures_;  // of the connectors
  std::ostringstream out_;
};

}  // namespace

std::string to_ssd(const Scenario& scenario, const std::vector<Member>& members, const std::vector<ResolvedConnection>& links,
                   const std::vector<PackedComponent>& components, bool scalars) {
  return Writer(scenario, members, links, components, scalars).write();
}

}  // namespace cotwin::master
