// cotwin report: writes the results of runs and tunings as one HTML page.
#include <iostream>
#include <memory>

#include "master/program/commands/commands.h"
#include "master/program/time_options.h"
#include "master/report/report.h"
#include "models/foundation/support/error.h"

namespace cotwin::master {

void write_report_page(const std::filesystem::path& folder, bool quiet) {
  try {
    const report::WrittenPage page = report::write_page({{folder}, {}, {}, COTWIN_VERSION});
    if (quiet) return;
    std::cout << "report: " << page.file.string() << (page.lacking.empty() ? "" : " (" + page.lacking + ")") << std::endl;
  } catch (const Error& error) {
    std::cerr << "cotwin: no report: " << error.what() << '\n';
  }
}

void add_report(CLI::App& app, Chosen& chosen) {
  const auto options = std::make_shared<report::PageOptions>();
  const auto time = std::make_shared<TimeOptions>();
  CLI::App* command = app.add_subcommand("report", "Write the results of runs and tunings as one HTML page");
  command
      ->add_option("RESULTS", options->results,
                   "Folders with results of `cotwin run` or `cotwin tune`, or recordings (CSV); the first is the reference")
      ->type_name("RESULTS")
      ->required();
  command
      ->add_option("-o,--out", options->out,
                   "The page (default: report.html in the folder, comparison.html in the first of several folders)")
      ->type_name("FILE.html");
  command->add_option("--signals", options->signals, "Signals to plot, e.g. 'drive.*' (default: all); may be repeated")
      ->type_name("GLOB")
      ->allow_extra_args(false);
  time->add_to(*command);
  time->add_topic_to(*command);
  command->callback([options, time, &chosen] {
    chosen = [options, time] {
      options->version = COTWIN_VERSION;
      options->time = time->chosen(options->results);
      const report::WrittenPage page = report::write_page(*options);
      for (const std::string& note : page.notes) std::cerr << "cotwin: note: " << note << '\n';
      if (!page.lacking.empty()) std::cerr << "cotwin: " << page.lacking << '\n';
      std::cout << "report: " << page.file.string() << '\n';
      return kExitDone;
    };
  });
}

}  // namespace cotwin::master
