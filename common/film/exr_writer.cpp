#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <memory>
#include <optional>
#include <system_error>
#include <tuple>

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <fmt/format.h>

#include "common/base/atomic_file.h"
#include "common/film/image.h"

namespace pf {
namespace {

/// OpenEXR's own file stream cannot tell of an error in the last step: OutputFile's destructor writes the
/// table of line offsets and drops exceptions. This stream remembers that something failed.
class CheckedOutput final : public Imf::OStream {
 public:
  explicit CheckedOutput(const std::filesystem::path& file)
      : OStream(file.c_str()), stream_(std::fopen(file.c_str(), "wb")) {
    if (!stream_) note_failure();
  }
  void write(const char bytes[], int count) override {
    if (failed() ||
        std::fwrite(bytes, 1, static_cast<std::size_t>(count), stream_.get()) != static_cast<std::size_t>(count)) {
      raise();
    }
  }
  std::uint64_t tellp() override {
    // Never throws: OutputFile's destructor asks for the position outside its try block.
    const long position = failed() ? -1 : std::ftell(stream_.get());
    if (position < 0) note_failure();
    return position < 0 ? 0 : static_cast<std::uint64_t>(position);
  }
  void seekp(std::uint64_t position) override {
    if (failed() || std::fseek(stream_.get(), static_cast<long>(position), SEEK_SET) != 0) raise();
  }
  /// Flushes and closes; the reason of the first failure since opening, if any.
  [[nodiscard]] std::optional<std::string> close() {
    if (stream_ && std::fclose(stream_.release()) != 0) note_failure();
    return failure_;
  }

 private:
  struct Closer {
    void operator()(std::FILE* stream) const { std::ignore = std::fclose(stream); }
  };
  [[nodiscard]] bool failed() const { return failure_.has_value(); }
  void note_failure() {
    if (!failure_) failure_ = std::generic_category().message(errno);
  }
  [[noreturn]] void raise() {
    note_failure();
    throw std::runtime_error(*failure_);
  }

  std::unique_ptr<std::FILE, Closer> stream_;
  std::optional<std::string> failure_;
};

[[nodiscard]] std::string channel_name(const Layer& layer, const std::string& channel) {
  return layer.name.empty() ? channel : layer.name + "." + channel;
}

/// Layers of `pixels` pixels each, whose channels all have names of their own.
[[nodiscard]] Result<void> check_layers(const std::vector<Layer>& layers, std::size_t pixels) {
  Imf::ChannelList names;
  for (const Layer& layer : layers) {
    const std::size_t expected = layer.channels.size() * pixels;
    if (layer.channels.empty() || layer.data.size() != expected) {
      return fail(ErrorKind::kInternal, fmt::format("layer '{}' has {} channels and {} floats; expected {} floats",
                                                    layer.name, layer.channels.size(), layer.data.size(), expected));
    }
    for (const std::string& channel : layer.channels) {
      const std::string name = channel_name(layer, channel);
      if (name.empty() || names.findChannel(name) != nullptr) {
        return fail(ErrorKind::kInternal, fmt::format("channel '{}' twice or without a name", name));
      }
      names.insert(name, Imf::Channel(Imf::FLOAT));
    }
  }
  if (layers.empty()) return fail(ErrorKind::kInternal, "an image without layers");
  return {};
}

[[nodiscard]] Imf::Header header_of(const ImageRows& image, const std::vector<Layer>& layers) {
  Imf::Header header(image.width, image.height);
  header.compression() = Imf::ZIP_COMPRESSION;
  for (const auto& [key, value] : image.metadata) {
    header.insert(std::string(kExrAttributePrefix) + key, Imf::StringAttribute(value));
  }
  for (const Layer& layer : layers) {
    for (const std::string& channel : layer.channels) {
      header.channels().insert(channel_name(layer, channel), Imf::Channel(Imf::FLOAT));
    }
  }
  return header;
}

/// Where the pixels of rows first .. first + count - 1 lie.
[[nodiscard]] Imf::FrameBuffer frame_of(const std::vector<Layer>& layers, int width, int first, int count) {
  Imf::FrameBuffer frame;
  for (const Layer& layer : layers) {
    const std::size_t stride = layer.channels.size() * sizeof(float);
    for (std::size_t i = 0; i < layer.channels.size(); ++i) {
      frame.insert(
          channel_name(layer, layer.channels[i]),
          Imf::Slice::Make(Imf::FLOAT, layer.data.data() + i, {0, first}, width, count, stride, stride * width));
    }
  }
  return frame;
}

[[nodiscard]] Result<void> write_pixels(Imf::OStream& stream, const ImageRows& image) {
  std::optional<Imf::OutputFile> output;
  for (int first = 0; first < image.height; first += kImageRowsAtOnce) {
    const int count = std::min(kImageRowsAtOnce, image.height - first);
    const std::vector<Layer> layers = image.rows(first, count);
    if (auto ok = check_layers(layers, std::size_t{1} * image.width * count); !ok) return ok;
    if (!output) output.emplace(stream, header_of(image, layers), 0);
    output->setFrameBuffer(frame_of(layers, image.width, first, count));
    output->writePixels(count);
  }
  return {};
}

}  // namespace

Result<void> write_exr(const std::filesystem::path& file, const ImageRows& image) {
  const auto unwritten = [&](std::string_view why) {
    return fail(ErrorKind::kInternal, fmt::format("{}: EXR not written: {}", file.string(), why));
  };
  if (image.width <= 0 || image.height <= 0) {
    return unwritten(fmt::format("an image of {}x{} pixels", image.width, image.height));
  }
  return write_file_atomically(file, [&](const std::filesystem::path& temporary) -> Result<void> {
    CheckedOutput output(temporary);
    std::string failure;
    try {
      if (const auto written = write_pixels(output, image); !written) failure = written.error().message;
    } catch (const std::exception& error) {
      failure = error.what();
    }
    if (const auto closing = output.close()) failure = *closing;
    if (failure.empty()) return {};
    return unwritten(failure);
  });
}

Result<void> write_exr(const std::filesystem::path& file, const LayeredImage& image) {
  // Here, because what follows reads blocks out of the layers.
  if (auto ok = check_layers(image.layers, std::size_t{1} * std::max(image.width, 0) * std::max(image.height, 0));
      !ok) {
    return fail(ErrorKind::kInternal, fmt::format("{}: EXR not written: {}", file.string(), ok.error().message));
  }
  return write_exr(file, rows_of(image));
}

}  // namespace pf
