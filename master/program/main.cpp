// The program `cotwin`: command line and choice of the subcommand.
#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string_view>
#include <system_error>

#include "components/unit/unit_module.h"
#include "fmu/archive/archive.h"
#include "fmu/archive/file_kind.h"
#include "fmu/import/library.h"
#include "fmu/process/process.h"
#include "master/program/commands/commands.h"
#include "master/program/interrupt.h"
#include "master/run/crash.h"
#include "models/bag/bag.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/kernels/kernels.h"

namespace cotwin::master {

namespace fs = std::filesystem;

namespace {

std::vector<fs::path>& modules_of_command_line() {
  static std::vector<fs::path> modules;
  return modules;
}

const UnitCatalogue& catalogue() {
  static const UnitCatalogue all = [] {
    std::vector<fs::path> modules;
    if (const char* listed = std::getenv("COTWIN_UNITS")) {
      for (const std::string_view path : text::split(listed, ':')) {
        if (!path.empty()) modules.emplace_back(path);
      }
    }
    const std::vector<fs::path>& named = modules_of_command_line();
    modules.insert(modules.end(), named.begin(), named.end());
    std::string absolute;  // for this program on other machines
    for (const fs::path& module : modules) text::append(absolute, fs::absolute(module).string(), ":");
    if (!modules.empty()) setenv("COTWIN_UNITS", absolute.c_str(), 1);
    return load_units(unit_types(), modules);
  }();
  return all;
}

}  // namespace

void add_units_option(CLI::App& command) {
  command
      .add_option("--units", modules_of_command_line(),
                  "Module with further units (.so, made by cotwin_unit() in CMake), or a folder of them; may be repeated")
      ->type_name("PATH")
      ->allow_extra_args(false);
}

std::span<const UnitType> units() { return catalogue().types; }

std::vector<fs::path> libraries_of_modules() {
  std::vector<fs::path> folders;
  for (const fs::path& module : catalogue().modules) folders.push_back(module.parent_path() / "fmu");
  return folders;
}

Build this_build() {
  std::uint64_t file = hash_of_file("/proc/self/exe");
  for (const fs::path& module : catalogue().modules) file = file * 0x100000001b3u ^ hash_of_file(module);
  return {COTWIN_VERSION, file, robot::kernel_isa()};
}

std::string file_name_of(const std::string& wanted) {
  std::string name = wanted.empty() ? "run" : wanted;
  for (char& c : name) {
    const bool plain = std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_' || c == '.' || (c & 0x80);
    if (!plain) c = '_';
  }
  return name == "." || name == ".." ? "run" : name;
}

bool is_fmu(const fs::path& path) {
  std::error_code none;
  if (fmu::has_ending(path, ".fmu") || fs::is_regular_file(path / "modelDescription.xml", none)) return true;
  if (fmu::has_ending(path, ".ssp") || !fmu::is_archive(path)) return false;
  return std::ranges::any_of(fmu::list_archive(path), [](const auto& entry) { return entry.name == "modelDescription.xml"; });
}

}  // namespace cotwin::master

