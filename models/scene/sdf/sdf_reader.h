#pragma once
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "models/scene/scene.h"
#include "models/scene/sdf/sdf_link.h"
#include "models/scene/sdf/sdf_values.h"

/// The reader of sdf.h.
namespace cotwin::scene::sdf {

namespace fs = std::filesystem;

constexpr int kNoBody = -2, kWorld = -1, kNoJoint = -1;

/// Names of a model or a world: frames whose poses may depend on each other.
struct Scope {
  struct Frame {
    std::string place;
    std::string relative_to;  // another name of this scope, "" for the scope's own frame
    std::string attached_to;  // of a frame: the frame or link that it moves with
    Pose X;                   // in relative_to
    int body = kNoBody;       // of a link
    int joint = kNoJoint;     // of a joint: index of its first axis
    bool busy = false;        // during the search; detects circular poses
  };
  std::string place;
  std::string prefix;  // prefix of the names of its bodies, "cell.arm."
  Pose X_W;
  bool is_world = false;
  std::map<std::string, Frame> frames;
  std::map<std::string, std::unique_ptr<Scope>> models;
};

class Reader {
 public:
  explicit Reader(std::vector<std::string>* warnings) : warnings_(warnings) {}
  Scene read(std::string_view text, const fs::path& file);

 private:
  struct Document {
    xml::Element root;
    fs::path folder;
  };
  struct Inherited {  // by a model from its parent
    bool is_static = false;
    int depth = 0;
    fs::path folder;
  };

  Document open(std::string_view text, const fs::path& file) const;
  void read_world(const xml::Element& world, Scope& scope, const Inherited& from);
  void read_model(const xml::Element& model, Scope& scope, const Inherited& from);
  void read_parts(const xml::Element& element, Scope& scope, const Inherited& from);
  void read_include(const xml::Element& include, Scope& scope, const Inherited& from);
  void read_links(const xml::Element& model, Scope& scope, const Inherited& from);
  void read_joint(const xml::Element& element, Scope& scope);
  double read_pitch(const xml::Element& element) const;
  void join_by_cross(Joint& first, Joint& second, const Pose& X_WJ);
  void read_frame(const xml::Element& parent, const xml::Element& element, Scope& scope);
  void read_axis(const xml::Element& element, Joint& joint, Scope& scope, const Pose& X_WJ);
  void read_mimics(const xml::Element& element, const Scope& scope);
  void read_gearbox(const xml::Element& element, Scope& scope);
  int find_hinge(int reference, int link, const Eigen::Vector3d& axis_W, double& sign, const xml::Element& gearbox) const;

  void name(Scope& scope, const xml::Element& element, const std::string& fallback);
  Pose pose_of(Scope& scope, const std::string& name, const std::string& place) const;
  int body_of(const Scope& scope, const std::string& name, const std::string& place, int depth = 0) const;
  int joint_of(const Scope& scope, const std::string& name, const std::string& place) const;
  std::string known(const Scope& scope, const std::string& name) const;
  sdf::Warn warn() const {
    return [this](const std::string& place, const std::string& what) {
      if (warnings_ != nullptr) warnings_->push_back(place + ": " + what);
    };
  }

  std::vector<std::string>* const warnings_;
  Scene scene_;
  std::map<int, std::uint32_t> masks_;  // of the bodies with other ones than kAllBits
};

}  // namespace cotwin::scene::sdf
