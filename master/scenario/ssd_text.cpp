#include "master/scenario/ssd_text.h"

#include "master/scenario/system.h"
#include "models/foundation/formats/xml.h"

namespace cotwin::master {

namespace {

std::string attribute(const char* name, const std::string& value) {
  return std::string(" ") + name + "=\"" + xml::escaped(value) + "\"";
}

std::string comment_line(const std::string& comment) { return comment.empty() ? "" : "      <!-- " + comment + " -->\n"; }

}  // namespace

SsdText::SsdText(std::string name, std::string system, std::string introduction, std::string tick)
    : name_(std::move(name)), system_(std::move(system)), introduction_(std::move(introduction)), tick_(std::move(tick)) {}

void SsdText::component(const std::string& name, const std::string& source, const std::vector<std::string>& files,
                        const Values& values, const std::string& comment) {
  elements_ += comment_line(comment) + "      <ssd:Component" + attribute("name", name) + attribute("source", source) +
               " type=\"application/x-cotwin-unit\"";
  if (files.empty() && values.empty()) {
    elements_ += "/>\n";
    return;
  }
  elements_ += ">\n        <ssd:ParameterBindings>\n";
  for (const std::string& file : files) elements_ += "          <ssd:ParameterBinding" + attribute("source", file) + "/>\n";
  if (!values.empty()) {
    elements_ +=
        "          <ssd:ParameterBinding>\n            <ssd:ParameterValues>\n              <ssv:ParameterSet version=\"1.0\"" +
        attribute("name", name) + ">\n                <ssv:Parameters>\n";
    for (const auto& [variable, value] : values)
      elements_ += "                  <ssv:Parameter" + attribute("name", variable) + "><ssv:String" +
                   attribute("value", value) + "/></ssv:Parameter>\n";
    elements_ +=
        "                </ssv:Parameters>\n              </ssv:ParameterSet>\n            </ssd:ParameterValues>\n"
        "          </ssd:ParameterBinding>\n";
  }
  elements_ += "        </ssd:ParameterBindings>\n      </ssd:Component>\n";
}

void SsdText::connect(const std::string& from, const std::string& output, const std::string& to, const std::string& input) {
  connections_ += "      <ssd:Connection" + attribute("startElement", from) + attribute("startConnector", output) +
                  attribute("endElement", to) + attribute("endConnector", input) + "/>\n";
}

void SsdText::connect(const std::string& from, const std::string& to, std::initializer_list<const char*> names) {
  for (const char* name : names) connect(from, name, to, name);
}

void SsdText::comment_connections(const std::string& comment) { connections_ += comment_line(comment); }

void SsdText::annotate(const std::string& line) { annotation_ += "        " + line + "\n"; }

std::string SsdText::text(const std::string& stop) const {
  return "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n" + (introduction_.empty() ? "" : "<!--\n" + introduction_ + "-->\n") +
         "<ssd:SystemStructureDescription version=\"1.0\"" + attribute("name", name_) + "\n   " +
         attribute("xmlns:ssd", ssp::kSsd) + "\n   " + attribute("xmlns:ssc", ssp::kSsc) + "\n   " +
         attribute("xmlns:ssv", ssp::kSsv) + ">\n  <ssd:System" + attribute("name", system_) + ">\n    <ssd:Elements>\n" +
         elements_ + "    </ssd:Elements>\n    <ssd:Connections>\n" + connections_ +
         "    </ssd:Connections>\n  </ssd:System>\n  <ssd:DefaultExperiment startTime=\"0\"" + attribute("stopTime", stop) +
         "/>\n  <ssd:Annotations>\n    <ssc:Annotation type=\"cotwin.master\">\n      <cotwin:Master" +
         attribute("xmlns:cotwin", "urn:cotwin:master:1") + attribute("tick", tick_) + ">\n" + annotation_ +
         "      </cotwin:Master>\n    </ssc:Annotation>\n  </ssd:Annotations>\n</ssd:SystemStructureDescription>\n";
}

}  // namespace cotwin::master
