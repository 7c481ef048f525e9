#pragma once
#include <cstddef>
#include <string>
#include <string_view>

/// What text may be in an XML document; without a parser, so that exported units can check names.
namespace cotwin::xml {

/// Index of the first byte that is not part of UTF-8 text with only characters that XML 1.0 allows (clause 2.2), or npos.
std::size_t first_not_allowed(std::string_view text);

/// Why `text` is not UTF-8, with the command that converts it: "UTF-16 text, expected UTF-8: iconv -f UTF-16 -t UTF-8", or its first byte that is
/// not UTF-8, with the encoding that the XML declaration of `document` names; "" if it is.
std::string why_not_utf8(std::string_view text, std::string_view document);

/// Whether `text` is UTF-8 with only characters that XML 1.0 allows.
bool is_xml_text(std::string_view text);

/// Index of the first tag with more than `most` quoted values, or npos: for parsers whose time grows with the square of the number of
/// attributes. The text need not be well-formed.
std::size_t first_tag_with_more_attributes(std::string_view text, std::size_t most);

}  // namespace cotwin::xml
