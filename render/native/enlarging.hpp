// Included by each instruction set in a namespace of its own: pictures twice as large.

using i16 = std::int16_t;

// Cubic weights (A = -0.75), of 256, of the texel before, the nearest one and two after it, a quarter of a texel on.
constexpr int QUARTER[4] = {-27, 225, 67, -9};

// Four rows of bytes, each with a weight, of which the second is the nearest; 64 is one level.
inline void cubic_rows(const u8 *a, const u8 *b, const u8 *c, const u8 *d, i64 count, i16 *out) {
    for (i64 k = 0; k < count; ++k) {
        const i16 off = i16(QUARTER[0] * a[k] + (QUARTER[1] - 256) * b[k] + QUARTER[2] * c[k] + QUARTER[3] * d[k]);
        out[k] = i16(64 * b[k] + ((off + 2) >> 2));
    }
}

// Bytes of values that lie `step` apart, 64 a level, of which `b` has the nearest, and of whole levels that are added.
inline void cubic_columns(const i16 *b, i64 step, const i16 *more, i64 count, u8 *out) {
    const i16 *a = b - step, *c = b + step, *d = c + step;
    const auto share = [](i16 value, int weight) { return (value * (256 * weight)) >> 16; };  // rounded down
    for (i64 k = 0; k < count; ++k) {
        const int off = share(a[k], QUARTER[0]) + share(b[k], QUARTER[1] - 256) + share(c[k], QUARTER[2]) + share(d[k], QUARTER[3]);
        const i16 level = i16(i16(b[k] + off + 34) >> 6);  // half a level, and what four shares have lost
        const i16 sum = i16(std::min(std::max(level, i16(0)), i16(255)) + more[k]);
        out[k] = u8(std::min(std::max(sum, i16(0)), i16(255)));
    }
}

void enlarge(Array<const u8> picture, Array<const float> detail, double contrast, Array<const float> fold, i64 left,
             i64 top, Array<u8> out) {
    const i64 h = picture.shape[0], w = picture.shape[1], line = 3 * w, high = fold.shape[0], wide = fold.shape[1];
    require(picture.axes == 3 && picture.shape[2] == 3 && picture.size() > 0, "picture must be (h, w, 3)");
    require(detail.axes == 2 && detail.shape[0] == 2 * h && detail.shape[1] == 2 * w, "detail must be (2 h, 2 w)");
    require(out.axes == 3 && out.shape[0] == 2 * h && out.shape[1] == 2 * w && out.shape[2] == 3, "out must be (2 h, 2 w, 3)");
    require(fold.axes == 2 && fold.size() > 0 && fold.stride == wide, "fold must be (i, j)");
    require(left >= 0 && top >= 0 && left + wide <= w && top + high <= h, "fold must lie in the picture");
    float *kept = memory<164, float>(4 * high * wide), *added = memory<165, float>(2 * w);
    doubled(fold.data, high, wide, kept);
    for (i64 k = 0; k < 4 * high * wide; ++k) kept[k] = 1 - kept[k];
    // Each row with two pixels more at either end, and what is added to its even pixels, then to its odd ones.
    i16 *sums = memory<160, i16>(line + 12) + 6, *more = memory<161, i16>(2 * line);
    u8 *even = memory<162, u8>(2 * line + 8), *odd = even + line + 4;
    i32 *levels = memory<163, i32>(2 * w);
    std::fill(more, more + 2 * line, i16(0));
    const auto row = [&](i64 y) { return picture.row(std::min(std::max(y, i64(0)), h - 1)); };
    const float scale = float(contrast);
    for (i64 y = 0; y < 2 * h; ++y) {
        const i64 near = y / 2, on = y % 2 ? 1 : -1;
        cubic_rows(row(near - on), row(near), row(near + on), row(near + 2 * on), line, sums);
        for (int c = 0; c < 6; ++c) sums[c - 6] = sums[c % 3], sums[line + c] = sums[line - 3 + c % 3];
        const float *fine = detail.row(y);
        for (i64 x = 0; x < 2 * w; ++x) added[x] = scale * fine[x];
        if (y >= 2 * top && y < 2 * (top + high)) {
            const float *share = kept + (y - 2 * top) * 2 * wide;
            for (i64 x = 0; x < 2 * wide; ++x) added[2 * left + x] *= share[x];
        }
        for (i64 x = 0; x < 2 * w; ++x) levels[x] = nearest(std::min(std::max(added[x], -255.0f), 255.0f));
        for (i64 x = 0; x < w; ++x) more[3 * x] = i16(levels[2 * x]), more[line + 3 * x] = i16(levels[2 * x + 1]);
        cubic_columns(sums, -3, more, line, even);
        cubic_columns(sums, 3, more + line, line, odd);
        u8 *to = out.row(y);
        for (i64 x = 0; x + 1 < w; ++x) {  // the fourth byte of each is the next pixel's
            std::memcpy(to + 6 * x, even + 3 * x, 4);
            std::memcpy(to + 6 * x + 3, odd + 3 * x, 4);
        }
        std::memcpy(to + 6 * w - 6, even + line - 3, 3);
        std::memcpy(to + 6 * w - 3, odd + line - 3, 3);
    }
}
