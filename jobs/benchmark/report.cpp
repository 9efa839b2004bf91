#include "jobs/benchmark/report.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "jobs/benchmark/charts.h"
#include "jobs/benchmark/html.h"
#include "jobs/benchmark/pictures.h"
#include "jobs/benchmark/planner_report.h"

namespace pf::bench {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kStyle = R"css(
body{font:15px/1.45 system-ui,sans-serif;color:#222;margin:0 auto;max-width:1280px;padding:16px 24px 60px}
h1{font-size:26px;margin:10px 0 2px}h2{font-size:21px;margin:44px 0 8px;border-bottom:2px solid #ddd;padding-bottom:4px}
h3{font-size:16px;margin:22px 0 6px}p{margin:6px 0;max-width:980px}.dim{color:#666}.wide{overflow-x:auto}
table{border-collapse:collapse;margin:8px 0;font-variant-numeric:tabular-nums;font-size:13.5px}
th,td{padding:3px 7px;text-align:right;border-bottom:1px solid #e6e6e6;white-space:nowrap}
th{background:#f5f5f5;font-weight:600}td:first-child,th:first-child{text-align:left}
td.best{background:#dff0d8;font-weight:600}td.bad{color:#a00}td.text{white-space:normal;text-align:left}
.charts{display:flex;flex-wrap:wrap;gap:8px}.charts img{flex:0 1 calc(50% - 4px);min-width:340px}
.charts img.main{width:100%;max-width:900px;flex:none}.pics{display:flex;flex-wrap:wrap;gap:14px}
figure{margin:0;width:260px}figcaption{font-size:13px;margin-top:3px}.cmp{position:relative;line-height:0;--x:50%}
.cmp img,figure>img{width:100%;image-rendering:pixelated}.cmp img+img{position:absolute;inset:0;clip-path:inset(0 0 0 var(--x))}
.cmp i{position:absolute;top:0;bottom:0;left:var(--x);width:1px;background:#fff;pointer-events:none}
.cmp input{position:absolute;inset:0;width:100%;height:100%;margin:0;opacity:0;cursor:ew-resize}
nav a{margin-right:12px}
)css";

std::string time_text(const TimeToError& time) {
  using Kind = TimeToError::Kind;
  const char* sign = time.kind == Kind::kReached ? "" : time.kind == Kind::kBeforeFirst ? "≤ " : "> ";
  return fmt::format("{}{:.3g} s", sign, time.seconds);
}

std::string image(const fs::path& file, std::string_view type, std::string_view text, std::string_view css_class = "") {
  const std::string uri = data_uri(file, type);
  if (uri.empty()) return "";
  return fmt::format("<img class=\"{}\" alt=\"{}\" src=\"{}\">", css_class, escaped(text), uri);
}

class Page {
 public:
  Page(const BenchResult& bench, fs::path folder, const std::vector<std::string>& notes)
      : bench_(bench), folder_(std::move(folder)), notes_(notes) {}

  std::string text() {
    add("<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" "
        "content=\"width=device-width\">\n");
    add(fmt::format("<title>photonfarm bench: {}</title><style>{}</style></head><body>\n", escaped(bench_.suite.name),
                    kStyle));
    add(fmt::format("<h1>Speed against accuracy: {}</h1>\n", escaped(bench_.suite.name)));
    summary();
    for (std::size_t m = 0; m < bench_.suite.methods.size(); ++m) {
      if (bench_.suite.methods[m].type == "auto") add(planner_html(bench_, m));
    }
    add(ablations_html(bench_));
    for (const SceneResult& scene : bench_.scenes) add_scene(scene);
    failures();
    machine();
    meaning();
    add("</body></html>\n");
    return std::move(text_);
  }

 private:
  void add(std::string_view text) { text_ += text; }
  [[nodiscard]] const std::string& name_of(std::size_t method) const { return bench_.suite.methods[method].name; }

  void summary() {
    const Suite& s = bench_.suite;
    add(fmt::format(
        "<p>{} scenes, {} methods, {} seeds each, {} thread{}; budgets of {} {}. Times are {}.</p>\n", s.scenes.size(),
        s.methods.size(), s.repetitions, s.threads, s.threads == 1 ? "" : "s",
        s.by_seconds() ? fmt::format("{}", fmt::join(s.seconds, ", ")) : fmt::format("{}", fmt::join(s.passes, ", ")),
        s.by_seconds() ? "seconds" : "passes",
        s.time == TimeAxis::kCpu ? "seconds of processor time of the whole process" : "seconds since loading began"));
    add("<nav>");
    for (const SceneResult& scene : bench_.scenes)
      add(fmt::format("<a href=\"#{0}\">{0}</a>", escaped(scene.scene.name)));
    add("<a href=\"#failures\">failures</a><a href=\"#machine\">machine</a><a href=\"#meaning\">what the figures "
        "mean</a></nav>\n");
    add(image(folder_ / "charts" / "overview.svg", "image/svg+xml", "relMSE over time on every scene"));
    add("<h3>Error at the end of the last budget (relMSE; green: the lowest of the scene)</h3><div "
        "class=\"wide\"><table><tr><th>scene</th>");
    for (const MethodEntry& method : s.methods) add(fmt::format("<th>{}</th>", escaped(method.name)));
    add("<th>reference's noise</th></tr>\n");
    for (const SceneResult& scene : bench_.scenes) {
      add(fmt::format("<tr><td>{}</td>", escaped(scene.scene.name)));
      const std::size_t best = best_method(scene);
      for (std::size_t m = 0; m < scene.methods.size(); ++m) {
        const auto& groups = scene.methods[m].groups;
        if (groups.empty()) {
          add(scene.methods[m].runs.empty() ? "<td>–</td>" : "<td class=\"bad\">failed</td>");
        } else {
          add(fmt::format("<td{}>{}{}<br><span class=\"dim\">{:.3g} s, FLIP {:.3f}</span></td>",
                          m == best ? " class=\"best\"" : "", error_text(groups.back().rel_mse),
                          groups.back().at_reference_noise ? " *" : "", bench_.seconds(groups.back()),
                          groups.back().hdr_flip));
        }
      }
      add(fmt::format("<td>{}</td></tr>\n", error_text(scene.reference.noise)));
    }
    add("</table></div><p class=\"dim\">* no further from the reference than the reference's own noise allows to "
        "tell.</p>\n");
  }

  [[nodiscard]] static std::size_t best_method(const SceneResult& scene) {
    std::size_t best = scene.methods.size();
    for (std::size_t m = 0; m < scene.methods.size(); ++m) {
      const auto& groups = scene.methods[m].groups;
      if (groups.empty()) continue;
      if (best == scene.methods.size() || groups.back().rel_mse < scene.methods[best].groups.back().rel_mse) best = m;
    }
    return best;
  }

  void add_scene(const SceneResult& scene) {
    const Reference& r = scene.reference;
    add(fmt::format("<h2 id=\"{0}\">{0}</h2>\n", escaped(scene.scene.name)));
    if (!r.error.empty()) {
      add(fmt::format("<p class=\"bad\">No reference: {}</p>\n", escaped(r.error)));
    } else {
      add(fmt::format(
          "<p class=\"dim\">Reference: {}, two halves of {} passes each, {:.0f} s in all, {}x{} pixels; its own noise "
          "is "
          "relMSE {:.2e}, HDR-FLIP between its halves {:.3f}.{}</p>\n",
          r.type, r.passes, r.seconds, r.width, r.height, r.noise, r.flip_between_halves,
          r.biased
              ? " Its method is biased at any finite time; both halves share that bias, which the noise does not show."
              : ""));
    }
    add("<div class=\"charts\">");
    for (const Chart& chart : charts_of(bench_, scene)) {
      const bool main = chart.file.ends_with("-error-time");
      add(image(folder_ / "charts" / (chart.file + ".svg"), "image/svg+xml", chart.file, main ? "main" : ""));
    }
    add("</div>\n");
    table(scene);
    pictures(scene);
  }

  void table(const SceneResult& scene) {
    add("<div class=\"wide\"><table><tr><th>method</th><th>slope [95 %]</th>");
    for (const double target : bench_.suite.targets) add(fmt::format("<th>to relMSE {:g}</th>", target));
    add("<th>time</th><th>relMSE</th><th>lowest–highest</th><th>RMSE</th><th>HDR-FLIP</th><th>bias²</th><th>variance</"
        "th>"
        "<th>passes</th><th>photon paths</th><th>rays</th><th>MiB</th><th>load s</th></tr>\n");
    for (std::size_t m = 0; m < scene.methods.size(); ++m) add_row(scene, m);
    add("</table></div>\n");
  }

  /// Whether no other method of the scene reaches target `t` sooner.
  [[nodiscard]] static bool soonest(const SceneResult& scene, std::size_t method, std::size_t t) {
    using Kind = TimeToError::Kind;
    const TimeToError& own = scene.methods[method].times[t];
    return own.kind != Kind::kNotReached && std::ranges::all_of(scene.methods, [&](const MethodResult& other) {
             return other.times[t].kind == Kind::kNotReached || own.seconds <= other.times[t].seconds;
           });
  }

  void add_row(const SceneResult& scene, std::size_t m) {
    const MethodResult& method = scene.methods[m];
    add(fmt::format("<tr><td>{}</td>", escaped(name_of(m))));
    if (method.groups.empty()) {
      add(fmt::format("<td class=\"bad\" colspan=\"{}\">no whole image to judge</td></tr>\n",
                      13 + bench_.suite.targets.size()));
      return;
    }
    const Group& g = method.groups.back();
    const auto& fit = method.slope;
    add(!fit                           ? "<td>–</td>"
        : std::isfinite(fit->line.low) ? fmt::format("<td>{:.2f} [{:.2f}, {:.2f}]{}</td>", fit->line.slope,
                                                     fit->line.low, fit->line.high, fit->from_runs ? "" : "†")
                                       : fmt::format("<td>{:.2f}</td>", fit->line.slope));
    for (std::size_t t = 0; t < method.times.size(); ++t) {
      add(fmt::format("<td{}>{}</td>", soonest(scene, m, t) ? " class=\"best\"" : "", time_text(method.times[t])));
    }
    const auto part = [](const std::optional<ErrorParts>& parts, double ErrorParts::*member) {
      return parts ? error_text((*parts).*member) : std::string("–");
    };
    const std::string bias_error =
        g.relative && std::isfinite(g.relative->bias2_error) ? fmt::format(" ± {:.0e}", g.relative->bias2_error) : "";
    add(fmt::format(
        "<td>{:.3g} s</td><td>{}{}</td><td>{}–{}</td><td>{:.3g}</td><td>{:.4f}</td><td>{}{}</td><td>{}</td>",
        bench_.seconds(g), error_text(g.rel_mse), g.at_reference_noise ? " *" : "", error_text(g.rel_mse_low),
        error_text(g.rel_mse_high), g.rmse, g.hdr_flip, part(g.relative, &ErrorParts::bias2), bias_error,
        part(g.relative, &ErrorParts::variance)));
    add(fmt::format("<td>{:.0f}</td><td>{:.3g}</td><td>{:.3g}</td><td>{:.0f}</td><td>{:.2f}</td></tr>\n", g.passes,
                    g.photon_paths, g.rays, g.peak_bytes / 1048576.0, method.runs.front().load_seconds));
  }

  void pictures(const SceneResult& scene) {
    add("<h3>Images and where they are wrong (left: image; right: HDR-FLIP, black 0 to yellow 1; move the pointer's "
        "button to slide)</h3><div class=\"pics\">\n");
    add(fmt::format("<figure>{}<figcaption>reference</figcaption></figure>\n",
                    image(folder_ / "images" / reference_picture_name(scene), "image/png", "reference")));
    for (std::size_t m = 0; m < scene.methods.size(); ++m) {
      const Sample* sample = pictured(scene.methods[m]);
      if (sample == nullptr) continue;
      const std::string error = image(folder_ / "images" / picture_name(scene, m, true), "image/png", "error");
      add(fmt::format("<figure><div class=\"cmp\">{}{}",
                      image(folder_ / "images" / picture_name(scene, m, false), "image/png", name_of(m)), error));
      if (!error.empty()) {
        add("<i></i><input type=\"range\" aria-label=\"image or error\" value=\"50\" "
            "oninput=\"this.parentNode.style.setProperty('--x',this.value+'%')\">");
      }
      add(fmt::format("</div><figcaption>{}: {:.3g} s, relMSE {}, FLIP {:.3f}</figcaption></figure>\n",
                      escaped(name_of(m)), bench_.seconds(*sample), error_text(sample->rel_mse), sample->hdr_flip));
    }
    add("</div>\n");
  }

  void failures() {
    add("<h2 id=\"failures\">Failures and notes</h2>\n<div "
        "class=\"wide\"><table><tr><th>scene</th><th>method</th><th>seed</th><th>what</th></tr>\n");
    int rows = 0;
    const auto row = [&](const SceneResult& scene, const RunResult& run, const std::string& what) {
      add(fmt::format("<tr><td>{}</td><td>{}</td><td>{}</td><td class=\"text\">{}</td></tr>\n",
                      escaped(scene.scene.name), escaped(name_of(run.run->method)), run.run->seed, escaped(what)));
      ++rows;
    };
    for (const SceneResult& scene : bench_.scenes) {
      for (const MethodResult& method : scene.methods) {
        for (const RunResult& run : method.runs) {
          if (!run.error.empty()) row(scene, run, run.error);
          for (const Sample& s : run.samples) {
            if (s.nonfinite_pixels + s.negative_pixels == 0) continue;
            row(scene, run,
                fmt::format("{} pixels NaN or infinite, {} negative at budget {:g}", s.nonfinite_pixels,
                            s.negative_pixels, s.budget));
          }
          if (run.run->repetition == 0) {
            for (const std::string& warning : run.warnings) row(scene, run, "warning: " + warning);
          }
        }
      }
    }
    add("</table></div>\n");
    if (rows == 0) add("<p>None: every run ended well, and no pixel is NaN, infinite or negative.</p>\n");
    for (const std::string& note : notes_) add(fmt::format("<p>{}</p>\n", escaped(note)));
  }

  void machine() {
    add("<h2 id=\"machine\">Machine and build</h2>\n<table>\n");
    for (const auto& [key, value] : bench_.machine.items()) {
      const std::string text = value.is_null()     ? "not told"
                               : value.is_string() ? value.get<std::string>()
                                                   : value.dump();
      add(fmt::format("<tr><td>{}</td><td class=\"text\">{}</td></tr>\n", escaped(key), escaped(text)));
    }
    add("</table>\n");
    double least = INFINITY, most = 0;
    for (const SceneResult& scene : bench_.scenes) {
      for (const MethodResult& method : scene.methods) {
        for (const RunResult& run : method.runs) {
          least = std::min(least, run.load_average);
          most = std::max(most, run.load_average);
        }
      }
    }
    if (most > 0)
      add(
          fmt::format("<p>Load average at the end of runs: {:.1f} to {:.1f}. Runs were shuffled (seed {}) and bound to "
                      "processors.</p>\n",
                      least, most, bench_.suite.shuffle));
  }

  void meaning() {
    add("<h2 id=\"meaning\">What the figures mean</h2>\n"
        "<p><b>relMSE</b>: mean over pixels and channels of (x - r)² / (r² + 0.01). <b>HDR-FLIP</b>: the difference "
        "that a person sees when "
        "the two images alternate, 0 to 1. Curves are means over seeds; small marks are single runs.</p>\n"
        "<p><b>One run serves all budgets</b>: the renderer writes the image as it is at each budget and takes the "
        "time for that off its clock; "
        "loading the scene and building maps is part of every time, and loading is shown apart.</p>\n"
        "<p><b>bias² and variance</b>, relative as relMSE: unbiased estimates from independent seeds, the variance of "
        "the reference "
        "taken off. bias² below zero is noise around zero; it is not clamped, and not drawn.</p>\n"
        "<p><b>Slope</b> of log relMSE over log time (reference noise taken off, points at that noise left out); its "
        "interval is that of "
        "the mean of the seeds' slopes. † fewer than three seeds: from the residuals of all points, which is too "
        "narrow.</p>\n"
        "<p><b>Pareto front</b>: no other method and budget has both less time and less error. <b>Times to an "
        "error</b> are interpolated "
        "on the mean curve; ≤: reached at the first image, &gt;: not reached.</p>\n");
  }

  const BenchResult& bench_;
  fs::path folder_;
  const std::vector<std::string>& notes_;
  std::string text_;
};

}  // namespace

std::string report_html(const BenchResult& bench, const fs::path& folder, const std::vector<std::string>& notes) {
  return Page(bench, folder, notes).text();
}

}  // namespace pf::bench
