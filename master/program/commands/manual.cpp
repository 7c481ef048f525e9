// cotwin manual: writes the manual pages.
#include <iostream>
#include <memory>

#include "master/program/commands/commands.h"
#include "master/program/manual.h"
#include "models/foundation/support/atomic_file.h"

namespace cotwin::master {

void add_manual(CLI::App& app, Chosen& chosen) {
  const auto folder = std::make_shared<std::filesystem::path>();
  CLI::App* command = app.add_subcommand("manual", "Write the manual pages: cotwin.1 and one page per command");
  command->add_option("DIR", *folder, "Folder for the pages")->type_name("FOLDER")->required();
  command->callback([folder, &app, &chosen] {
    chosen = [folder, &app] {
      make_folder(*folder);
      write_file(*folder / "cotwin.1", manual_of_program(app, COTWIN_VERSION));
      for (const CLI::App* page : app.get_subcommands([](const CLI::App*) { return true; }))
        write_file(*folder / ("cotwin-" + page->get_name() + ".1"), manual_of_command(app, *page, COTWIN_VERSION));
      return kExitDone;
    };
  });
}

}  // namespace cotwin::master
