// cotwin view: writes results as a page for a browser, and opens it.
#include <iostream>
#include <memory>

#include "master/program/browser.h"
#include "master/program/commands/commands.h"
#include "master/program/progress_line.h"
#include "master/program/time_options.h"
#include "master/view/view.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

int view(ViewOptions options, bool opens) {
  ProgressLine line(true);
  options.progress = [&](const std::string& what, double share) { line.update(what, share); };
  const ViewSummary summary = write_view(options, units());
  line.clear();
  for (const std::string& remark : summary.remarks) std::cerr << "cotwin: note: " << remark << '\n';
  std::cout << "page: " << summary.page.string() << " (" << text::to_text(static_cast<double>(summary.bytes) * 1e-6, 2)
            << " MB, " << summary.rows << (summary.rows == 1 ? " row" : " rows") << ", " << summary.columns << " columns, "
            << summary.robots << (summary.robots == 1 ? " robot" : " robots") << "): open it in a browser\n";
  if (opens) open_in_browser(fs::absolute(summary.page).string());
  return kExitDone;
}

}  // namespace

void add_view(CLI::App& app, Chosen& chosen) {
  const auto options = std::make_shared<ViewOptions>();
  const auto time = std::make_shared<TimeOptions>();
  const auto stays_closed = std::make_shared<bool>(false);
  CLI::App* command = app.add_subcommand(
      "view",
      "Write results as a page for a browser: the robots in 3D over time, with plots; one file, which needs no network");
  command->add_option("RESULTS", options->results, "Folder of a run, or a recording (CSV)")->type_name("RESULTS")->required();
  command->add_option("-o,--out", options->out, "The page (default: view.html beside the recording)")->type_name("FILE");
  command
      ->add_option("--plot", options->plots, "Signals to plot at the beginning, e.g. drive.tau_J or 'drive.*'; may be repeated")
      ->type_name("GLOB")
      ->allow_extra_args(false);
  command->add_option("--scenario", options->scenario, "Scenario of the run (default: the one that run.json names)")
      ->type_name("FILE");
  command->add_option("--robot", options->robot, "URDF, or the name of a robot, in place of the scenario's robots")
      ->type_name("ROBOT");
  time->add_to(*command);
  command->add_flag("--no-open", *stays_closed, "Only write the page (default: open it, on a terminal with a display)");
  command->callback([=, &chosen] {
    options->model_folders = model_folders;
    chosen = [=] {
      options->time = time->chosen({&options->results, 1});
      return view(*options, !*stays_closed);
    };
  });
}

}  // namespace cotwin::master
