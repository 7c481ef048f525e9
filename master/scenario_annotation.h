#pragma once
#include "master/scenario.h"
#include "models/text/xml.h"

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

}  // namespace cotwin::master
