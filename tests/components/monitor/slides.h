#pragma once
#include <gtest/gtest.h>

#include <string>

#include "tests/support/files.h"
#include "tests/support/unit_subject.h"

namespace cotwin::monitor {

/// Robots and scenes of balls and a plate, written into a folder.
class Slides : public ::testing::Test {
 protected:
  Slides() {
    const auto link = [](const std::string& name, const std::string& radius) {
      const std::string collision =
          radius.empty() ? "" : "<collision><geometry><sphere radius=\"" + radius + "\"/></geometry></collision>";
      return "<link name=\"" + name +
             "\"><inertial><mass value=\"1\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"1\" ixy=\"0\" ixz=\"0\" "
             "iyz=\"0\"/></inertial>" +
             collision + "</link>";
    };
    // A ball of 0.1 m that slides along x, and one that is fixed to it by a free joint in between.
    const auto robot = [&](const std::string& radius) {
      return "<robot name=\"slide\">" + link("rail", "") + link("ball", radius) + link("arm", "") +
             link("hand", radius.empty() ? "" : "0.05") +
             "<joint name=\"x\" type=\"prismatic\"><parent link=\"rail\"/><child link=\"ball\"/><axis xyz=\"1 0 0\"/><limit "
             "lower=\"-10\" upper=\"10\" "
             "effort=\"1\" velocity=\"1\"/></joint><joint name=\"turn\" type=\"continuous\"><parent link=\"ball\"/><child "
             "link=\"arm\"/><axis xyz=\"0 0 1\"/></joint>"
             "<joint name=\"lift\" type=\"prismatic\"><parent link=\"arm\"/><child link=\"hand\"/><origin xyz=\"0.4 0 "
             "0\"/><axis xyz=\"0 0 1\"/><limit "
             "lower=\"-10\" upper=\"10\" effort=\"1\" velocity=\"1\"/></joint></robot>";
    };
    folder_.write("slide.urdf", robot("0.1"));
    folder_.write("bare.urdf", robot(""));
    const auto model = [](const std::string& name, bool is_static, const std::string& pose, const std::string& geometry) {
      return "<model name=\"" + name + "\"><static>" + (is_static ? "true" : "false") + "</static><pose>" + pose +
             "</pose><link name=\"" + name +
             "\"><inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial><collision "
             "name=\"c\"><geometry>" +
             geometry + "</geometry></collision></link></model>";
    };
    const auto scene = [&](const std::string& models) {
      return "<sdf version=\"1.11\"><world name=\"w\">" + models + "</world></sdf>";
    };
    folder_.write("plate.sdf", scene(model("plate", true, "3 0 0 0 0 0", "<box><size>0.001 8 8</size></box>")));
    const std::string sphere = "<sphere><radius>0.2</radius></sphere>";
    folder_.write("ball.sdf", scene(model("obstacle", false, "2 0.5 0 0 0 0", sphere)));
    folder_.write("comes.sdf",
                  scene(model("crate", true, "3 0 0 0 0 0", sphere) + model("person", false, "0 5 0 0 0 0", sphere)));
    folder_.write("two.sdf", scene(model("one", false, "2 5 0 0 0 0", sphere) + model("other", false, "6 9 0 0 0 0", sphere)));
    folder_.write("crate.sdf", scene(model("crate", true, "3 0 0 0 0 0", "<box><size>0.2 0.4 0.6</size></box>")));
    folder_.write("crates.sdf", scene(model("crate", true, "3 0 0 0 0 0", "<box><size>0.3 0.6 0.9</size></box>")));
  }
  testing::UnitSubject unit(std::string source) const {
    for (std::size_t at; (at = source.find("@")) != std::string::npos;) source.replace(at, 1, folder_.path().string() + "/");
    return testing::UnitSubject(source);
  }
  testing::UnitSubject monitor(const std::string& query) const { return unit("unit:monitor?" + query); }

  testing::TemporaryFolder folder_{"monitor"};
};

}  // namespace cotwin::monitor
