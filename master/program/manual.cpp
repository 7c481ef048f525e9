#include "master/program/manual.h"

#include <algorithm>
#include <cctype>

#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

std::vector<const CLI::App*> parts_of(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App*) { return true; });
}

/// Text of a page: backslashes and hyphens stand for themselves, and no line is a request.
std::string plain(std::string_view text) {
  std::string out;
  bool begin = true;
  for (const char c : text) {
    if (begin && (c == '.' || c == '\'')) out += "\\&";
    begin = c == '\n';
    if (c == '\\') {
      out += "\\e";
    } else if (c == '-') {
      out += "\\-";
    } else {
      out += c;
    }
  }
  return out;
}

std::string capitals(std::string text) {
  for (char& c : text) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return text;
}

std::string section(const std::string& title) { return ".SH \"" + plain(capitals(title)) + "\"\n"; }

std::string header(const std::string& name, const std::string& summary, const std::string& version) {
  return ".\\\" Written by `cotwin manual`.\n.TH \"" + plain(capitals(name)) + "\" 1 \"\" \"Cotwin " + plain(version) +
         "\" \"Cotwin\"\n" + section("Name") + plain(name) + " \\- " + plain(summary) + "\n";
}

/// The placeholder of an option's value, and the values that it may have, as CLI11 writes them: "WORD:{a,b}".
struct Type {
  std::string placeholder, values;
};
Type type_of(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  const std::size_t open = type.find('{'), close = type.find('}');
  Type found{type.substr(0, type.find(':')), ""};
  if (open != std::string::npos && close != std::string::npos) {
    for (const std::string_view value : text::split(std::string_view(type).substr(open + 1, close - open - 1), ','))
      text::append(found.values, value);
    if (open == 0) found.placeholder.clear();
  }
  return found;
}

std::string entry(const CLI::Option& option) {
  const Type type = type_of(option);
  const bool takes_value = option.get_items_expected_max() > 0;
  std::string names;
  for (const std::string& name : option.get_snames()) names += (names.empty() ? "-" : ", -") + name;
  for (const std::string& name : option.get_lnames()) names += (names.empty() ? "--" : ", --") + name;
  const bool positional = names.empty();
  if (positional) names = option.get_name(true);
  std::string text = ".TP\n.B \"" + plain(names) + "\"\n";
  if (!positional && takes_value && !type.placeholder.empty())
    text = ".TP\n\\fB" + plain(names) + "\\fR " + plain(type.placeholder) + "\n";
  std::string description = plain(option.get_description());
  if (!type.values.empty()) description += "\n.br\nOne of " + plain(type.values) + ".";
  if (!option.get_default_str().empty()) description += "\n.br\nDefault: " + plain(option.get_default_str()) + ".";
  return text + description + "\n";
}

/// The options by their groups.
std::string options_of(const CLI::App& app, const std::string& title) {
  std::string text, positional;
  std::vector<std::string> groups;
  for (const CLI::Option* option : app.get_options()) {
    if (option->get_group().empty()) continue;
    if (!option->nonpositional()) {
      positional += entry(*option);
    } else if (std::find(groups.begin(), groups.end(), option->get_group()) == groups.end()) {
      groups.push_back(option->get_group());
    }
  }
  if (!positional.empty()) text += section(title + "Arguments") + positional;
  for (const std::string& group : groups) {
    text += section(title + group);
    for (const CLI::Option* option : app.get_options()) {
      if (option->nonpositional() && option->get_group() == group) text += entry(*option);
    }
  }
  return text;
}

std::string synopsis(const CLI::App& command, const std::string& name) {
  std::string text = "\\fB" + plain(name) + "\\fR [OPTIONS]";
  for (const CLI::Option* option : command.get_options()) {
    if (option->nonpositional()) continue;
    const std::string argument = plain(option->get_name(true)) + (option->get_items_expected_max() > 1 ? "..." : "");
    text += option->get_required() ? " " + argument : " [" + argument + "]";
  }
  return text + "\n";
}

std::string ending(const CLI::App& app) {
  std::string text = section("Exit status");
  std::string footer = app.get_footer();
  std::replace(footer.begin(), footer.end(), '\n', ' ');
  return text + plain(footer) + "\n";
}

}  // namespace

std::string manual_of_program(const CLI::App& app, const std::string& version) {
  std::string text = header("cotwin", "digital twin of robot manipulators", version);
  text += section("Synopsis") + "\\fBcotwin\\fR COMMAND [OPTIONS] [ARGUMENTS]\n";
  text += section("Description") + plain(app.get_description()) +
          "\n.PP\nEach command has a page of its own, for example\n.BR cotwin\\-run (1),\nand\n.BR \"cotwin COMMAND "
          "\\-\\-help\" .\n";
  text += section("Commands");
  for (const CLI::App* command : parts_of(app))
    text += ".TP\n.BR cotwin\\-" + plain(command->get_name()) + " (1)\n" + plain(command->get_description()) + "\n";
  text += options_of(app, "");
  text += section("Environment");
  text +=
      ".TP\n.B COTWIN_MODELS\nFolders with robots, scenes and other models, separated by colons; searched before those of "
      "Cotwin.\n";
  text += ".TP\n.B COTWIN_UNITS\nModules with further units, separated by colons, as with \\-\\-units.\n";
  text += ".TP\n.B COTWIN_CPU\nInstruction set of the numerical kernels, for example x86\\-64\\-v2.\n";
  return text + ending(app);
}

std::string manual_of_command(const CLI::App& app, const CLI::App& command, const std::string& version) {
  const std::string name = "cotwin " + command.get_name();
  std::string text = header("cotwin-" + command.get_name(), command.get_description(), version);
  text += section("Synopsis");
  const std::vector<const CLI::App*> parts = parts_of(command);
  if (parts.empty()) text += synopsis(command, name);
  for (std::size_t i = 0; i < parts.size(); ++i)
    text += (i == 0 ? "" : ".br\n") + synopsis(*parts[i], name + " " + parts[i]->get_name());
  text += section("Description") + plain(command.get_description()) + ".\n";
  text += options_of(command, "");
  for (const CLI::App* part : parts) {
    text += section(name + " " + part->get_name()) + plain(part->get_description()) + ".\n";
    text += options_of(*part, part->get_name() + ": ");
  }
  if (!command.get_footer().empty()) text += section("Notes") + plain(command.get_footer()) + "\n";
  return text + ending(app) + section("See also") + ".BR cotwin (1)\n";
}

}  // namespace cotwin::master
