#pragma once
#include <tinyxml2.h>

#include <string>

namespace cotwin::xml {

/// Reason why a text is not well-formed XML: "missing or mismatched end tag".
inline std::string reason(const tinyxml2::XMLDocument& document) {
  switch (document.ErrorID()) {
    case tinyxml2::XML_ERROR_PARSING_ELEMENT:
      return "an incomplete tag";
    case tinyxml2::XML_ERROR_PARSING_ATTRIBUTE:
      return "an attribute without the form name=\"value\"";
    case tinyxml2::XML_ERROR_PARSING_TEXT:
      return "text without an end tag";
    case tinyxml2::XML_ERROR_PARSING_CDATA:
      return "a CDATA section without ]]>";
    case tinyxml2::XML_ERROR_PARSING_COMMENT:
      return "a comment without -->";
    case tinyxml2::XML_ERROR_PARSING_DECLARATION:
      return "an incomplete declaration <?xml … ?>";
    case tinyxml2::XML_ERROR_PARSING_UNKNOWN:
      return "an incomplete tag <! … >";
    case tinyxml2::XML_ERROR_EMPTY_DOCUMENT:
      return "no element";
    case tinyxml2::XML_ERROR_MISMATCHED_ELEMENT:
      return "missing or mismatched end tag";
    case tinyxml2::XML_ELEMENT_DEPTH_EXCEEDED:
      return "elements nested too deeply";
    default:
      return document.ErrorName();
  }
}

}  // namespace cotwin::xml
