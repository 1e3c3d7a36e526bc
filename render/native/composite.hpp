// Included by each instruction set in a namespace of its own: rasterise, sample, blend.

// Whole places clipped to an axis of a size; exact, as the numbers are whole.
inline i64 within(double place, i64 size) {
    return place <= 0 ? 0 : place >= double(size) ? size : i64(place);
}

constexpr double SUBPIXELS = 256;

struct Point {
    double x, y;
};

// An edge and the first pixel whose centre is not left of it: numerator and denominator are exact integers.
struct Edge {
    double dx, dy, base;
    Edge(Point a, Point b) : dx(b.x - a.x), dy(b.y - a.y), base(a.x * dy - a.y * dx) {}
    double crossing(double y) const { return std::ceil((base + y * dx) / ((dy + (dy == 0)) * SUBPIXELS)); }
};

// Write a triangle's number + 1 into the pixels whose centres it covers, by GL's rule.
inline void rasterise(const Point *corner, u16 number, u16 *ids, i64 width, i64 height) {
    Point top = corner[0], middle = corner[1], bottom = corner[2];
    if (middle.y < top.y) std::swap(top, middle);
    if (bottom.y < middle.y) std::swap(middle, bottom);
    if (middle.y < top.y) std::swap(top, middle);
    const Edge whole(top, bottom), upper(top, middle), lower(middle, bottom);
    const i64 last = within(std::ceil(bottom.y / SUBPIXELS), height);
    for (i64 row = within(std::ceil(top.y / SUBPIXELS), height); row < last; ++row) {
        const double y = double(row) * SUBPIXELS;
        const double one = whole.crossing(y), other = (y >= middle.y ? lower : upper).crossing(y);
        const i64 left = within(std::min(one, other), width), right = within(std::max(one, other), width);
        if (left < right) std::fill(ids + row * width + left, ids + row * width + right, number);
    }
}

// What a triangle's pixels are in the texture: u = a x + b y + c, v = d x + e y + f.
struct Map {
    float a, b, c, d, e, f;
};

// Bilinear RGBA of four texels, which are words of bytes.
inline std::uint32_t bilinear(const u8 *p00, const u8 *p01, const u8 *p10, const u8 *p11, float x, float y) {
    const F4 fx(x), fy(y), a = F4::of_bytes(p00), b = F4::of_bytes(p01), c = F4::of_bytes(p10), d = F4::of_bytes(p11);
    const F4 upper = a + (b - a) * fx, lower = c + (d - c) * fx;
    return (upper + (lower - upper) * fy).bytes();
}

struct Picture {
    const u8 *texels;  // (height, width, 4)
    i64 width, height;

    // Whether what lies at u, v is read from four texels of the picture, a hair within it.
    bool holds(float u, float v) const {
        return u > 0 && v > 0 && u < float(width - 1) - 0.01f && v < float(height - 1) - 0.01f;
    }
    // Four at once, of a run of pixels in a triangle whose ends the picture holds.
    void inner(F4 u, F4 v, std::uint32_t *words) const {
        const F4 x = u.whole(), y = v.whole();
        float fx[4], fy[4];
        i32 texel[4];
        (u - x).store(fx);
        (v - y).store(fy);
        (y * F4(float(width)) + x).store_whole(texel);
#if defined(GUISE_AVX2)
        for (int k = 0; k < 4; k += 2) {
            const __m256 one = across(texels + 4 * i64(texel[k]), fx[k]);
            const __m256 other = across(texels + 4 * i64(texel[k + 1]), fx[k + 1]);
            const __m256 upper = _mm256_permute2f128_ps(one, other, 0x20), lower = _mm256_permute2f128_ps(one, other, 0x31);
            const __m256 down = _mm256_set_m128(_mm_set1_ps(fy[k + 1]), _mm_set1_ps(fy[k]));
            const __m256 made = _mm256_add_ps(upper, _mm256_mul_ps(_mm256_sub_ps(lower, upper), down));
            const __m256i whole = _mm256_cvtps_epi32(made);  // between bytes, as all four are
            const __m256i half = _mm256_packs_epi32(whole, whole), byte = _mm256_packus_epi16(half, half);
            words[k] = std::uint32_t(_mm256_cvtsi256_si32(byte));
            words[k + 1] = std::uint32_t(_mm_cvtsi128_si32(_mm256_extracti128_si256(byte, 1)));
        }
#else
        for (int k = 0; k < 4; ++k) {
            const u8 *at = texels + 4 * i64(texel[k]);
            words[k] = bilinear(at, at + 4, at + 4 * width, at + 4 * width + 4, fx[k], fy[k]);
        }
#endif
    }
#if defined(GUISE_AVX2)
    static __m256 pair(const u8 *at) {
        return _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i *>(at))));
    }
    // Between a texel and the next, and between those below them.
    __m256 across(const u8 *at, float x) const {
        const __m256 here = pair(at), below = pair(at + 4 * width);
        const __m256 left = _mm256_permute2f128_ps(here, below, 0x20), right = _mm256_permute2f128_ps(here, below, 0x31);
        return _mm256_add_ps(left, _mm256_mul_ps(_mm256_sub_ps(right, left), _mm256_set1_ps(x)));
    }
