#pragma once
#include "master/scenario/scenario.h"
#include "models/foundation/formats/xml.h"

/// Our annotation in a system structure: settings of the run that SSP does not define. docs/scenario.md lists its elements.
namespace cotwin::master {

constexpr const char* kAnnotationType = "cotwin.master";
constexpr const char* kAnnotationSpace = "urn:cotwin:master:1";

/// Reads an attribute that is a duration in s, at least `min`. Throws Error also if it is not a whole number of nanoseconds.
Duration read_duration(const xml::Element& e, const char* name, double min);

/// Returns the cotwin:Master element of an SSD, or nullptr. It is in an ssc:Annotation of the type above, at the document's
/// root, at its root system or in its DefaultExperiment. Throws Error for a second one and for one in another place.
const xml::Element* find_annotation(const xml::Element& document);

/// Reads the annotation into a scenario that already has its components. Throws Error for unknown elements, attributes and
/// components and for values out of range.
void read_annotation(const xml::Element& annotation, Scenario& scenario);

/// Reads an Event with the attribute `variable`. `index`: of the scenario.
EventSpec read_change(const xml::Element& event, const Scenario& scenario, const ComponentIndex& index);

/// Reads an Event with the attribute `attach` or `detach`. A tool's relative file is looked up in `folder`.
ToolSpec read_tool(const xml::Element& event, const std::filesystem::path& folder);

/// Reads the annotation of a nested document, which is the component `scope` of the scenario. Its settings of components,
/// events, recording, comparisons, bonds and reports are added to the scenario, with names that begin with `scope`. Its
/// settings apply only to its own components. Relative files are looked up in `folder`. Must be called before read_annotation()
/// of the scenario's own annotation, which takes precedence. Returns the nested scenario by itself.
Scenario read_nested_annotation(const xml::Element& annotation, const std::string& scope, const std::filesystem::path& folder,
                                Scenario& scenario);
/// Returns the attributes of a nested annotation that concern the whole run and differ from the scenario's: "tick, clock" or
/// "".
std::string unused_of_nested(const xml::Element& annotation, const Scenario& nested, const Scenario& scenario);

}  // namespace cotwin::master
