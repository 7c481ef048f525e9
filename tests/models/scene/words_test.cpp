// docs/formats.md: each of its words once, in a file that is right without it.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <tinyxml2.h>

#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "models/foundation/support/error.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/sdf/sdf.h"
#include "models/scene/urdf/urdf_shapes.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::scene::words_test {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using tinyxml2::XMLElement;
using Warnings = std::vector<std::string>;

struct Row {
  std::string word, example, outcome;
};

std::vector<Row> rows(const std::string& section) {
  std::ifstream in(places::source() + "/docs/formats.md");
  std::vector<Row> rows;
  bool inside = false;
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with("## ")) inside = line == "## " + section;
    if (!inside || !line.starts_with("| ") || line.starts_with("| word")) continue;
    std::vector<std::string> cells;
    std::istringstream cut(line.substr(1));
    for (std::string cell; std::getline(cut, cell, '|');) {
      const std::size_t from = cell.find_first_not_of(" `"), to = cell.find_last_not_of(" `");
      cells.push_back(from == std::string::npos ? "" : cell.substr(from, to - from + 1));
    }
    const std::string outcome = cells.at(2).substr(0, cells.at(2).find_first_of(":,"));
    if (outcome != "noted") {
      rows.push_back({cells.at(0), cells.at(1), outcome});
      continue;
    }
    // A word that is only noted although it would change something says why.
    const std::size_t second = cells.at(1).starts_with("– `") ? 0 : cells.at(1).find("` `");
    if (second == std::string::npos || cells.at(2) == "noted") {
      ADD_FAILURE() << line << ": expected two examples, and a reason";
      continue;
    }
    const std::string neutral = cells.at(1).substr(0, second);
    rows.push_back({cells.at(0), neutral, outcome});
    rows.push_back({cells.at(0), cells.at(1).substr(cells.at(1).find('`', second + 1) + 1),
                    cells.at(2) == "noted, refused" ? "refused" : outcome});
  }
  return rows;
}

/// The text with the word of a row: the path's elements are found or made; "@a=b c" is the attribute a of the last one, then its content.
std::string with(const std::string& text, const Row& row) {
  tinyxml2::XMLDocument document;
  if (document.Parse(text.c_str()) != tinyxml2::XML_SUCCESS) throw Error("test", "XML");
  std::string path = row.word, attribute;
  if (const std::size_t at = path.find('@'); at != std::string::npos) {
    attribute = path.substr(at + 1);
    path.resize(at);
  }
  XMLElement* here = document.RootElement();
  std::istringstream names(path);
  std::vector<std::string> all;
  for (std::string name; std::getline(names, name, '/');) all.push_back(name);
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (i == 0 && all[i] == here->Name()) continue;
    XMLElement* next = here->FirstChildElement(all[i].c_str());
    if (next == nullptr) {
      next = document.NewElement(all[i].c_str());
      here->InsertEndChild(next);
    }
    here = next;
  }
  if (!attribute.empty()) {
    here->SetAttribute(attribute.c_str(), row.example.c_str());
  } else {
    std::string content = row.example;
    if (content.starts_with("@")) {
      const std::size_t equals = content.find('=');
      std::size_t end = content.size();
      // The content begins with a number or an element after a value without one; a value alone may have blanks.
      if (const std::size_t blank = content.find(' '); blank != std::string::npos && content.substr(1, 3) != "xyz") end = blank;
      here->SetAttribute(content.substr(1, equals - 1).c_str(), content.substr(equals + 1, end - equals - 1).c_str());
      content = end < content.size() ? content.substr(end + 1) : "";
    }
    tinyxml2::XMLDocument inner;
    if (content.starts_with("<")) {
      inner.Parse(("<x>" + content + "</x>").c_str());
      for (XMLElement* c = inner.RootElement()->FirstChildElement(); c != nullptr; c = c->NextSiblingElement())
        here->InsertEndChild(c->DeepClone(&document));
    } else if (!content.empty()) {
      here->SetText(content.c_str());
    }
  }
  tinyxml2::XMLPrinter printer;
  document.Print(&printer);
  return printer.CStr();
}

/// What is read, or nothing where it is refused.
template <class Read>
void expect_outcomes(const std::string& section, const std::string& base, std::size_t least, Read read) {
  const std::vector<Row> all = rows(section);
  ASSERT_GE(all.size(), least);
  Warnings none;
  const auto plain = read(base, none);
  ASSERT_TRUE(plain);
  EXPECT_THAT(none, ::testing::ElementsAre());
  for (const Row& row : all) {
    SCOPED_TRACE(row.word + " " + row.example);
    Warnings warnings;
    const auto found = read(with(base, row), warnings);
    const std::string word = row.word.substr(row.word.find_last_of("/@") + 1);
    EXPECT_EQ(!found, row.outcome == "refused") << (warnings.empty() ? "" : warnings.back());
    if (!found) {
      EXPECT_THAT(warnings, Contains(HasSubstr(":")));
      continue;
    }
    EXPECT_EQ(!warnings.empty(), row.outcome == "noted") << (warnings.empty() ? "silent" : warnings.back());
    if (row.outcome == "noted") {
      EXPECT_THAT(warnings, Contains(HasSubstr(word)));
    } else {
      EXPECT_EQ(*found == *plain, row.outcome == "others");
    }
  }
}