#endif
    std::uint32_t outer(float u, float v) const {
        const float fu = std::floor(u), fv = std::floor(v);
        const i64 x = i64(fu), y = i64(fv);
        const i64 x0 = clamp(x, width), x1 = clamp(x + 1, width), y0 = clamp(y, height) * width,
                  y1 = clamp(y + 1, height) * width;
        return bilinear(texels + 4 * (y0 + x0), texels + 4 * (y0 + x1), texels + 4 * (y1 + x0),
                        texels + 4 * (y1 + x1), u - fu, v - fv);
    }
    static i64 clamp(i64 place, i64 size) { return place < 0 ? 0 : place >= size ? size - 1 : place; }
};

// How far a pixel is drawn by its alpha, and its share by the sum of that around it, as in shaders/blend.frag.glsl, in
// whole numbers: round(28 min(96 alpha / 255, 1)), and round(255 clip(sum / 126 - 1, 0, 1)).
inline u8 drawn_of(u16 alpha) { return u8(std::min(u16((21 * alpha + 1) >> 1), u16(28))); }
inline u16 share_of(u16 sum) {
    const u16 more = u16(std::max(sum, u16(126)) - 126);
    return u16(2 * more + (more > 21) + (more > 62) + (more > 105));
}

// A row of the warped picture: colour (w, 3), alpha, and how far each pixel is drawn; zeros where no triangle is.
struct Row {
    u8 *colour, *alpha, *drawn;
};
inline void warp(const Picture &picture, const Map *maps, const u16 *id, i64 y, i64 w, Row row) {
    const float at = float(y);
    for (i64 x = 0; x < w;) {
        const u16 now = id[x];
        i64 end = x + 1;
        while (end < w && id[end] == now) ++end;
        if (!now) {
            std::memset(row.colour + 3 * x, 0, std::size_t(3 * (end - x)));
            std::memset(row.alpha + x, 0, std::size_t(end - x));
            x = end;
            continue;
        }
        const Map map = maps[now];
        const float by = map.b * at, ey = map.e * at;
        const auto u = [&](i64 k) { return map.a * float(int(k)) + by + map.c; };
        const auto v = [&](i64 k) { return map.d * float(int(k)) + ey + map.f; };
        const auto put = [&](std::uint32_t word) {
            std::memcpy(row.colour + 3 * x, &word, 4);  // the fourth byte is the next pixel's
            row.alpha[x] = u8(word >> 24);
        };
        if (picture.holds(u(x), v(x)) && picture.holds(u(end - 1), v(end - 1))) {
            const F4 a(map.a), d(map.d), b(by), e(ey), c(map.c), f(map.f), last(float(int(end - 1)));
            for (F4 places = F4(0, 1, 2, 3) + F4(float(int(x))); x < end; places = places + F4(4)) {
                const F4 k = least(places, last);  // what is beyond the run is read at its end, and left out
                std::uint32_t words[4];
                picture.inner(a * k + b + c, d * k + e + f, words);
                for (int n = 0; n < 4 && x < end; ++n, ++x) put(words[n]);
            }
        } else {
            for (; x < end; ++x) put(picture.outer(u(x), v(x)));
        }
    }
    for (i64 x = 0; x < w; ++x) row.drawn[x] = drawn_of(row.alpha[x]);
}

