#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "jobs/command.h"
#include "jobs/compare.h"

namespace pf {

int run_compare_command(const Context& context, const Arguments& arguments) {
  CompareOptions options;
  CLI::App app("Measures how far the beauty of an EXR image is from that of a reference.", "photonfarm compare");
  app.add_option("IMAGE", options.image, "the image to judge")->required();
  app.add_option("REFERENCE", options.reference, "what it should be; same size")->required();
  app.add_flag("--json", options.json, "print one JSON document instead of a table");
  app.add_option("--error-image", options.error_image, kErrorImageHelp);
  app.footer(
      "Examples:\n"
      "  photonfarm compare out/glass-caustic.exr reference.exr\n"
      "  photonfarm compare out/glass-caustic.exr reference.exr --json --error-image error.png");
  if (const std::optional<int> code = parse_arguments(app, context, arguments)) return *code;
  const Result<std::string> report = run_compare(options);
  if (!report) {
    context.err << fmt::format("photonfarm compare: {}\n", report.error().message);
    return exit_code(report.error().kind);
  }
  context.out << *report;
  return 0;
}

}  // namespace pf
