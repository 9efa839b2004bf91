#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "common/math/vec.h"

namespace pf {

struct Picture {
  int width = 0;
  int height = 0;
  std::vector<Rgb> reference, image;
};

/// Made from integers alone, so that any language makes the same floats. HDR: columns of different
/// brightness.
inline Picture make_picture(int width, int height, bool hdr) {
  Picture picture{width, height, {}, {}};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const Rgb r(static_cast<float>((x * 7 + y * 3) % 16) / 16.0f, static_cast<float>((x * x + y * 5) % 23) / 32.0f,
                  static_cast<float>((x / 6 + y / 5) % 2) * 0.75f + 0.125f);
      const float d = static_cast<float>((x * 13 + y * 11) % 32) / 128.0f;
      Rgb t(r.x * 0.875f + d, r.y * 0.75f + d, r.z * 0.9375f + d / 2.0f);
      t = {std::min(t.x, 1.0f), std::min(t.y, 1.0f), std::min(t.z, 1.0f)};
      const float scale = hdr ? std::exp2(static_cast<float>((x / 8) % 6) - 2.0f) : 1.0f;
      picture.reference.push_back(r * scale);
      picture.image.push_back(t * scale);
    }
  }
  return picture;
}

}  // namespace pf
