#pragma once
#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

namespace cotwin::master {

/// Composes a scenario file (SSP 1.0 with our annotation) that people will read and edit: sections may be filled in any order;
/// components and connections may have comments. Names and values are escaped, comments and lines of the annotation are written as they are. For a scenario that exists as a value: master/twin/ssd_write.h.
class SsdText {
 public:
  using Values = std::vector<std::pair<std::string, std::string>>;

  /// `system`: name of the system in it. `introduction`: the comment at the top, whole lines; "": none. `tick`: with its unit, "1 ms".
  SsdText(std::string name, std::string system, std::string introduction, std::string tick);

  /// A unit. `files`: parameter sets (.ssv), relative to the scenario. `values`: start values in the scenario itself, after the files.
  void component(const std::string& name, const std::string& source, const std::vector<std::string>& files,
                 const Values& values, const std::string& comment = "");
  void connect(const std::string& from, const std::string& output, const std::string& to, const std::string& input);
  /// Outputs to inputs of the same names.
  void connect(const std::string& from, const std::string& to, std::initializer_list<const char*> names);
  /// Before the next connection.
  void comment_connections(const std::string& comment);
  /// A line of the annotation, for example a <cotwin:Record …/>.
  void annotate(const std::string& line);

  /// `stop`: time at which the run ends, s.
  std::string text(const std::string& stop) const;

 private:
  std::string name_, system_, introduction_, tick_, elements_, connections_, annotation_;
};

}  // namespace cotwin::master
