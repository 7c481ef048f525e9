#pragma once
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "models/bag/cdr.h"

namespace cotwin::bag {

/// The type of a topic's messages, by its definition as ros2msg (docs.ros.org, Interfaces): what their bytes mean.
class Definition {
 public:
  /// `text`: "": one that is built in. Throws Fault for a type that is not known, or has members that cannot be read.
  Definition(const std::string& type, const std::string& text);

  /// Whether it begins with a std_msgs/Header.
  bool has_header() const { return has_header_; }
  /// Appends all numbers of a message, without its header, and adds their names: "force.x", "data[3]" (from 0). A member that is alone beside the header
  /// gives no name: "force.x" of a WrenchStamped. Strings are passed over. Returns a number that is the same for messages whose sequences have the same
  /// lengths. Throws Fault.
  std::uint64_t read(Cdr& message, std::vector<double>& values, std::vector<std::string>* names = nullptr) const;

 private:
  using Number = double (*)(Cdr& message);
  enum class Array { kNone, kFixed, kSequence };
  struct Member {
    std::string name, type;   // "string", or that of a nested one
    Number number = nullptr;  // of one that is a number
    Array array = Array::kNone;
    std::size_t length = 0, nested = 0;  // of a fixed array; index in types_
    bool is_message() const { return number == nullptr && type != "string"; }
  };
  struct Type {
    std::string name;
    std::vector<Member> members;
  };

  static Member member_of(const std::string& type, const std::string& name);
  void parse(const std::string& text, const std::string& type);
  void resolve();
  void read(const Type& type, const std::string& path, Cdr& message, std::vector<double>& values,
            std::vector<std::string>* names, std::uint64_t& shape, int depth) const;

  std::vector<Type> types_;            // the first is the message's own
  std::size_t header_ = 0, body_ = 0;  // indices in types_
  bool has_header_ = false;
};

}  // namespace cotwin::bag