// out := (colour * share + out * (255 - share)) / 255, rounded to nearest.
inline void blend(const u8 *colour, const u8 *share, i64 count, u8 *out) {
    for (i64 k = 0; k < count; ++k) {
        const u16 sum = u16(u16(colour[k] * share[k]) + u16(out[k] * u8(255 - share[k])) + 128);
        out[k] = u8(u16(sum + (sum >> 8)) >> 8);
    }
}

// Texels (n, 4) of colours (n, 3) and alpha (n,).
inline void join(const u8 *colour, const u8 *alpha, i64 count, u8 *texels) {
    i64 k = 0;
#if defined(GUISE_SSE)
    const __m128i apart = _mm_setr_epi8(0, 1, 2, -1, 3, 4, 5, -1, 6, 7, 8, -1, 9, 10, 11, -1);
    const __m128i last = _mm_setr_epi8(-1, -1, -1, 0, -1, -1, -1, 1, -1, -1, -1, 2, -1, -1, -1, 3);
    for (; k + 6 <= count; k += 4) {  // 16 bytes are read, of which 12 are four colours
        int four;
        std::memcpy(&four, alpha + k, 4);
        const __m128i rgb = _mm_shuffle_epi8(_mm_loadu_si128(reinterpret_cast<const __m128i *>(colour + 3 * k)), apart);
        const __m128i a = _mm_shuffle_epi8(_mm_cvtsi32_si128(four), last);
        _mm_storeu_si128(reinterpret_cast<__m128i *>(texels + 4 * k), _mm_or_si128(rgb, a));
    }
#endif
    for (; k < count; ++k) {
        for (int c = 0; c < 3; ++c) texels[4 * k + c] = colour[3 * k + c];
        texels[4 * k + 3] = alpha[k];
    }
}

// Each of (n,) three times.
inline void triple(const u8 *values, i64 count, u8 *out) {
    i64 k = 0;
#if defined(GUISE_SSE)
    const __m128i first = _mm_setr_epi8(0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4, 5);
    const __m128i second = _mm_setr_epi8(5, 5, 6, 6, 6, 7, 7, 7, 8, 8, 8, 9, 9, 9, 10, 10);
    const __m128i third = _mm_setr_epi8(10, 11, 11, 11, 12, 12, 12, 13, 13, 13, 14, 14, 14, 15, 15, 15);
    for (; k + 16 <= count; k += 16) {
        const __m128i all = _mm_loadu_si128(reinterpret_cast<const __m128i *>(values + k));
        __m128i *to = reinterpret_cast<__m128i *>(out + 3 * k);
        _mm_storeu_si128(to, _mm_shuffle_epi8(all, first));
        _mm_storeu_si128(to + 1, _mm_shuffle_epi8(all, second));
        _mm_storeu_si128(to + 2, _mm_shuffle_epi8(all, third));
    }
#endif
    for (; k < count; ++k) out[3 * k] = out[3 * k + 1] = out[3 * k + 2] = values[k];
}