TEST(Words, OfAUrdfAreReadNotedOrRefused) {
  const cotwin::testing::TemporaryFolder folder("words");
  const std::string base = R"(<robot name="r"><link name="arm">
<inertial><origin/><mass value="2"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.15" iyz="0" izz="0.2"/></inertial>
<collision name="c"><origin/><geometry><box size="1 1 1"/></geometry></collision></link><link name="base"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><limit lower="-1" upper="1" effort="4" velocity="3"/></joint></robot>)";
  using Read = std::pair<robot::RobotModel, std::vector<std::vector<Shape>>>;
  const auto load = [&](const std::string& text, Warnings& warnings, const std::string& unphysical) -> std::optional<Read> {
    const auto file = folder.write("robot.urdf", text);
    try {
      robot::UrdfOptions options;
      robot::take_unphysical(unphysical, options);
      robot::RobotModel model = robot::load_urdf(file, options, &warnings);
      std::vector<std::vector<Shape>> shapes = shapes_of_urdf(file, model, &warnings);
      if (text.find("<si") != std::string::npos) model.name += " in SI";
      return Read{std::move(model), std::move(shapes)};
    } catch (const Error& error) {
      warnings.emplace_back(error.what());
      return {};
    }
  };
  // A joint of a mimic's name would need a leader: those rows have their own file.
  const std::string follower = base.substr(0, base.rfind("</robot>")) + R"(<link name="b"><inertial><mass value="1"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link></robot>)";
  const std::string joint = R"(<joint name="follows" type="revolute"><mimic joint="turn"/><parent link="base"/><child link="b"/>
<axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="4" velocity="3"/></joint>)";
  const auto read = [&](const std::string& text, Warnings& warnings) {
    if (const std::size_t at = text.find("<mimic"); at != std::string::npos) {
      const std::string attribute = text.substr(at, text.find("/>", at) - at);
      std::string whole = follower;
      std::string own = joint;
      own.replace(own.find("<mimic"), 6, attribute);
      whole.insert(whole.rfind("</robot>"), own);
      return load(whole, warnings, "error");
    }
    return load(text, warnings, "error");
  };
  expect_outcomes("URDF 1.2", base, 55, read);
  // What is refused is ignored on request, with line and word, and by nothing else.
  Warnings warnings;
  for (const Row& row : rows("URDF 1.2")) {
    SCOPED_TRACE(row.word + " " + row.example);
    if (row.outcome != "refused" || row.word == "robot@version" || row.word.find("mimic") != std::string::npos) continue;
    if (row.word.find("collision") != std::string::npos) continue;  // of shapes; who sees them (view) reads them otherwise
    EXPECT_FALSE(load(with(base, row), warnings, "estimate"));
    EXPECT_TRUE(load(with(base, row), warnings, "warn"));
    EXPECT_THAT(warnings.back(), HasSubstr("ignored"));
  }
  ASSERT_TRUE(load(with(base, {"robot/joint/axes", "@xyz=0 1 0", ""}), warnings, "warn"));
  EXPECT_THAT(warnings, Contains(HasSubstr("joint 'turn': 'axes' in <joint> is not read, did you mean 'axis'?; ignored")));
  // Both rotations, or none of length 1.
  for (const char* attributes : {R"(rpy="0 0 0" quat_xyzw="0 0 0 1")", R"(quat_xyzw="0 0 0 0")", R"(quat_xyzw="0 0 1")"}) {
    for (const char* owner : {"<collision name=\"c\"><origin", "<inertial><origin"}) {
      std::string text = base;
      text.insert(text.find(owner) + std::string(owner).size(), std::string(" ") + attributes);
      Warnings why;
      EXPECT_FALSE(load(text, why, "error")) << text;
    }
  }
}

TEST(Words, OfAnSdfAreReadNotedOrRefused) {
  const std::string base = R"(<sdf version="1.11"><world name="w"><gravity>0 0 -9</gravity>
<model name="m"><link name="a"><inertial><mass>2</mass><inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.1</izz></inertia></inertial>
<collision name="c"><geometry><sphere><radius>0.1</radius></sphere></geometry><surface><friction><torsional/></friction></surface>
</collision></link><link name="b"><pose>0 0 1 0.3 0.2 0.1</pose>
<inertial><mass>2</mass><inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.1</izz></inertia></inertial>
<collision name="c"><geometry><sphere><radius>0.1</radius></sphere></geometry></collision></link>
<joint name="j" type="revolute"><pose>0 0 0 0.5 0.4 0.3</pose><parent>world</parent><child>a</child><axis><xyz>1 0 0</xyz></axis></joint>
</model></world></sdf>)";
  expect_outcomes("SDF 1.11", base, 80, [](const std::string& text, Warnings& warnings) -> std::optional<Scene> {
    // The version that still had it; gravity of the world would be in force before that of <physics>.
    std::string older = text;
    if (text.find("<physics>") != std::string::npos && text.find("<max_step") == std::string::npos) {
      const std::size_t from = older.find("<gravity>0 0 -9</gravity>");
      if (from != std::string::npos) older.erase(from, 25);
    }
    try {
      return parse_sdf(older, "scene.sdf", &warnings);
    } catch (const Error& error) {
      warnings.emplace_back(error.what());
      return {};
    }
  });
  const auto gravity_of = [](const std::string& inside) {
    return parse_sdf("<sdf version=\"1.5\"><world name=\"w\">" + inside + "</world></sdf>", "scene.sdf").gravity;
  };
  EXPECT_EQ(gravity_of("<physics type=\"ode\"><gravity>0 0 -1</gravity></physics>"), Eigen::Vector3d(0, 0, -1));
  EXPECT_EQ(gravity_of("<physics><gravity>0 0 -1</gravity></physics><gravity>0 0 -2</gravity>"), Eigen::Vector3d(0, 0, -2));
}

}  // namespace
}  // namespace cotwin::scene::words_test
