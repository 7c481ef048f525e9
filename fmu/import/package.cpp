#include "fmu/import/package.h"

#include <cmath>
#include <utility>

#include "fmu/description/consistency.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/fields.h"

namespace cotwin::fmu {

namespace {

constexpr std::size_t kUsual = 48;                     // bytes of a variable's other texts, start value and dependencies
constexpr std::uint64_t kMagic = 0x344e474645525443u;  // the bytes "CTREFGN4": the format and its version

/// A package whose parts are elsewhere.
struct Parts {
  const std::string &name, &folder;
  const LoadOptions& options;
  const ModelDescription& description;
  const Snapshot& start;
};

/// Throws Error, without a place, for an invalid package.
void check(const ForeignPackage& package) {
  if (!is_file_name(package.folder)) throw Error("'" + package.folder + "', expected the name of a folder");
  const LoadOptions& o = package.options;
  if ((o.stop && !std::isfinite(*o.stop)) || (o.tolerance && !(std::isfinite(*o.tolerance) && *o.tolerance > 0)))
    throw Error("stop time or tolerance not finite, or tolerance not above 0");
  check_all(package.description);
  static_cast<void>(package.interface());
}

}  // namespace

std::string serialise(const ForeignPackage& package) {
  at(package.name, [&] { check(package); });
  return serialise_checked(package.name, package.folder, package.options, package.description, package.start);
}

std::string serialise_checked(const std::string& name, const std::string& folder, const LoadOptions& options,
                              const ModelDescription& description, const Snapshot& start) {
  std::size_t size = 0;  // about, so that the bytes of large descriptions are not copied as they grow
  for (const ModelVariable& v : description.variables)
    size += least_bytes<ModelVariable>() + least_bytes<Unknown>() + v.name.size() + v.description.size() + kUsual;
  std::string buffer;
  buffer.reserve(size);
  ByteWriter out(std::move(buffer));
  const Parts parts{name, folder, options, description, start};
  ForeignPackage::fields(parts, [&](const auto&... members) { Putter(out).put(members...); });
  return sealed(kMagic, out.take());
}

bool is_foreign_package(std::string_view bytes) { return is_sealed(kMagic, bytes); }

ForeignPackage deserialise_foreign(std::string_view bytes, const std::string& place) {
  ByteReader in = opened(kMagic, bytes, place, "is not a packed FMU of this version");
  ForeignPackage package;
  Getter(in).get(package);
  in.expect_end();
  at(place, [&] { check(package); });
  return package;
}

bool holds_fmus(const std::string& platform) { return platform.ends_with("-linux"); }

Instance make_instance(ForeignPackage package, const std::filesystem::path& resources) {
#if defined(COTWIN_HOLDS_FMUS)
  auto fmu = std::make_shared<ForeignFmu>();
  fmu->name = package.name;
  fmu->folder = resources / package.folder;
  fmu->description = std::move(package.description);
  Instance instance;
  at(package.name, [&] {
    instance = make_instance(std::move(fmu), package.options);
    if (!package.start.empty()) package.start.write(instance.variables);
  });
  return instance;
#else
  throw Error((resources / package.folder).string(), "FMUs inside an FMU are not supported on this platform");
#endif
}

}  // namespace cotwin::fmu