void composite(Array<const u8> texture, Array<const u8> alpha, Array<const double> snapped,
               Array<const i32> triangles, Array<const double> grid, double opacity, Array<u8> target) {
    const i64 th = texture.shape[0], tw = texture.shape[1], count = triangles.shape[0], points = snapped.shape[0];
    require(texture.shape[2] == 3 && texture.stride == 3 * tw, "texture must be (th, tw, 3)");
    require(alpha.shape[0] == th && alpha.shape[1] == tw && alpha.stride == tw, "alpha must be (th, tw)");
    require(snapped.shape[1] == 2 && snapped.stride == 2, "snapped must be (v, 2)");
    require(triangles.shape[1] == 3 && triangles.stride == 3 && count < 65535, "triangles must be (t, 3)");
    require(grid.shape[0] == 7 && grid.shape[1] == count && grid.stride == count, "grid must be (7, t)");
    require(target.shape[2] == 3, "target must be (h, w, 3)");

    double low_x = INFINITY, low_y = INFINITY, high_x = -INFINITY, high_y = -INFINITY;
    for (i64 k = 0; k < points; ++k) {
        const double x = snapped.data[2 * k], y = snapped.data[2 * k + 1];
        low_x = std::min(low_x, x), high_x = std::max(high_x, x);
        low_y = std::min(low_y, y), high_y = std::max(high_y, y);
    }
    const i64 x0 = within(std::ceil(low_x / SUBPIXELS), target.shape[1]), y0 = within(std::ceil(low_y / SUBPIXELS), target.shape[0]);
    const i64 w = within(std::floor(high_x / SUBPIXELS) + 1, target.shape[1]) - x0;
    const i64 h = within(std::floor(high_y / SUBPIXELS) + 1, target.shape[0]) - y0;
    if (w <= 0 || h <= 0) return;

    u16 *ids = memory<0, u16>(w * h), *sums = memory<1, u16>(w + 2);
    u8 *texels = memory<2, u8>(4 * tw * th), *share = memory<3, u8>(4 * w), *shares = share + w;
    Row rows[3];
    for (Row &row : rows) {
        row.colour = memory<4, u8>(3 * (5 * w + 1)) + (&row - rows) * (5 * w + 1);
        row.alpha = row.colour + 3 * w + 1;
        row.drawn = row.alpha + w;
    }
    Map *maps = memory<5, Map>(count + 1);
    std::fill(ids, ids + w * h, u16(0));
    join(texture.data, alpha.data, tw * th, texels);
    // Triangles that are turned over from the grid lie behind the others.
    for (int front = 0; front < 2; ++front) {
        for (i64 t = 0; t < count; ++t) {
            Point corner[3];
            for (int k = 0; k < 3; ++k) {
                const i64 at = triangles.data[3 * t + k];
                require(at >= 0 && at < points, "triangles must name points");
                corner[k] = {snapped.data[2 * at] - double(x0) * SUBPIXELS, snapped.data[2 * at + 1] - double(y0) * SUBPIXELS};
            }
            const double area = (corner[1].x - corner[0].x) * (corner[2].y - corner[0].y) -
                                (corner[1].y - corner[0].y) * (corner[2].x - corner[0].x);
            const bool turned = (area < 0) != (grid.data[6 * count + t] != 0);
            if (turned == bool(front)) continue;
            rasterise(corner, u16(t + 1), ids, w, h);
            const double x = corner[0].x / SUBPIXELS, y = corner[0].y / SUBPIXELS;
            const double dx1 = corner[1].x / SUBPIXELS - x, dy1 = corner[1].y / SUBPIXELS - y;
            const double dx2 = corner[2].x / SUBPIXELS - x, dy2 = corner[2].y / SUBPIXELS - y;
            const double size = dx1 * dy2 - dx2 * dy1, inverse = size != 0 ? 1 / size : 0;
            double way[2][3];
            for (int k = 0; k < 2; ++k) {
                const double first = grid.data[k * count + t], second = grid.data[(2 + k) * count + t];
                way[k][0] = (first * dy2 - second * dy1) * inverse;
                way[k][1] = (second * dx1 - first * dx2) * inverse;
                way[k][2] = size != 0 ? grid.data[(4 + k) * count + t] - way[k][0] * x - way[k][1] * y : 0;
            }
            maps[t + 1] = {float(way[0][0]), float(way[0][1]), float(way[0][2]),
                           float(way[1][0]), float(way[1][1]), float(way[1][2])};
        }
    }

    // Three rows at a time: the share of a row needs those above and below it.
    const Picture picture{texels, tw, th};
    u8 levels[256];
    for (int k = 0; k < 256; ++k) levels[k] = u8(std::nearbyint(k * opacity));
    for (i64 y = 0; y <= h; ++y) {
        if (y < h) warp(picture, maps, ids + y * w, y, w, rows[y % 3]);
        if (y == 0) continue;
        const i64 row = y - 1;
        const Row &line = rows[row % 3];
        const u8 *above = rows[(row > 0 ? row - 1 : row) % 3].drawn, *at = line.drawn, *below = rows[(y < h ? y : row) % 3].drawn;
        for (i64 x = 0; x < w; ++x) sums[x + 1] = u16(above[x] + at[x] + below[x]);
        sums[0] = sums[1], sums[w + 1] = sums[w];
        for (i64 x = 0; x < w; ++x) {
            const u16 sum = u16(line.alpha[x] * share_of(u16(sums[x] + sums[x + 1] + sums[x + 2])) + 128);
            share[x] = u8(u16(sum + (sum >> 8)) >> 8);
        }
        if (opacity < 1) {
            for (i64 x = 0; x < w; ++x) share[x] = levels[share[x]];
        }
        triple(share, w, shares);
        blend(line.colour, shares, 3 * w, target.row(y0 + row) + 3 * x0);
    }
}
