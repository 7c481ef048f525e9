#pragma once
#include <cstddef>
#include <string_view>

/// What text may be in an XML document; without a parser, so that exported units can check names.
namespace cotwin::xml {

/// Index of the first byte that is not part of UTF-8 text with only characters that XML 1.0 allows (clause 2.2), or npos.
std::size_t first_not_allowed(std::string_view text);

/// Whether `text` is UTF-8 with only characters that XML 1.0 allows.
bool is_xml_text(std::string_view text);

}  // namespace cotwin::xml
