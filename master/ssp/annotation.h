#pragma once
#include "master/ssp/scenario.h"
#include "models/support/xml.h"

/// Our annotation in a system structure: what SSP leaves to the master. docs/scenario.md lists its elements.
namespace cotwin::master {

constexpr const char* kAnnotationType = "cotwin.master";
constexpr const char* kAnnotationSpace = "urn:cotwin:master:1";

/// The cotwin:Master element of an SSD, nullptr if it has none. It stands in an ssc:Annotation of the type above at the
/// document's root, at its root system or in its DefaultExperiment. Throws Error for a second one, and for one that stands
/// elsewhere.
const xml::Element* find_annotation(const xml::Element& document);

/// Reads the annotation into a scenario whose components are known. Throws Error for unknown elements, attributes and
/// components and for values out of range.
void read_annotation(const xml::Element& annotation, Scenario& scenario);

/// The annotation of a document that the scenario has as its component `scope`. What it says of its components, its events,
/// recording, comparisons, bonds and reports become the scenario's, with names that begin with `scope`; its settings hold in
/// its components alone. Relative files are looked up in `folder`. To be read before the scenario's own annotation, which wins.
/// Returns it as it would be by itself.
Scenario read_nested_annotation(const xml::Element& annotation, const std::string& scope, const std::filesystem::path& folder,
                                Scenario& scenario);
/// What of a nested annotation belongs to the run, and differs from the scenario's: "tick, clock"; empty if nothing.
std::string unused_of_nested(const xml::Element& annotation, const Scenario& nested, const Scenario& scenario);

}  // namespace cotwin::master
