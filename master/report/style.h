#pragma once

/// The style sheet of pages, page.css. CMake makes these constants of it.
namespace cotwin::report {

extern const char* const kStyle;
extern const char* const kStyleSha256;  // hexadecimal, of the bytes of kStyle

}  // namespace cotwin::report
