#include "worker/scene/gltf_report.h"

#include <algorithm>

#include <fmt/format.h>

namespace pf::gltf {
namespace {

void append_escaped(std::string& out, unsigned char c) {
  if (c < 0x20 || c == 0x7f) {
    out += fmt::format("\\x{:02x}", c);
  } else {
    out += static_cast<char>(c);
  }
}

constexpr std::size_t kMaxQuoted = 96;

}  // namespace

std::string in_quotes(std::string_view text) {
  std::string out = "\"";
  std::size_t end = std::min(text.size(), kMaxQuoted);
  // Cut between UTF-8 sequences, never inside one.
  while (end > 0 && end < text.size() && (static_cast<unsigned char>(text[end]) & 0xc0u) == 0x80u) --end;
  for (const char c : text.substr(0, end)) {
    if (c == '"' || c == '\\') out += '\\';
    append_escaped(out, static_cast<unsigned char>(c));
  }
  if (end < text.size()) out += "...";
  return out + '"';
}

std::string child(std::string_view pointer, std::string_view key) {
  std::string out(pointer);
  out += '/';
  for (const char c : key.substr(0, kMaxQuoted)) {
    if (c == '~') {
      out += "~0";
    } else if (c == '/') {
      out += "~1";
    } else {
      append_escaped(out, static_cast<unsigned char>(c));
    }
  }
  return out;
}

std::string child(std::string_view pointer, std::size_t index) { return fmt::format("{}/{}", pointer, index); }

std::string Report::line(std::string_view pointer, std::string_view what) const {
  return pointer.empty() ? fmt::format("{}: {}", file_, what) : fmt::format("{}: {}: {}", file_, pointer, what);
}

void Report::error(std::string_view pointer, std::string_view what) {
  if (!error_) error_ = Error{ErrorKind::kInvalidInput, line(pointer, what)};
}

void Report::warn(std::string_view pointer, std::string_view what) { add_warning(line(pointer, what)); }

void Report::warn(const Error& error, std::string_view remark) {
  add_warning(remark.empty() ? error.message : fmt::format("{}; {}", error.message, remark));
}

void Report::add_warning(std::string text) {
  if (warnings_.size() >= kMaxWarnings) {
    ++suppressed_;
    return;
  }
  if (std::find(warnings_.begin(), warnings_.end(), text) == warnings_.end()) warnings_.push_back(std::move(text));
}

tl::unexpected<Error> Report::fail(std::string_view pointer, std::string_view what) const {
  return pf::fail(ErrorKind::kInvalidInput, line(pointer, what));
}

Result<void> Report::result() const {
  if (error_) return tl::unexpected<Error>(*error_);
  return {};
}

std::vector<std::string> Report::take_warnings() {
  if (suppressed_ > 0) {
    warnings_.push_back(line("", fmt::format("{} more warnings of this file are not shown", suppressed_)));
  }
  suppressed_ = 0;
  return std::move(warnings_);
}

}  // namespace pf::gltf
