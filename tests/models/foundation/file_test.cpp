// Only regular files are read: everything else is refused at once.
#include <fcntl.h>
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "models/foundation/formats/csv.h"
#include "models/foundation/formats/parameter_set.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/mesh.h"
#include "models/scene/sdf/sdf.h"

namespace cotwin::text::file_test {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

class Files : public ::testing::Test {
 protected:
  Files() {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    alarm(60);  // if a FIFO were waited for, this would end the test
  }
  ~Files() override {
    alarm(0);
    fs::remove_all(folder_);
  }
  fs::path fifo(const std::string& name) const {
    const fs::path file = folder_ / name;
    EXPECT_EQ(mkfifo(file.c_str(), 0600), 0);
    return file;
  }
  template <class Call>
  static std::string error_of(Call call) {
    try {
      call();
    } catch (const Error& error) {
      return error.what();
    }
    return "no error";
  }
  const fs::path folder_ = fs::temp_directory_path() / ("cotwin_file_test_" + std::to_string(getpid()));
};

TEST_F(Files, AreReadToTheirEnd) {
  const fs::path file = folder_ / "a";
  const std::string bytes(300'000, '\0');
  std::ofstream(file, std::ios::binary) << bytes;
  EXPECT_EQ(read_file(file, "bytes"), bytes);
  EXPECT_EQ(read_file(file, "bytes", bytes.size()), bytes);
  std::ofstream(folder_ / "empty");
  EXPECT_EQ(read_file(folder_ / "empty", "bytes"), "");
  EXPECT_FALSE(read_file("/proc/self/status", "bytes").empty());  // it reports a size of 0
}

TEST_F(Files, OfTooManyBytesAreRefusedBeforeTheyAreRead) {
  const fs::path file = folder_ / "sparse";
  std::ofstream(file) << "x";
  fs::resize_file(file, std::uintmax_t{1} << 40);  // larger than any memory
  EXPECT_THAT(error_of([&] { read_file(file, "a text"); }),
              AllOf(StartsWith(file.string()), HasSubstr("1099511627776 bytes, expected a text of at most 268435456")));
}

TEST_F(Files, ThatAreNotRegularAreRefusedAtOnce) {
  const auto error = [&](const fs::path& file) { return error_of([&] { open_file(file, "a table"); }); };
  EXPECT_THAT(error(fifo("pipe")), AllOf(StartsWith((folder_ / "pipe").string()), HasSubstr("is a FIFO, expected a table")));
  EXPECT_THAT(error(folder_), HasSubstr("is a folder, expected a table"));
  EXPECT_THAT(error("/dev/zero"), HasSubstr("is a device, expected a table"));
  fs::create_symlink("/dev/zero", folder_ / "link");
  EXPECT_THAT(error(folder_ / "link"), HasSubstr("is a device, expected a table"));
  EXPECT_THAT(error(folder_ / "none"), HasSubstr("cannot be read: No such file or directory, expected a table"));
  const int socket = ::socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const fs::path place = folder_ / "socket";
  ASSERT_LT(place.string().size(), sizeof address.sun_path);
  place.string().copy(address.sun_path, sizeof address.sun_path - 1);
  ASSERT_EQ(bind(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  EXPECT_THAT(error(place), HasSubstr("is a socket"));
  close(socket);
}

TEST_F(Files, OpeningAFifoNeverBlocks) {
  EXPECT_THAT(error_of([&] { csv::load(fifo("a.csv")); }), HasSubstr("is a FIFO"));
  EXPECT_THAT(error_of([&] { load_parameter_set(fifo("a.ssv")); }), HasSubstr("is a FIFO"));
  EXPECT_THAT(error_of([&] { robot::load_urdf(fifo("a.urdf")); }), HasSubstr("is a FIFO"));
  EXPECT_THAT(error_of([&] { scene::load(fifo("a.sdf")); }), HasSubstr("is a FIFO"));
  EXPECT_THAT(error_of([&] { scene::load_hull(fifo("a.stl")); }), HasSubstr("is a FIFO"));
}

}  // namespace
}  // namespace cotwin::text::file_test
