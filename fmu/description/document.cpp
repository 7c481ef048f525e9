#include "fmu/description/document.h"

#include "models/foundation/formats/xml.h"
#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace {

std::string range(const Numeric& n) {
  if (!n.min && !n.max) return "";
  return (n.min ? text::to_text(*n.min) : "") + " … " + (n.max ? text::to_text(*n.max) : "");
}

}  // namespace

std::string document(const ModelDescription& d, const std::string& settings) {
  const std::string name = xml::escaped(d.model_name);
  std::string html =
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head><meta charset=\"utf-8\"><title>" + name + "</title></head>\n<body>\n";
  html += "<h1>" + name + "</h1>\n<p>" + xml::escaped(d.description) + "</p>\n";
  html += "<p>A Cotwin unit for FMI " + std::string(d.version == Version::k2 ? "2.0" : "3.0") + " Co-Simulation";
  html += settings.empty() ? ".</p>\n" : ", made with the settings <code>" + xml::escaped(settings) + "</code>.</p>\n";
  html +=
      "<table border=\"1\">\n<tr><th>variable</th><th>size</th><th>causality</th><th>variability</th><th>unit</th>"
      "<th>range</th><th>meaning</th></tr>\n";
  for (const ModelVariable& v : d.variables) {
    std::string size;
    for (const Dimension& dimension : v.dimensions) {
      if (dimension.size) size += (size.empty() ? "" : " × ") + std::to_string(*dimension.size);
    }
    html += "<tr>";
    for (const std::string& cell :
         {xml::escaped(v.name), size, std::string(name_of(v.causality)), std::string(name_of(v.variability)),
          xml::escaped(v.numeric.unit), range(v.numeric), xml::escaped(v.description)}) {
      html += "<td>" + cell + "</td>";
    }
    html += "</tr>\n";
  }
  return html + "</table>\n</body>\n</html>\n";
}

}  // namespace cotwin::fmu
