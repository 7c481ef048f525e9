#pragma once
#include <tinyxml2.h>

#include <string>

namespace cotwin::xml {

/// Why a text is no well-formed XML, for people: "an element is not closed by its own name (mismatched element)".
inline std::string reason(const tinyxml2::XMLDocument& document) {
  switch (document.ErrorID()) {
    case tinyxml2::XML_ERROR_PARSING_ELEMENT:
      return "a tag is not finished";
    case tinyxml2::XML_ERROR_PARSING_ATTRIBUTE:
      return "an attribute is not of the form name=\"value\"";
    case tinyxml2::XML_ERROR_PARSING_TEXT:
      return "the text does not end with a tag";
    case tinyxml2::XML_ERROR_PARSING_CDATA:
      return "a CDATA section is not closed by ]]>";
    case tinyxml2::XML_ERROR_PARSING_COMMENT:
      return "a comment is not closed by -->";
    case tinyxml2::XML_ERROR_PARSING_DECLARATION:
      return "the declaration <?xml … ?> is not finished";
    case tinyxml2::XML_ERROR_PARSING_UNKNOWN:
      return "a tag <! … > is not finished";
    case tinyxml2::XML_ERROR_EMPTY_DOCUMENT:
      return "there is no element in it";
    case tinyxml2::XML_ERROR_MISMATCHED_ELEMENT:
      return "an element is closed by another name, or not at all";
    case tinyxml2::XML_ELEMENT_DEPTH_EXCEEDED:
      return "its elements are nested too deeply";
    default:
      return document.ErrorName();
  }
}

}  // namespace cotwin::xml
