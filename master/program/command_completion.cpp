// cotwin completion: candidates for the completion of command lines by a shell.
#include <algorithm>
#include <filesystem>
#include <iostream>
#include <memory>
#include <sstream>

#include "master/engine/members.h"
#include "master/program/commands.h"
#include "master/ssp/scenario.h"
#include "models/support/error.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

// The program computes the candidates. bash splits the word at '=', ':' and '?' and replaces only the last part.
constexpr const char* kBash = R"(# bash completion of cotwin: source <(cotwin completion bash)
_cotwin() {
  local line=${COMP_LINE:0:COMP_POINT} candidate
  local word=${line##*[[:space:]]}
  local kept=${word%"${word##*[=:]}"}
  COMPREPLY=()
  while IFS= read -r candidate; do
    [[ $candidate == "$word"* ]] && COMPREPLY+=("${candidate#"$kept"}")
  done < <("${COMP_WORDS[0]}" completion candidates "$line" 2>/dev/null)
  [[ ${#COMPREPLY[@]} == 1 && ${COMPREPLY[0]} == *[=.?] ]] && compopt -o nospace
}
complete -o default -F _cotwin cotwin
)";

/// Adds "name=value" for each value of a setting with listed values, else "name=".
void add_setting(std::vector<std::string>& found, const std::string& name, const Setting& setting) {
  switch (setting.kind) {
    case Setting::Kind::kChoice:
      for (const std::string& choice : setting.choices) found.push_back(name + "=" + choice);
      return;
    case Setting::Kind::kBoolean:
      found.push_back(name + "=true");
      found.push_back(name + "=false");
      return;
    case Setting::Kind::kInteger:
    case Setting::Kind::kText:
      found.push_back(name + "=");
      return;
  }
}

/// Returns the candidates after --set for this scenario. For a component that cannot be built, these are its settings.
std::vector<std::string> assignments(const fs::path& file) {
  const Scenario scenario = load_scenario(file);
  const std::vector<fs::path> folders = model_folders(scenario.folder);
  std::vector<std::string> found;
  fmu::FmuStore fmus;
  for (const ComponentSpec& spec : scenario.components) {
    if (is_unit(spec)) {
      const std::string unit = parse_unit_source(spec.source).unit;
      for (const Setting& setting : settings_of(find_type(unit, units()))) {
        add_setting(found, spec.name + "." + setting.name, setting);
        add_setting(found, setting.name, setting);
      }
    }
    try {
      const Member member = load_member(spec, scenario, units(), folders, fmus);
      for (const Variable& v : member.variables()) {
        if (v.role != Role::kOutput || v.has_start) found.push_back(spec.name + "." + v.name + "=");
      }
    } catch (const Error&) {
      continue;
    }
  }
  std::sort(found.begin(), found.end());
  found.erase(std::unique(found.begin(), found.end()), found.end());
  return found;
}

/// Returns the sources of units or, after a '?', the settings of that unit.
std::vector<std::string> sources(const std::string& word) {
  std::vector<std::string> found;
  const std::size_t question = word.find('?');
  for (const UnitType& type : units()) {
    for (const std::string prefix : {"", "unit:"}) {
      const std::string source = prefix + type.name;
      if (question == std::string::npos) {
        found.push_back(source);
      } else if (word.substr(0, question) == source) {
        const std::string given =
            word.substr(0, std::max(question, word.find('&') == std::string::npos ? 0 : word.rfind('&')) + 1);
        for (const Setting& setting : settings_of(type)) add_setting(found, given + setting.name, setting);
      }
    }
  }
  return found;
}

std::vector<std::string> candidates(const CLI::App& app, const std::string& line) {
  std::vector<std::string> words;
  std::istringstream in(line);
  for (std::string word; in >> word;) words.push_back(word);
  if (line.empty() || line.back() == ' ') words.emplace_back();
  std::vector<std::string> found;
  const std::vector<const CLI::App*> commands = app.get_subcommands([](const CLI::App*) { return true; });
  if (words.size() <= 2) {
    for (const CLI::App* command : commands) found.push_back(command->get_name());
    return found;
  }
  const std::string& word = words.back();
  const auto named =
      std::find_if(commands.begin(), commands.end(), [&](const CLI::App* c) { return c->get_name() == words[1]; });
  if (named == commands.end()) return found;
  const CLI::App* command = *named;
  if (const auto parts = command->get_subcommands([](const CLI::App*) { return true; }); !parts.empty()) {
    if (words.size() == 3) {
      for (const CLI::App* part : parts) found.push_back(part->get_name());
      return found;
    }
    const auto part = std::find_if(parts.begin(), parts.end(), [&](const CLI::App* p) { return p->get_name() == words[2]; });
    if (part != parts.end()) command = *part;
  }
  if (words[words.size() - 2] == "--set") {
    const auto file = std::find_if(words.begin() + 2, words.end() - 2, [](const std::string& w) {
      std::error_code none;
      return fs::is_regular_file(w, none);
    });
    return file == words.end() - 2 ? found : assignments(*file);
  }
  if (word.rfind('-', 0) == 0) {
    for (const CLI::Option* option : command->get_options()) {
      for (const std::string& name : option->get_lnames()) found.push_back("--" + name);
    }
  } else if (words[1] == "describe" || (words[1] == "pack" && word.rfind("unit:", 0) == 0)) {
    return sources(word);
  }
  return found;
}

}  // namespace

void add_completion(CLI::App& app, Chosen& chosen) {
  struct Arguments {
    std::string what, line;
  };
  const auto all = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand("completion", "Write a shell script for the completion of command lines");
  command->add_option("SHELL", all->what, "bash; or 'candidates': list the completions of LINE")
      ->required()
      ->check(CLI::IsMember({"bash", "candidates"}));
  command->add_option("LINE", all->line, "Command line up to the cursor, for 'candidates'");
  command->callback([all, &app, &chosen] {
    chosen = [all, &app] {
      if (all->what == "bash") {
        std::cout << kBash;
      } else {
        for (const std::string& candidate : candidates(app, all->line)) std::cout << candidate << '\n';
      }
      return kExitDone;
    };
  });
}

}  // namespace cotwin::master