namespace {

/// What to say of the first option that its command does not have; "" if there is none.
std::string hint_for_options(const CLI::App& app) {
  const std::vector<CLI::App*> given = app.get_subcommands();
  if (given.empty()) return "";
  const CLI::App& command = *given.front();
  for (const std::string& word : command.remaining()) {
    if (!word.starts_with("--")) continue;
    const std::string name = word.substr(0, word.find('='));
    std::vector<std::string> known;
    for (const CLI::Option* option : command.get_options()) {
      for (const std::string& one : option->get_lnames()) known.push_back("--" + one);
    }
    const std::string what = "'" + name + "' is not an option of " + command.get_name();
    constexpr std::string_view kSteps[] = {"--step-size", "--stepsize", "--step",
                                           "--tick",      "--dt",       "--communication-step-size"};
    if (command.get_name() == "run" && std::ranges::find(kSteps, name) != std::end(kSteps)) {
      return what +
             "; the step of an FMU is --output-interval SECONDS, that of a scenario the attribute tick of cotwin:Master in its "
             "file";
    }
    const std::string similar = cotwin::text::closest(name, known);
    return what + (similar.empty() ? "" : "; did you mean " + similar + "?");
  }
  return "";
}

int run(int argc, char** argv) {
  using namespace cotwin::master;
  ignore_signals_of_writing();
  CLI::App app{"Cotwin: a value-driven digital twin of robot manipulators, as co-simulation units and a small master."};
  app.set_version_flag("--version", std::string("cotwin ") + COTWIN_VERSION);
  app.require_subcommand(1);
  app.failure_message([](const CLI::App*, const CLI::Error& error) {
    return std::string("cotwin: ") + error.what() + "\nRun with --help for more information.\n";
  });
  app.footer(
      "Exit codes: 0 done; 1 the run failed (NaN, a step that could not be made, full disk); 2 bad input (command line,\n"
      "scenario, parameters, files); 128 + the number of the signal that ended it (130: Ctrl-C, 143: SIGTERM); the results up\n"
      "to then are in the files.");

  Chosen chosen;
  add_run(app, chosen);
  add_pack(app, chosen);
  add_inspection(app, chosen);
  add_catalogue(app, chosen);
  add_tune(app, chosen);
  add_anomaly(app, chosen);
  add_excite(app, chosen);
  add_perturb(app, chosen);
  add_fit_energy(app, chosen);
  add_report(app, chosen);
  add_cloud(app, chosen);
  add_scan(app, chosen);
  add_tool(app, chosen);
  add_search(app, chosen);
  add_farm(app, chosen);
  add_robot(app, chosen);
  add_ask(app, chosen);
  add_serve(app, chosen);
  add_view(app, chosen);
  add_new(app, chosen);
  add_plot(app, chosen);
  add_manual(app, chosen);
  add_completion(app, chosen);
  for (const char* name : {"run", "search", "farm", "robot", "view", "pack", "check", "units", "describe", "reference"})
    add_units_option(*app.get_subcommand(name));

  try {
    // CLI11's own message does not name the wrong command.
    const auto commands = app.get_subcommands([](const CLI::App*) { return true; });
    const auto is_asked = [&](const CLI::App* command) { return command->check_name(argv[1]); };
    if (argc > 1 && argv[1][0] != '-' && std::none_of(commands.begin(), commands.end(), is_asked)) {
      std::string names;
      for (const CLI::App* command : commands) {
        const char* const before = names.empty() ? "" : command == commands.back() ? " or " : ", ";
        names += before + command->get_name();
      }
      std::vector<std::string> known;
      for (const CLI::App* command : commands) known.push_back(command->get_name());
      const std::string similar = cotwin::text::closest(argv[1], known);
      throw CLI::ExtrasError(std::string("'") + argv[1] + "' is not a command, expected " + names +
                                 (similar.empty() ? "" : "; did you mean " + similar + "?"),
                             CLI::ExitCodes::ExtrasError);
    }
    app.parse(argc, argv);
  } catch (const CLI::ExtrasError& error) {
    const std::string hint = hint_for_options(app);
    return app.exit(hint.empty() ? error : CLI::ExtrasError(hint, CLI::ExitCodes::ExtrasError)) == 0 ? kExitDone
                                                                                                     : kExitBadInput;
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kExitDone : kExitBadInput;
  }
  try {
    return chosen();
  } catch (const cotwin::CutOutput& error) {
    std::cerr << "cotwin: " << error.what() << '\n';
    return kExitRunFailed;
  } catch (const std::exception& error) {
    std::cerr << "cotwin: " << error.what() << '\n';
    return kExitBadInput;
  }
}

/// A file that is opened later must not get the number of a stream that was closed at the start (>&-), and with it its output.
void keep_numbers_of_streams() {
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    if (::fcntl(stream, F_GETFD) < 0) (void)::open("/dev/null", stream == STDIN_FILENO ? O_WRONLY : O_RDONLY);
  }
}

/// The exit code after the output: that of a command which is done counts only if all it wrote has arrived.
int after_output(int code) {
  using namespace cotwin::master;
  errno = 0;
  std::cout.flush();
  const bool flushed = std::fflush(stdout) == 0;
  const int reason = errno;
  if (flushed && std::cout.good() && std::ferror(stdout) == 0) return code;
  pollfd out = {STDOUT_FILENO, POLLOUT, 0};
  if (::poll(&out, 1, 0) > 0 && (out.revents & (POLLERR | POLLHUP)) != 0)  // the reader closed the pipe (| head)
    return code == kExitDone ? kExitSignalled + SIGPIPE : code;
  std::cerr << "cotwin: stdout: cannot be written" << (reason == 0 ? "" : ": " + cotwin::system_reason(reason)) << '\n';
  return code == kExitDone ? kExitRunFailed : code;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace cotwin;
  master::catch_crashes(master::kExitRunFailed);
  keep_numbers_of_streams();
  bag::start();
  const int code = after_output(run(argc, argv));
  const int ended = code == master::kExitDone && fmu::unclean_ends() > 0 ? master::kExitRunFailed : code;
  master::main_ends();
  if (fmu::abandoned_libraries() == 0) return ended;
  std::fflush(nullptr);
  master::end_now(ended);
}
